"""The blur of one frame against a sharp one of the same scene.

With the scene known, nothing has to be guessed, and small blurs show as well as long ones.
:func:`estimate_from_reference` blurs the sharp frame by a normal, a streak, or a streak or a sine under a
normal, together with the shift and the gain between the frames; the kernel on pixels comes beside it, from
the regularised ratio of the transforms.
"""

from __future__ import annotations

import numpy as np

from jitterkit.conventions import axis_angle
from jitterkit.errors import ConfigurationError, ErrorCode, UndeterminedError
from jitterkit.extended.blur_fit import Blur, fit_blur, normal, streak, vibration
from jitterkit.extended.comparison import Comparison, Fit
from jitterkit.extended.registration import align
from jitterkit.extended.standing import fill, standing_pixels
from jitterkit.kernel_estimate import KernelEstimate, refuse_blurrier
from jitterkit.loci import Linear, Locus, Mvn, Product, Shm, Smear, axis_variances, covariance_on_axis

_TOLERATED = 0.03
"""Share of the blur's larger variance that may be missing across it: a normal fitted to a streak on sharp
photographs leaves at most 0.018 of it."""

_BLURRIER = 5.0
"""Standard errors from which the variance of the exchanged frames is one."""

_MISFIT = 1.4
"""Relative error of a variance, in units of the root of the share of the frames' difference that is left: 1.0
to 1.5 of motions on circles, vibrations that fade, and a change of focus; jumps and bent paths make less."""

_LEFT = 0.02
"""Share of the difference of the aligned frames that may be no known blur, of which nothing is left.
Under a blur of 3 pixels, columns and textures of a tenth of the scene that stand still leave more; those of
0.03, which change the variance by a hundredth, leave less."""


def estimate_from_reference(
    sharp: np.ndarray,
    blurred: np.ndarray,
    *,
    plate_scale: float = 1.0,
    variance: tuple[float, float] | None = None,
    mask: np.ndarray | None = None,
    kernel_side: int = 41,
) -> KernelEstimate:
    """Estimate the blur between two frames of the same scene.

    Parameters
    ----------
    sharp, blurred : (ny, nx) arrays
        In the same unit up to a factor; the blurred one may be shifted by a few pixels.
    plate_scale : float
        Arcsec/pixel; without one, a pixel counts as an arcsec.
    variance : (float, float), optional
        Noise variance of a pixel in either frame; without it, the power at the highest frequencies.
    mask : (ny, nx) bool array, optional
        True where a pixel of either frame is unusable; it is filled from its neighbours.
    kernel_side : int
        Of the pixel kernel; odd.

    Returns
    -------
    estimate : KernelEstimate
        Of a normal, a streak, or a streak or a sine under a normal, whichever fits best (``locus``), with
        ``kernel``.

    Raises
    ------
    ConfigurationError
        If the frames are not two images of one shape with finite values.
    UndeterminedError
        If the frames have no scene in common, its spectrum does not rise above the noise, or the sharp
        frame is blurrier than the other along any axis; or the frames differ by more than a blur and a shift
        (code ``model_mismatch``), as by a pattern that stands still.

    Notes
    -----
    *Assumes* white noise and one blur all over the frame.  *Fails when* the scene changes between frames, or
    the blur is of another kind and noise hides that (see the handbook's limits).  What the blur leaves of the
    frames' difference, and the change to a kind that fits about as well, are part of the covariance.
    Moments are of the blur *added* to the sharp frame's own; noise may make them indefinite.
    """
    if kernel_side % 2 == 0:
        problem = f"A kernel has a middle pixel; its side must be odd, got {kernel_side}."
        raise ConfigurationError(ErrorCode.WRONG_SHAPE, problem)
    drift, _ = align(sharp, blurred, mask)  # a lopsided blur is no reason to refuse
    pair = [np.asarray(frame, float) for frame in (sharp, blurred)]
    bad = np.zeros(pair[0].shape, bool) if mask is None else np.asarray(mask, bool)
    bad = bad | standing_pixels(*(fill(frame, bad) for frame in pair))
    one, two = (fill(frame, bad) for frame in pair)
    frames = Comparison(one, two, variance)
    blur = fit_blur(frames, (drift.x, drift.y))
    # of a streak across the sharp frame's own blur the normal tells, though the streak may fit better
    refuse_blurrier(blur.normal.p[3:], blur.normal.covariance[3:, 3:], tolerated=_TOLERATED)
    moments, covariance = _moments(blur.best)
    # by which the kind of the blur may be wrong
    other = np.zeros(3) if blur.rival is None else _moments(blur.rival)[0] - moments
    misfit = _MISFIT**2 * blur.excess * (moments[0] + moments[2]) ** 2
    of_kind = blur.odds * np.outer(other, other) + misfit * np.diag([1.0, 0.5, 1.0])  # alike along all axes
    covariance = covariance + of_kind
    _refuse_other_differences(blur, frames)
    return KernelEstimate(
        moments * plate_scale**2,
        covariance * plate_scale**4,
        "reference",
        kernel=frames.kernel(blur.best.p[1], blur.best.p[2], kernel_side),
        locus=_locus(blur.best, plate_scale),
        length_err=_length_error(blur) * plate_scale,
    )


