"""The blur of a field of stars: one kernel for all of them, and what made it.

Reach for :func:`estimate_field`.  With a sharp frame of the same telescope it measures the trail itself:
the sharp stars' mean stands for the optics, and a line is fitted to every trailed star at once.  Without
one it measures the stars' second moments, and the length of the trail only on the condition that a
star would be round without it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from jitterkit.conventions import axis_angle
from jitterkit.errors import ConfigurationError, ErrorCode, UndeterminedError, positive
from jitterkit.frames import Frame
from jitterkit.kernel_estimate import KernelEstimate
from jitterkit.loci import axis_variances
from jitterkit.starfield.certainty import growing, not_linear
from jitterkit.starfield.detect import find_stars
from jitterkit.starfield.field_pattern import FieldPattern, classify_field
from jitterkit.starfield.moments import adaptive_moments
from jitterkit.starfield.psf import Psf, common_moments, field_psf
from jitterkit.starfield.trail import trail_against, trail_alone

_NO_PATTERN = ("smear", "round", "undetermined")
"""Patterns that say nothing of optics, and nothing where stars are as sharp as the reference's."""

_AS_SHARP = "sharp: the frame is as sharp as the reference, within the noise of both."


@dataclass(frozen=True, eq=False)
class FieldEstimate:
    """A blur as a field of stars shows it.

    Attributes
    ----------
    kernel : KernelEstimate
        Of the pointing, common to all stars; its ``undetermined`` says where it is no trail's.
    length, length_err : float
        Of a uniform line [arcsec]; NaN where the frame is as sharp as the reference.
    angle, angle_err : float
        Of its axis [deg].
    conditional : bool
        True without a reference: the length then holds if the stars are round without the trail.
    moment_length : float
        Length of the line whose variance is the difference of the stars' adaptive variances along and
        across, ``sqrt(12 (major - minor))`` [arcsec].  The weight follows the star, so that it overstates
        lines of 2 to 6 pixels by 3 to 16 %; but it knows of no model of the core.
    x, y : (n,) array
        Places of the stars [pixels].
    moments, errors : (n, 3) array
        Adaptive second moments of each star, pixel and optics included, with errors [arcsec²].
    used : (n,) bool array
        Stars that went into the estimate; the rest disagree with all others.
    common, common_covariance : (3,) and (3, 3) array
        The moments that the stars have in common; noise and scatter from star to star are in the errors.
    variation : (float, int)
        Chi-squared and degrees of freedom of one blur for the whole field.
    pattern : FieldPattern
        Tracking or optics.
    remarks : tuple of str
        Conditions and remarks, in sentences.
    """

    kernel: KernelEstimate
    length: float
    length_err: float
    angle: float
    angle_err: float
    conditional: bool
    moment_length: float
    x: np.ndarray
    y: np.ndarray
    moments: np.ndarray
    errors: np.ndarray
    used: np.ndarray
    common: np.ndarray
    common_covariance: np.ndarray
    variation: tuple[float, int]
    pattern: FieldPattern
    remarks: tuple[str, ...]


