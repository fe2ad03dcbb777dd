"""Candidate loci that need no fit to the image: cumulants evaluate them well enough."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from jitterkit.estimators.compressed import CLOSE, CompressedFit, CompressedLikelihood
from jitterkit.loci import locus_class
from jitterkit.refit.result import FitResult

_CLOSER = 0.1
"""Largest error of a difference in log-likelihood by cumulants, as a share of it, at which it is used."""

_BEHIND, _UNCERTAIN = 10.0, 0.3
"""Log-likelihood by which a locus is far behind the best, at least, and as a share of what cumulants say of
it.  They say a seventh less than fits do of blurs of 0.22 arcsec rms on TOLIMAN, and still less of larger."""


def evaluate_by_cumulants(compressed: CompressedLikelihood, names: list[str]) -> dict[str, CompressedFit]:
    """Return the fits of loci that cumulants evaluate well enough: exactly, or as far behind the best."""
    fits = {name: compressed.fit(locus_class(name)) for name in names}
    known = {name: fit for name, fit in fits.items() if fit is not None}
    best = max([0.0, *(fit.gain for fit in known.values() if fit.left_out < _CLOSER * fit.gain)])
    return {
        name: fit
        for name, fit in known.items()
        if fit.left_out < max(CLOSE, _CLOSER * (best - fit.gain))
        or best - fit.gain > max(_BEHIND, _UNCERTAIN * max(best, abs(fit.gain)))
    }


def as_fit(normal: FitResult, name: str, fit: CompressedFit, aberrations: tuple[str, ...]) -> FitResult:
    """Return the result that a fit with a locus would have, as far as its evidence is concerned."""
    assert normal.parameters is not None
    return replace(
        normal,
        locus=name,
        parameters=fit.at(normal.parameters, aberrations),
        names=fit.names,
        covariance=fit.covariance,
        crlb=np.zeros(0),
        image=None,
        residual=None,
        objective=normal.objective - 2 * fit.gain,
        seconds=0.0,
    )
