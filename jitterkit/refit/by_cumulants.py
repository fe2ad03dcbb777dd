"""Candidate loci that need no fit to the image: what cumulants tell of them is enough."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from jitterkit.estimators.compressed import CLOSE, CompressedFit, CompressedLikelihood
from jitterkit.loci import locus_class
from jitterkit.refit.result import FitResult

__all__ = ["as_fit", "told_by_cumulants"]

_CLOSER = 0.1
"""Share of a difference in log-likelihood that what cumulants say of it may be off by, to be believed."""

_BEHIND, _UNCERTAIN = 10.0, 0.3
"""Log-likelihood by which a locus is far behind the best, at least, and as a share of what cumulants say of
it.  They say a seventh less than fits do of blurs of 0.22 arcsec rms on TOLIMAN, and still less of larger."""


def told_by_cumulants(compressed: CompressedLikelihood, names: list[str]) -> dict[str, CompressedFit]:
    """Loci of which the score over cumulants tells enough: exactly, or that they are far behind."""
    fits = {name: compressed.fit(locus_class(name)) for name in names}
    known = {name: fit for name, fit in fits.items() if fit is not None}
    best = max([0.0, *(fit.gain for fit in known.values() if fit.left_out < _CLOSER * fit.gain)])
    return {
        name: told
        for name, told in known.items()
        if told.left_out < max(CLOSE, _CLOSER * (best - told.gain))
        or best - told.gain > max(_BEHIND, _UNCERTAIN * max(best, abs(told.gain)))
    }


def as_fit(normal: FitResult, name: str, told: CompressedFit, aberrations: tuple[str, ...]) -> FitResult:
    """The result that a fit with a locus would have, as far as its evidence is concerned."""
    assert normal.parameters is not None
    return replace(
        normal,
        locus=name,
        parameters=told.at(normal.parameters, aberrations),
        names=told.names,
        covariance=told.covariance,
        crlb=np.zeros(0),
        image=None,
        residual=None,
        objective=normal.objective - 2 * told.gain,
        seconds=0.0,
    )