def estimate_field(
    frame: Frame, *, reference: Frame | Psf | None = None, plate_scale: float | None = None
) -> FieldEstimate:
    """Estimate the blur that the stars of a field share.

    Parameters
    ----------
    frame : Frame
        The trailed frame, in electrons; ``Frame(pixels, 0.0)`` makes one of an array.
    reference : Frame or Psf, optional
        A sharp frame of the same telescope, focus and seeing (not necessarily of the same stars), or
        the PSF made of one.
    plate_scale : float, optional
        [arcsec/pixel]; the frame's if omitted, and one where it has none: results are then in pixels.

    Returns
    -------
    estimate : FieldEstimate

    Raises
    ------
    UndeterminedError
        If no isolated star can be measured, the reference is blurrier than the frame, or the model of a
        trail says nothing about the stars.
    ConfigurationError
        If the plate scale is not positive, or the reference has another one.

    Notes
    -----
    *Assumes* one PSF over the field for the kernel (the pattern says whether that is so), and a detector
    that resolves it (FWHM above two pixels).  Electrons matter: they set the weights and the noise of
    bright stars.  In other units errors are right only so far as scatter from star to star makes them.
    """
    scale = plate_scale if plate_scale is not None else (frame.plate_scale or 1.0)
    positive("plate_scale", scale, "arcsec/pixel")
    stars = find_stars(frame)
    moments = adaptive_moments(stars)
    common = common_moments(moments)
    psf = None if isinstance(reference, Frame) else reference
    if isinstance(reference, Frame):
        refuse_other_pixels(reference, frame)
        psf = field_psf(reference, half=stars.electrons.shape[-1] // 2)  # as wide as the trailed stars
    trail = trail_alone(stars, moments, common) if psf is None else trail_against(psf, stars, moments, common)
    area, (ny, nx), sound = scale**2, stars.frame_shape, common.used
    pattern = classify_field(
        stars.x[sound] - (nx - 1) / 2,
        stars.y[sound] - (ny - 1) / 2,
        moments.moments[sound] - (0.0 if psf is None else psf.moments),
        moments.covariance[sound],
        shared=None if psf is None else psf.covariance,
        direction=(trail.angle, trail.angle_err),
    )
    if trail.locus is None and pattern.kind in _NO_PATTERN:
        pattern = replace(pattern, kind="sharp", sentence=_AS_SHARP)
    major, minor, _ = axis_variances(common.moments)
    stretched = "" if trail.locus is None else not_linear(moments, sound)
    kernel = KernelEstimate(
        trail.moments * area,
        trail.covariance * area**2,
        "starfield",
        frame.name,
        locus=None if trail.locus is None else trail.locus.at(trail.locus.coords * area),
        undetermined=trail.undetermined or stretched,
    )
    return FieldEstimate(
        kernel=kernel,
        length=trail.length * scale,
        length_err=trail.length_err * scale,
        angle=axis_angle(trail.angle),
        angle_err=trail.angle_err,
        conditional=psf is None,
        moment_length=float(np.sqrt(12 * (major - minor))) * scale,
        x=stars.x,
        y=stars.y,
        moments=moments.moments * area,
        errors=np.sqrt(np.einsum("nii->ni", moments.covariance)) * area,
        used=trail.used,
        common=common.moments * area,
        common_covariance=common.covariance * area**2,
        variation=trail.variation,
        pattern=pattern,
        remarks=trail.remarks if stretched else (*growing(moments, sound), *trail.remarks),
    )


def refuse_other_pixels(reference: Frame, frame: Frame) -> None:
    """Raise ConfigurationError if a reference has another plate scale than a frame, where both are known."""
    scales = frame.plate_scale, reference.plate_scale
    if None not in scales and not np.isclose(*scales, rtol=0.01):  # type: ignore[arg-type]
        problem = f"The reference has {scales[1]} arcsec per pixel and the frame {scales[0]}"
        remedy = "give a reference on the same pixels"
        raise ConfigurationError(ErrorCode.WRONG_INSTRUMENT, f"{problem}; {remedy}.")


def roundest(frames: Sequence[Frame]) -> int:
    """Index of the frame of a set whose stars are sharpest, to serve as the others' reference.

    Parameters
    ----------
    frames : sequence of Frame
        Of one telescope and focus.

    Returns
    -------
    index : int
        The frame whose common moments have the smallest major axis: neither trailed nor soft.

    Raises
    ------
    UndeterminedError
        If no frame has an isolated star that can be measured.
    """
    sizes = []
    for frame in frames:
        try:
            sizes.append(axis_variances(common_moments(adaptive_moments(find_stars(frame))).moments)[0])
        except UndeterminedError:
            sizes.append(np.inf)
    if not sizes or not np.isfinite(min(sizes)):
        problem = f"No isolated star is seen in any of {len(sizes)} frames; give sharper ones."
        raise UndeterminedError(ErrorCode.TOO_FEW_STARS, problem)
    return int(np.argmin(sizes))