def _refuse_other_differences(blur: Blur, frames: Comparison) -> None:
    """Refuse frames of which more differs than the known blurs can explain."""
    if blur.left <= _LEFT:
        return
    if (wider := _reverse(blur, frames)) is not None:
        problem = f"The reference is blurrier than the frame (by {wider:.3g} pixel² of variance)"
        raise UndeterminedError(ErrorCode.BAD_REFERENCE, f"{problem}; exchange them?")
    found = f"No blur that is known explains {blur.left:.2g} of the difference of the frames"
    reasons = (
        "a pattern stands still, the scene or its light changed, the view turned, the noise is correlated "
        "(JPEG, resampling), or the blur is no streak, sine or normal"
    )
    remedy = "divide by the flat field, mask the pattern, or give another reference"
    raise UndeterminedError(ErrorCode.MODEL_MISMATCH, f"{found}: {reasons}; {remedy}.")


def _reverse(blur: Blur, frames: Comparison) -> float | None:
    """Return the larger variance [pixel²] of a blur that makes the second frame the first, if one does."""
    x, y = blur.best.p[1:3]
    try:
        reverse = fit_blur(frames.exchanged(), (-x, -y))
    except UndeterminedError:
        return None
    moments, covariance = _moments(reverse.best)
    major, _, axis = axis_variances(moments)
    is_wider = major > _BLURRIER * np.sqrt(covariance_on_axis(covariance, axis)[0, 0])
    return major if is_wider and reverse.left <= _LEFT else None


def _moments(fit: Fit) -> tuple[np.ndarray, np.ndarray]:
    """Return the moments (3,) of a blur [pixel²], and their covariance (3, 3)."""
    if fit.transfer is not streak:
        return fit.p[3:6], fit.covariance[3:6, 3:6]
    x, y = fit.p[3:]
    slopes = np.array([[2 * x, y, 0], [0, x, 2 * y]]) / 12
    covariance = slopes.T @ fit.covariance[3:, 3:] @ slopes
    covariance += np.eye(3) * (np.trace(fit.covariance[3:, 3:]) / 12) ** 2  # of second order, for short ones
    return np.array([x * x, x * y, y * y]) / 12, covariance


def _length_error(blur: Blur) -> float:
    """Return the standard error of the length of what is straight in a blur [pixels]; NaN of a normal."""
    fit, rival = blur.best, blur.rival
    if fit.transfer is normal:
        return float("nan")
    length = max(np.hypot(*fit.p[-2:]), 1e-12)
    axis = fit.p[-2:] / length
    of_noise = np.sqrt(axis @ fit.covariance[-2:, -2:] @ axis)
    other = 0.0
    if rival is not None and rival.transfer is not normal:
        other = float(np.hypot(*rival.p[-2:])) - length
    return float(np.sqrt(of_noise**2 + blur.odds * other**2 + _MISFIT**2 * blur.excess * length**2))


def _locus(fit: Fit, plate_scale: float) -> Locus:
    """Return the locus of a blur, arcsec."""
    moments = _moments(fit)[0] * plate_scale**2
    if fit.transfer is normal:
        return Mvn.near(moments)
    kind, (x, y) = Shm if fit.transfer is vibration else Linear, fit.p[-2:] * plate_scale
    line = kind.of(float(np.hypot(x, y)), axis_angle(np.degrees(np.arctan2(y, x))))
    if fit.transfer is streak:
        return line
    rest = Mvn.near(moments - kind.variance * np.array([x * x, x * y, y * y]))
    return Smear(line, rest) if isinstance(line, Linear) else Product(line, rest)
