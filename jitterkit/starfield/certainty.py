"""Whether what was fitted is a trail: beyond its errors, and of stars that are stars.

Worse seeing or focus lengthens nothing but makes errors; galaxies, speckles and blends are long, each in its
own way.  What is no trail is said in a sentence, which makes the status ``undetermined``.

Whether a reference is sharp enough is determined from the difference of the stars'
adaptive moments, whose noise has mean zero: a PSF with noise in it, fitted to stars, asks for a little blur
that smooths it.
"""

from __future__ import annotations

import numpy as np
from scipy.stats import chi2, median_abs_deviation

from jitterkit.loci import axis_variances, covariance_on_axis
from jitterkit.starfield.moments import Moments
from jitterkit.starfield.psf import Common, Psf

_SURE = float(chi2.isf(1e-3, 2))
"""Chi-squared of a line's two coordinates that no trail at all exceeds in one frame of a thousand."""

_SYSTEMATIC = 2.0
"""Systematic errors of a length's square that a trail exceeds: changes of seeing and focus without one made
0.4 of them at most."""

_COARSE = 0.75, 0.03
"""Variance across a star [pixels²] below which the sampling is coarse (FWHM 2.0 pixels), and the error that
moments then have [pixels²]: trails of 1.5 over a FWHM of 1.6 to 1.9 come out 0.05 to 0.09 too long."""

_FEW = 8
"""Stars below which they must be alike."""

_NOT_LINEAR = 0.1
"""Change of the stars' variance from the fainter third to the brighter from which the pixels are not linear:
0.02 to 0.04 of sound fields, 0.15 to 0.5 of a gamma of 0.8 to 0.45 or an arcsinh."""

_GROWING = 0.02
"""The same from the middle third to the brightest sixth: 0.011 at most in 36 sound fields.  The fainter third
is smaller, as noise cuts its stars' wings."""


def compatible_with_zero(length: float, noise: float, systematic: float, model_error: float) -> str:
    """Return a sentence where a length [pixels] is not beyond its errors.

    Of its square: the noise, and the systematic error [pixels²]; of itself the model error [pixels].
    """
    limit = np.sqrt(_SURE) * noise + _SYSTEMATIC * np.hypot(systematic, 2 * length * model_error)
    if length**2 > limit:
        return ""
    error = np.hypot(root_error(length**2, noise + systematic), model_error)
    said = f"No trail is known: its length, {length:.2f} +/- {error:.2f} pixels, is compatible with zero"
    return f"{said}. What blur there is may be seeing, focus or optics."


def disagreement(common: Common) -> str:
    """Return a sentence where the stars are few and their shapes do not agree."""
    n = int(common.used.sum())
    if n >= _FEW or common.agree:
        return ""
    stars = "1 star is" if n == 1 else f"{n} stars are"
    return (
        f"No trail is known: {stars} too few to distinguish a trail from galaxies, speckles or blends unless "
        f"the shapes of several agree; {_FEW} are needed."
    )


def not_linear(moments: Moments, used: np.ndarray) -> str:
    """Return a sentence where bright stars have another size than faint ones."""
    sizes = _by_flux(moments, used)
    third = len(sizes) // 3
    ratio, error = _compare(sizes[:third], sizes[len(sizes) - third :])
    if not abs(np.log(ratio)) >= max(_NOT_LINEAR, _CERTAIN * error):
        return ""
    galaxies = "as where many faint ones are galaxies, or " if ratio < 1 else "as "
    return (
        f"No trail is known: the variance of bright stars is {ratio:.2f} times that of faint ones, {galaxies}"
        "where pixels were stretched (gamma, arcsinh) or do not respond in proportion to the light; give "
        "pixels as they were read, and a field of stars."
    )


def growing(moments: Moments, used: np.ndarray) -> tuple[str, ...]:
    """Return a remark where the brightest sixth of the stars is wider than the middle third."""
    sizes = _by_flux(moments, used)
    sixth = len(sizes) // 6
    ratio, error = _compare(sizes[2 * sixth : 4 * sixth], sizes[len(sizes) - sixth :])
    if not np.log(ratio) >= max(_GROWING, _CERTAIN * error):
        return ()
    return (
        f"The variance of the brightest stars is {ratio:.3f} times that of fainter ones: near the top of "
        "their range pixels do not respond in proportion to the light, and the blur may be wrong by as much.",
    )


def _by_flux(moments: Moments, used: np.ndarray) -> np.ndarray:
    """Return the variances [pixels²] of stars, the faintest star's first."""
    return moments.moments[used][np.argsort(moments.flux[used])] @ np.array([1.0, 0.0, 1.0])


def _compare(faint: np.ndarray, bright: np.ndarray) -> tuple[float, float]:
    """Return the ratio of the medians, bright over faint, and its relative error; NaN of too few stars."""
    if min(len(faint), len(bright)) < _FEW // 2:
        return np.nan, np.nan
    middles = np.array([np.median(faint), np.median(bright)])
    scatter = [median_abs_deviation(part, scale="normal") / np.sqrt(len(part)) for part in (faint, bright)]
    return middles[1] / middles[0], float(np.hypot(*(1.2533 * np.array(scatter) / middles)))


def coarse_sampling(across: float) -> tuple[float, tuple[str, ...]]:
    """Return the variance [pixels²] that coarse sampling may add to stars of a variance, and a remark."""
    limit, error = _COARSE
    if across > limit:
        return 0.0, ()
    return error, (
        f"The stars are undersampled (FWHM of {np.sqrt(8 * np.log(2) * across):.1f} pixels; 2 are sampled "
        "well enough): errors contain that.",
    )


def root_error(square: float, error: float) -> float:
    """Return the error of a root, finite at zero: that of the square over twice the root far from it."""
    return float(np.sqrt(square + error) - np.sqrt(max(square - error, 0.0))) / 2


TOLERATED = 0.25
"""Share of the blur's larger variance that may be missing across it: a trail's length, widened or not,
is then right to 5 %; stars sharper by 0.45 of it gave 5 % too little, by 1.4 of it 6 %, and where nothing
is left of the trail it is invented."""

_ROUND, _CERTAIN = 1.1, 5.0
"""Ratio of a reference's variances along and across up to which it is round, and sigma of what is not:
optics make ellipticities of a few percent."""


def elongation(psf: Psf) -> tuple[float, float] | None:
    """Length [pixels] of a line that makes round stars as long as the reference's, and its axis [deg].

    None where the reference's stars are round within their errors, or nearly so.
    """
    major, minor, axis = axis_variances(psf.moments)
    error, _ = elongation_errors(psf.covariance, axis)
    if major < _ROUND * minor or major - minor < _CERTAIN * error:
        return None
    return float(np.sqrt(12 * (major - minor))), axis


def elongation_errors(covariance: np.ndarray, axis: float) -> tuple[float, float]:
    """Return the errors of the elongation ``major - minor`` along its axis and at 45 degrees to it."""
    own = covariance_on_axis(covariance, axis)
    return float(np.sqrt(own[0, 0] + own[2, 2] - 2 * own[0, 2])), float(2 * np.sqrt(own[1, 1]))
