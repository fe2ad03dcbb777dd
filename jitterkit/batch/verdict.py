"""What only the frame and its fit together can tell: why it does not fit, and where its stars are."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from jitterkit.detectors import NORMALISED
from jitterkit.errors import ErrorCode
from jitterkit.frames import Frame, sky_position_angle
from jitterkit.kernel_estimate import is_detected
from jitterkit.locate import resolution
from jitterkit.optics import OTF
from jitterkit.refit import FitResult, Status, single_star
from jitterkit.refit.absurd import absurdity
from jitterkit.refit.outliers import OUTLIERS, left_out
from jitterkit.scene import Stars

__all__ = [
    "OUTLIERS",
    "faint_companion",
    "further_stars",
    "judge",
    "left_out",
    "midpoint_pixel",
    "position_angle",
    "scale_hint",
    "why_unusable",
]

_FAINT, _CLOSE = 100.0, 5.0
"""Contrast, and separation in resolutions, of a companion as errors of the optics make them: 15 to 17 nm made
some of 330 to 510 at three resolutions."""

_BELOW = 5.0
"""Standard errors below zero from which a background is none."""

_MANY = 20.0
"""Electrons from which a Poisson law is normal enough for that."""

_OUTLIER = 8.0
"""Sigmas: chance makes one pixel in 1e15 stand out so far."""


def further_stars(result: FitResult) -> FitResult:
    """Add a remark to a result where stars beside those of the scene were fitted."""
    scene = None if result.parameters is None else result.parameters.scene
    if scene is None or scene.others is None or isinstance(scene, Stars):
        return result
    x, y, flux = (np.asarray(part) for part in scene.sources())
    brightest = np.asarray(scene.others.flux).argmax() + len(x) - len(scene.others.x)
    fainter = (
        f"{2.5 * np.log10(flux[0] / flux[brightest]):.2g} mag fainter than A"
        if flux[brightest] > 0
        else "dark"
    )
    apart = np.hypot(x[brightest] - x[0], y[brightest] - y[0])
    count = len(scene.others.x)
    which = "the brightest " * (count > 1)
    said = f"{count} further star{'s' * (count > 1)} fitted, {which}{fainter}, {apart:.3g} arcsec from it."
    return replace(result, message=f"{result.message} {said}", flags=(*result.flags, "further_stars"))


def faint_companion(result: FitResult, otf: OTF) -> FitResult:
    """Add a remark to a result where a companion may as well be an error of the optics."""
    contrast, separation = result.of_scene("contrast"), result.of_scene("separation")
    if not (result.status.usable and contrast > _FAINT and separation < _CLOSE * resolution(otf)):
        return result
    said = f"The companion, {contrast:.3g} times fainter and {separation:.3g} arcsec away, may be a speckle."
    return replace(result, message=f"{result.message} {said}", flags=(*result.flags, "faint_companion"))


def judge(frame: Frame, result: FitResult, expected_scale: float) -> FitResult:
    """Say why a frame does not fit where that can be told, and that a pair is not one.

    Parameters
    ----------
    frame : Frame
    result : FitResult
    expected_scale : float
        The instrument's plate scale, arcsec.
    """
    if result.parameters is None:
        return result
    if result.status in (Status.OK, Status.NOT_CONVERGED) and single_star(result):
        message = f"{Status.NO_PAIR.value}: a second one is lost in its noise."
        return replace(result, status=Status.NO_PAIR, message=message)
    absurd = absurdity(result.parameters, frame.shape, frame.plate_scale or expected_scale)
    if absurd:
        message = f"{Status.POOR_FIT.value}: {absurd}."
        return replace(result, status=Status.POOR_FIT, message=message, code=ErrorCode.IMPLAUSIBLE)
    outliers = _outlier_hint(frame, result)
    if outliers and result.status is Status.OK and "misfit" not in result.flags:
        result = replace(result, flags=(*result.flags, "misfit"))
    if result.status is Status.POOR_FIT or "misfit" in result.flags:
        scale = scale_hint(frame, expected_scale)
        jitter = "" if scale or outliers else _jitter_hint(result)
        unitless = NORMALISED in frame.flags
        sky = "" if jitter or unitless else _sky_hint(result)  # the wings of a blur look like sky
        hints = filter(None, (scale, outliers, jitter, sky))
        return replace(result, message=" ".join([result.message, *hints]))
    return result


def midpoint_pixel(frame: Frame | None, result: FitResult, plate_scale: float) -> tuple[float, float]:
    """Place of the scene ``(x, y)`` in 0-based pixels of the original frame; NaN where none was fitted."""
    if frame is None or result.parameters is None:
        return math.nan, math.nan
    scene, (ny, nx), (x0, y0) = result.parameters.scene, frame.shape, frame.origin
    return (
        x0 + (nx - 1) / 2 + float(scene.x) / plate_scale,
        y0 + (ny - 1) / 2 + float(scene.y) / plate_scale,
    )


def position_angle(frame: Frame | None, result: FitResult, plate_scale: float) -> float:
    """Direction from A to B on the sky, north through east [deg]; NaN without a WCS or a fit of a pair."""
    theta = result.of_scene("theta")
    if frame is None or frame.metadata.wcs is None or math.isnan(theta):
        return math.nan
    return sky_position_angle(frame.metadata.wcs, *midpoint_pixel(frame, result, plate_scale), theta)


def why_unusable(frame: Frame) -> str:
    """Why a frame has no usable pixel."""
    saturation = frame.metadata.saturation
    if frame.saturated and saturation is not None:
        return (
            f"{frame.saturated} of {frame.mask.size} pixels are saturated at {saturation.value:g} ADU "
            f"({saturation.source}), the rest masked"
        )
    return "every pixel is masked or not a number"


def _jitter_hint(result: FitResult) -> str:
    """A sentence where the jitter that the frame shows was left out."""
    found = result.estimate
    if result.locus != "stable" or found is None or not is_detected(found.moments, found.covariance):
        return ""
    size = f"{found.axes[0]:.2g} arcsec rms"
    return f"--locus stable leaves out jitter, of which the frame shows {size}: use --locus auto."


def _sky_hint(result: FitResult) -> str:
    """A sentence where the data lie above or below the model everywhere."""
    if result.residual is None:
        return ""
    if "background" in result.names:
        if result.parameters is None or not len(result.covariance):
            return ""
        level, error = float(result.parameters.background), result.error("background")
        if level > -_BELOW * error:
            return ""
        return f"The background is {level:.3g} electrons a pixel: the bias level may be too high (--bias)."
    mean, count = float(np.nanmean(result.residual)), int(np.isfinite(result.residual).sum())
    if abs(mean) * np.sqrt(count) < _OUTLIER:
        return ""
    side = "above" if mean > 0 else "below"
    return f"The frame lies {side} the model all over: leave out --no-background if there may be sky."


def scale_hint(frame: Frame, expected: float) -> str:
    """A sentence where a frame that does not fit has an unexpected plate scale."""
    known = frame.metadata.plate_scale
    if known is None or abs(known.value / expected - 1) < 0.01:
        return ""
    return (
        f"Its plate scale of {known.value:g} arcsec ({known.source}) is not the instrument's {expected:g}: "
        "give --plate-scale if it is wrong."
    )


def _outlier_hint(frame: Frame, result: FitResult) -> str:
    """A sentence where a few pixels are all that does not fit."""
    if result.residual is None:
        return ""
    size = np.nan_to_num(np.abs(result.residual))
    if result.image is not None:  # of few counts a Poisson law has a long tail
        size = np.where(result.image + frame.read_variance > _MANY, size, 0.0)
    outliers = size > _OUTLIER
    count, rest = int(outliers.sum()), float((size[~outliers] ** 2).sum())
    if not 0 < count <= 0.002 * size.size or rest > 1.2 * result.dof:
        return ""
    row, column = np.unravel_index(int(size.argmax()), size.shape)
    place = f"x = {frame.origin[0] + int(column)}, y = {frame.origin[1] + int(row)}"
    number = "One pixel stands" if count == 1 else f"{count} pixels stand"
    return (
        f"{number} out by more than {_OUTLIER:g} sigma (the worst at {place}) and the rest fits: give the "
        "instrument a map of its hot pixels."
    )
