"""Candidates for a frame's locus, weighed by their evidence, and what that leaves undecided."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from jitterkit.refit.evidence import log_evidence
from jitterkit.refit.result import Candidate, FitResult, Status

_CERTAIN = 0.95
"""Weight above which a frame has decided."""


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
