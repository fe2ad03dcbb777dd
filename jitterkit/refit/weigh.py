"""Candidates for a frame's locus, weighed by their evidence, and what that leaves undecided."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from jitterkit.estimators.compressed import CLOSE, CompressedFit, CompressedLikelihood
from jitterkit.loci import locus_class
from jitterkit.refit.evidence import log_evidence
from jitterkit.refit.result import Candidate, FitResult, Status

_CERTAIN = 0.95
"""Weight above which a frame has decided."""

_CLOSER = 0.1
"""Largest error of a difference in log-likelihood by cumulants, as a share of it, at which it is used."""

_BEHIND, _UNCERTAIN = 10.0, 0.3
"""Log-likelihood by which a locus is far behind the best, at least, and as a share of what cumulants say of
it.  They say a seventh less than fits do of blurs of 0.22 arcsec rms on TOLIMAN, and still less of larger."""


def weight_of_evidence(fit: FitResult) -> float:
    """Nothing speaks for a locus whose fit did not settle."""
    return log_evidence(fit) if fit.status in (Status.OK, Status.POOR_FIT) else -np.inf


def weigh(tried: Sequence[FitResult], evidence: Sequence[float]) -> tuple[Candidate, ...]:
    """Candidates, best first; where nothing speaks for any of them the first has all the weight."""
    known = np.where(np.isfinite(evidence), evidence, -np.inf)
    odds = np.exp(known - known.max()) if np.any(np.isfinite(known)) else np.eye(len(tried))[0]
    candidates = [
        Candidate(
            fit.locus,
            fit.objective,
            float(weight),
            fit.of_scene("separation"),
            fit.error("separation"),
            float(value),
            _moments(fit),
        )
        for fit, weight, value in zip(tried, odds / odds.sum(), evidence, strict=True)
    ]
    return tuple(sorted(candidates, key=lambda one: -one.weight))


def with_candidate(
    candidates: tuple[Candidate, ...], fit: FitResult, evidence: float
) -> tuple[Candidate, ...]:
    """Return candidates with one more, or another fit in place of one, weighed again."""
    every = [one for one in candidates if one.locus != fit.locus] + list(weigh([fit], [evidence]))
    odds = np.exp([one.evidence - max(one.evidence for one in every) for one in every])
    weighed = [replace(one, weight=float(w)) for one, w in zip(every, odds / odds.sum(), strict=True)]
    return tuple(sorted(weighed, key=lambda one: -one.weight))


def _moments(fit: FitResult) -> tuple[float, float, float]:
    if fit.parameters is None:
        return np.nan, np.nan, np.nan
    xx, xy, yy = map(float, np.asarray(fit.parameters.locus.moments()))
    return xx, xy, yy


def describe_undecided(candidates: tuple[Candidate, ...]) -> str:
    """A sentence where the least number of loci that hold 95 % of the weight is more than one."""
    held = np.cumsum([one.weight for one in candidates])
    likely = candidates[: int(np.searchsorted(held, _CERTAIN)) + 1]
    if len(likely) < 2:
        return ""
    names = [one.locus for one in likely]
    separations = [one.separation for one in likely]
    loci = f"{', '.join(names[:-1])} and {names[-1]}"
    difference = max(separations) - min(separations)
    if np.isnan(difference):  # of one star
        return f"Undecided between {loci}."
    return f"Undecided between {loci}; the separation differs by {_microarcsec(difference)}."


def _microarcsec(angle: float) -> str:
    """Format an angle in a suitable unit.

    >>> _microarcsec(3.1e-7), _microarcsec(2.04e-3)
    ('0.3 µas', '2.0 mas')
    """
    return f"{angle * 1e6:.1f} µas" if angle < 1e-3 else f"{angle * 1e3:.1f} mas"


class Tried:
    """Fits of a frame by their loci, each with its evidence."""

    def __init__(self, first: FitResult) -> None:
        self.fits: dict[str, FitResult] = {}
        self.evidence: dict[str, float] = {}
        self.add(first)

    def add(self, fit: FitResult) -> None:
        self.fits[fit.locus], self.evidence[fit.locus] = fit, weight_of_evidence(fit)

    @property
    def best(self) -> FitResult:
        return self.fits[max(self.fits, key=lambda name: self.evidence[name])]


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
