"""The status of a frame and its flags, all decided here.

* :func:`status_from_exception`: whatever an error stopped.
* :func:`unusable`: a frame that shows too little to be fitted.
* :func:`diagnose`: a frame that was fitted.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from jitterkit.batch.records import SceneEstimate
from jitterkit.detectors import NORMALISED
from jitterkit.errors import ErrorCode, FrameError, JitterkitError, UndeterminedError, code_of
from jitterkit.frames import Frame
from jitterkit.kernel_estimate import is_detected
from jitterkit.likelihood import Data
from jitterkit.locate import resolution
from jitterkit.loci import covariance_on_axis, moments_on_axis
from jitterkit.metric import LARGE_FACTOR, error_factor
from jitterkit.optics import OTF
from jitterkit.optics.otf import PLATE_SCALE
from jitterkit.refit import FitResult, Status, single_star
from jitterkit.refit.boundary import minor_variance
from jitterkit.refit.evidence import is_intricate
from jitterkit.refit.lacking_wavefront import describe_lacking_wavefront
from jitterkit.refit.over_field import describe_field_variation
from jitterkit.scene import Binary, Stars


@dataclass(frozen=True)
class Limits:
    """Hold the limits between one status or flag and another."""

    side: int = 8
    """Pixels along a side below which a pair cannot be distinguished from one star."""
    used: int = 32
    """Usable pixels below which several pairs fit alike: of fits to 10 to 16 one in thirty was off by 20
    errors."""
    contrast: float = 100.0
    separation: float = 5.0
    """Contrast, and separation in resolutions, of a companion as errors of the optics make them: 15 to 17 nm
    made some of 330 to 510 at three resolutions."""
    further: float = 30.0
    """Ratio of light to a further star that may be no star, within that separation."""
    below: float = 5.0
    """Standard errors below zero from which a background, or a variance of the pointing, is none."""
    misfit: float = 5.0
    """Standard deviations of chi-squared from which a frame with a likely speckle for a star does not fit."""
    counts: float = 50.0
    """Electrons from which a Poisson law is nearly normal, so that an outlier can be recognised."""
    outlier: float = 6.0
    """Sigmas: chance makes one pixel in 1e9 stand out so far (in 3e7, of 50 electrons).  Where pixels sample
    the resolution, the fit of a star hides up to a third of what is wrong with a pixel of it: places that are
    off by four errors leave 6.8 sigmas."""
    along: float = 2.0
    """Degrees, beside three standard errors, within which a jitter is along the line through a pair."""
    of_a_motion: float = 4.0
    """Separation in resolutions up to which a pair may be one star that moved."""
    intricate: tuple[str, ...] = ("partial", "tones", "smear", "path")
    """Jitters of such a pair for which it may be one star that moved in another way.  Not ``shaped``: 10 of
    128 true pairs had it."""


LIMITS = Limits()


def status_from_exception(
    error: Exception, frame: Frame | None = None, plate_scale: float | None = None
) -> FitResult:
    """Map an exception to a result with the matching status.

    Parameters
    ----------
    error : Exception
        Raised while a frame was processed; errors of reading it are not among these.
    frame : Frame, optional
        For a hint where its plate scale is not the instrument's.
    plate_scale : float, optional
        The instrument's [arcsec]; None where there is no instrument, which a frame could not suit.

    Returns
    -------
    result : FitResult
        ``NO_STAR``, ``REFERENCE``, ``UNDETERMINED``, ``MISMATCH``, or else ``FAILED``.
    """
    code = code_of(error)
    if code is ErrorCode.NO_STAR and isinstance(error, FrameError | UndeterminedError):
        return FitResult.from_error(Status.NO_STAR, error)
    if isinstance(error, UndeterminedError):
        is_reference = code is ErrorCode.IS_REFERENCE
        return FitResult.from_error(Status.REFERENCE if is_reference else Status.UNDETERMINED, error)
    if plate_scale is None:
        return FitResult.from_error(Status.FAILED, error)
    if not isinstance(error, JitterkitError):
        return FitResult.from_error(Status.FAILED, error, f"{Status.FAILED.value}: {error}")
    hint = "" if frame is None else scale_hint(frame, plate_scale)
    return FitResult.from_error(Status.MISMATCH, error, f"{Status.MISMATCH.value}: {error} {hint}".rstrip())


def unusable(frame: Frame, data: Data) -> FitResult | None:
    """Return why a frame shows too little to be fitted; None for one that does not."""
    used = int(np.count_nonzero(np.asarray(data.used)))
    if not used:
        why, saturation = "every pixel is masked or not a number", frame.metadata.saturation
        if frame.saturated and saturation is not None:
            level = f"{saturation.value:g} ADU ({saturation.source})"
            why = f"{frame.saturated} of {frame.mask.size} pixels are saturated at {level}, the rest masked"
        return FitResult(Status.NO_DATA, f"{Status.NO_DATA.value}: {why}.")
    if min(frame.shape) < LIMITS.side:
        return FitResult(Status.NO_DATA, f"{frame.shape[1]} x {frame.shape[0]} pixels are too few for a fit.")
    if used < LIMITS.used:
        few = f"{used} usable pixels are too few for a fit; at least {LIMITS.used} are needed."
        return FitResult(Status.NO_DATA, few)
    return None


def diagnose(frame: Frame, found: SceneEstimate, result: FitResult, plate_scale: float) -> FitResult:
    """Add to a fit's result what only the frame and its fit together tell.

    Parameters
    ----------
    frame : Frame
    found : SceneEstimate
        Where the fit started.
    result : FitResult
    plate_scale : float
        The instrument's, arcsec.
    """
    result = _flag_further_stars(result, found.optics.nominal)
    p = result.parameters
    is_field = result.status.usable and p is not None and p.scene.name == Stars.name
    if p is not None and is_field and result.image is not None and result.residual is not None:
        data = found.data.without(~np.isfinite(result.residual))
        remark = describe_field_variation(p, found.optics.otf(p.aberrations), result.image, data)
        result = result.remarked(remark or "", "blur_varies")
    result = classify(frame, result, plate_scale, found)
    result = flag_faint_companion(result, found.optics.nominal)
    if result.status.usable and {"separation", PLATE_SCALE} <= set(result.names):
        factor = error_factor(result.covariance, *map(result.names.index, ("separation", PLATE_SCALE)))
        if factor > LARGE_FACTOR:
            times = f"{factor:.3g} times as large as with a known plate scale"
            result = result.remarked(f"The error of the separation is {times}.", "scale_degenerate")
    unsigned = [name for name in found.optics.system.nominal.blind() if name in result.names]
    if result.status.usable and unsigned:
        remark = f"The pupil is its own mirror image: {', '.join(unsigned)} may as well have the other sign"
        together = ", all of them together." if len(unsigned) > 1 else "."
        result = result.remarked(f"{remark}{together}", "sign_unknown")
    if not result.status.usable or "jitter_undetected" in result.flags:
        return result
    minor, error = minor_variance(*result.moments())
    # two still stars look as a straight jitter of one does, two of any jitter as an intricate one of one
    straight = not minor > LIMITS.below * error
    alike = straight or is_intricate(result.locus) or (p is not None and p.scene.name == Binary.name)
    return result.remarked(found.ambiguity, "maybe_pair") if alike else result


def classify(
    frame: Frame, result: FitResult, plate_scale: float, found: SceneEstimate | None = None
) -> FitResult:
    """Say why a frame does not fit where that can be determined, and that a pair is not one.

    Parameters
    ----------
    frame : Frame
    result : FitResult
    plate_scale : float
        The instrument's, arcsec.
    found : SceneEstimate, optional
        Where the fit started: with it, a wavefront error is looked for that explains the misfit.
    """
    if result.parameters is None:
        return result
    if result.status in (Status.OK, Status.NOT_CONVERGED) and single_star(result):
        message = f"{Status.NO_PAIR.value}: a second one is lost in its noise."
        return replace(result, status=Status.NO_PAIR, message=message)
    if problem := result.parameters.implausible(frame.shape, frame.plate_scale or plate_scale):
        message = f"{Status.POOR_FIT.value}: {problem}."
        return replace(result, status=Status.POOR_FIT, message=message, code=ErrorCode.IMPLAUSIBLE)
    outliers = _outlier_hint(frame, result)
    minor, error = minor_variance(*result.moments())
    is_narrow = result.status is not Status.POOR_FIT and minor < -LIMITS.below * error < 0
    narrow = TOO_NARROW.format(minor, error) if is_narrow else ""
    too_low = "misfit" in result.flags and result.chi2 < result.dof  # no wrong model does that
    if (outliers or narrow) and result.status is Status.OK and "misfit" not in result.flags:
        result = replace(result, flags=(*result.flags, "misfit"))
    if result.status is Status.POOR_FIT or "misfit" in result.flags:
        cause = TOO_LOW if too_low else scale_hint(frame, plate_scale)
        correlated = "noise_correlated" in result.flags
        cause = "" if correlated else cause
        if not (cause or correlated or found is None or result.model_error) and (
            wavefront := describe_lacking_wavefront(result, found.data, found.optics, found.otf)
        ):
            return replace(result, message=f"{result.message} {wavefront}")
        jitter = "" if cause or outliers else _jitter_hint(result)
        # the wings of a blur look like sky, and so does a wrong unit
        sky = "" if jitter or NORMALISED in frame.flags else _sky_hint(frame, result)
        hints = filter(None, (cause, outliers, jitter, narrow, sky))
        return replace(result, message=" ".join([result.message, *hints]))
    return result


TOO_LOW = (
    "It is less than chance allows, and errors are too large: check gain, read noise, bias and the unit of "
    "the pixels."
)
"""Remark on a chi-squared that is lower than noise alone leaves."""

TOO_NARROW = (
    "The stars are narrower than without jitter (variance {:.2g} ± {:.2g} arcsec²), as pixels "
    "that respond over less than their width make them, or a pupil larger than the instrument file says; "
    "the jitter is too small by as much."
)
"""Remark on a variance of the pointing below zero: it and its error, arcsec²."""


def flag_faint_companion(result: FitResult, otf: OTF) -> FitResult:
    """Add a remark to a result where a companion may as well be an error of the optics.

    If the frame does not fit with it either, its optics are not those of the instrument: ``POOR_FIT``.
    """
    contrast, separation = result.of_scene("contrast"), result.of_scene("separation")
    close = contrast > LIMITS.contrast and separation < LIMITS.separation * resolution(otf)
    if not (result.status.usable and close):
        return result
    found = f"{contrast:.3g} times fainter and {separation:.3g} arcsec away"
    if "misfit" in result.flags and result.chi2 - result.dof > LIMITS.misfit * math.sqrt(2 * result.dof):
        message = f"{Status.POOR_FIT.value}: chi²/dof is {result.chi2_dof:.4g} with a companion."
        result = replace(result, status=Status.POOR_FIT, message=message)
    return result.remarked(f"The companion, {found}, may be a speckle.", "faint_companion")


def flag_uneven_motion(result: FitResult, otf: OTF) -> FitResult:
    """Add a remark to a pair that may be one star that moved unevenly.

    Either its jitter is along its line: a drift that accelerates dwells at one end, as the brighter of two
    stars that drift along their line; a true pair has such a jitter by chance, in up to one frame of ten.  Or
    no simple motion of two stars describes the frame: then another motion of one may.
    """
    near = result.of_scene("separation") < LIMITS.of_a_motion * resolution(otf)
    if not (result.status.usable and near) or "jitter_undetected" in result.flags:
        return result
    if result.locus in LIMITS.intricate:
        remark = f"Two stars so close with the jitter {result.locus!r} may be one that moves in another way"
        advice = "compare --scene star --locus path"
        return result.remarked(f"{remark}; then place and jitter are wrong: {advice}.", "maybe_pair")
    theta, (moments, covariance) = result.of_scene("theta"), result.moments()
    (along, cross, across), own = moments_on_axis(moments, theta), covariance_on_axis(covariance, theta)
    longer, variance = along - across, own[0, 0] + own[2, 2] - 2 * own[0, 2]
    if not longer > LIMITS.below * math.sqrt(max(variance, 0.0)):
        return result
    turned, error = np.degrees([abs(cross) / longer, math.sqrt(max(own[1, 1], 0.0)) / longer])
    error = math.hypot(error, np.nan_to_num(result.error("theta")))
    if error > LIMITS.along or turned > LIMITS.along + 3 * error:
        return result
    remark = f"The jitter of both stars is along the line through them ({theta % 180:.3g} deg)"
    same = "one star that moves along it at a speed that changes looks the same"
    advice = "If it is one, place and jitter are wrong: try --scene star --locus path"
    return result.remarked(f"{remark}: {same}. {advice}.", "maybe_pair")


def scale_hint(frame: Frame, expected: float) -> str:
    """Return a sentence where a frame that does not fit has an unexpected plate scale."""
    known = frame.metadata.plate_scale
    if known is None or abs(known.value / expected - 1) < 0.01:
        return ""
    found = f"Its plate scale of {known.value:g} arcsec ({known.source}) is not the instrument's {expected:g}"
    return f"{found}: give --plate-scale if it is wrong."


def _flag_further_stars(result: FitResult, otf: OTF) -> FitResult:
    """Add a remark to a result where stars beside those of the scene were fitted."""
    scene = None if result.parameters is None else result.parameters.scene
    if scene is None or scene.others is None or isinstance(scene, Stars):
        return result
    x, y, flux = (np.asarray(part) for part in scene.sources())
    brightest = np.asarray(scene.others.flux).argmax() + len(x) - len(scene.others.x)
    fainter = "dark"
    if flux[brightest] > 0:
        fainter = f"{2.5 * np.log10(flux[0] / flux[brightest]):.2g} mag fainter than A"
    apart = np.hypot(x[brightest] - x[0], y[brightest] - y[0])
    count = len(scene.others.x)
    which = "the brightest " * (count > 1)
    remark = f"{count} further star{'s' * (count > 1)} fitted, {which}{fainter}, {apart:.3g} arcsec from it."
    near = np.hypot(x[:2] - x[brightest], y[:2] - y[brightest]) < LIMITS.separation * resolution(otf)
    if np.any(near & (flux[:2] > LIMITS.further * flux[brightest])):
        cause = "an error of the optics, or of pixels that do not respond in proportion to the light"
        remark = f"{remark} So near to a star it may be {cause}; then the jitter is wrong too."
    return result.remarked(remark, "further_stars")


def _jitter_hint(result: FitResult) -> str:
    """Return a sentence where the jitter that the frame shows was left out."""
    found = result.estimate
    if result.locus != "stable" or found is None or not is_detected(found.moments, found.covariance):
        return ""
    size = f"{found.axes[0]:.2g} arcsec rms"
    return f"--locus stable leaves out jitter, of which the frame shows {size}: use --locus auto."


def _sky_hint(frame: Frame, result: FitResult) -> str:
    """Return a sentence where the data lie above or below the model everywhere."""
    if result.residual is None:
        return ""
    if "background" in result.names:
        if result.parameters is None or result.image is None or not len(result.covariance):
            return ""
        level, error = float(result.parameters.background), result.error("background")
        if level > -LIMITS.below * error:
            return ""
        # the quarter of the pixels with the least modelled light, whose mean is as far below zero
        image = np.where(np.isfinite(result.residual), result.image, np.nan)
        dark = image <= np.nanquantile(image, 0.25)
        noise = max(np.sqrt(np.sum(np.broadcast_to(frame.read_variance, dark.shape)[dark])), 1.0)
        if np.sum(frame.electrons[dark]) / noise > -LIMITS.below:
            return ""
        return f"The background is {level:.3g} electrons a pixel: the bias level may be too high (--bias)."
    mean, count = float(np.nanmean(result.residual)), int(np.isfinite(result.residual).sum())
    if abs(mean) * np.sqrt(count) < LIMITS.outlier:
        return ""
    side = "above" if mean > 0 else "below"
    return f"The frame lies {side} the model all over: leave out --no-background if there may be sky."


def _outlier_hint(frame: Frame, result: FitResult) -> str:
    """Return a sentence where a few pixels are all that does not fit."""
    if result.residual is None:
        return ""
    size = np.nan_to_num(np.abs(result.residual))
    if result.image is not None:  # of few counts a Poisson law has a long tail
        size = np.where(result.image + frame.read_variance > LIMITS.counts, size, 0.0)
    outliers = size > LIMITS.outlier
    count, rest = int(outliers.sum()), float((size[~outliers] ** 2).sum())
    if not 0 < count <= 0.002 * size.size or rest > 1.2 * result.dof:
        return ""
    row, column = np.unravel_index(int(size.argmax()), size.shape)
    position = f"x = {frame.origin[0] + int(column)}, y = {frame.origin[1] + int(row)}"
    number = "One pixel stands" if count == 1 else f"{count} pixels stand"
    found = f"{number} out by more than {LIMITS.outlier:g} sigma (the worst at {position}) and the rest fits"
    return f"{found}: give the instrument a map of its hot pixels, unless it lies on a star."
