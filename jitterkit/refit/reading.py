"""One reading of a frame: a star or a pair, with the fit and the evidence that it has."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from jitterkit.kernel_estimate import significance
from jitterkit.locate import Start
from jitterkit.loci import principal_axes
from jitterkit.refit.boundary import minor_variance
from jitterkit.refit.choose import DETECTED
from jitterkit.refit.evidence import is_intricate
from jitterkit.refit.result import FitResult, Status
from jitterkit.scene import Binary

OF_A_PAIR, _SAME = ("separation", "theta", "contrast"), 0.1
"""Errors by which these may differ between fits that began at two starts and ended at one maximum."""

_SIZED = 3.0
"""Standard errors of the total variance from which a jitter has a size, as its evidence takes for granted."""

_SHOWN = 4.0
"""Standard errors of its contrast from which the companion of a pair is seen."""

_STRAIGHT, _THIN = 4.0, 1e-3
"""Standard errors of the minor variance within which a blur may have no width, and its share of the major: a
fit with a straight locus has no error there."""


@dataclass(frozen=True)
class Reading:
    """Hold one way to read a frame.

    Attributes
    ----------
    start : Start
        Where its fits began.
    fit : FitResult
        With the best of its loci, or without jitter.
    evidence : float
        Logarithm, with the scene's prior; minus infinity where there is none.
    normal : FitResult or None
        Of a pair, with a normal blur.
    """

    start: Start
    fit: FitResult
    evidence: float
    normal: FitResult | None = None


@dataclass(frozen=True)
class FittedPair:
    """Hold a pair, its fit with a normal blur, and those with other blurs that were asked for, by locus."""

    start: Start
    normal: FitResult
    others: dict[str, FitResult] = field(default_factory=dict)


def best_reading(readings: Iterable[Reading]) -> Reading:
    """The most probable; of those for which nothing speaks, the one that fits best."""
    return max(readings, key=lambda one: (one.evidence, -np.nan_to_num(one.fit.objective, nan=np.inf)))


def has_a_size(fit: FitResult) -> bool:
    """Return whether jitter of a positive variance is seen: a pair may have absorbed too much of it."""
    moments, covariance = fit.moments()
    error = math.sqrt(max(covariance[0, 0] + covariance[2, 2] + 2 * covariance[0, 2], 0.0))
    return significance(moments, covariance) > DETECTED and bool(moments[0] + moments[2] > _SIZED * error)


def is_same_maximum(fit: FitResult, other: FitResult) -> bool:
    """Return whether a pair's fit ended at the same maximum as another one, which settled."""
    moved = [abs(fit.of_scene(name) - other.of_scene(name)) / fit.error(name) for name in OF_A_PAIR]
    near = abs(fit.objective - other.objective) < _SAME**2 and max(moved) < _SAME
    return other.status is Status.OK and near


def needs_more(star: FitResult, normal: FitResult) -> bool:
    """Return whether one star needs more than a simple locus, or a pair more than a normal."""
    simple = star.status is Status.OK and not is_intricate(star.locus)
    return normal.parameters is not None and (not simple or normal.status is not Status.OK)


def shows_companion(pair: FitResult) -> bool:
    """Return whether the contrast of a pair is known well enough for its companion to be seen."""
    known = pair.parameters is not None and "contrast" in pair.names
    return known and pair.of_scene("contrast") > _SHOWN * pair.error("contrast")


def is_straight(moments: np.ndarray, covariance: np.ndarray) -> bool:
    """Return whether a blur may have no width."""
    minor, error = minor_variance(moments, covariance)
    return bool(minor < max(_STRAIGHT * error, _THIN * (moments[0] + moments[2] - minor)))


def describe(reading: Reading) -> str:
    """Describe a reading in words."""
    fit = reading.fit
    if fit.parameters is None:
        return "neither"
    scene = fit.parameters.scene
    major, minor, _ = principal_axes(fit.moments()[0])
    jitter = f"a jitter of {major:.3g} x {minor:.3g} arcsec rms" if major > 0 else "no jitter"
    if isinstance(scene, Binary):
        return f"two stars {float(scene.separation):.4g} arcsec apart with {jitter}"
    return f"one star with {jitter}"
