"""Pupils and star images, made only when an instrument's optics are first asked for.

Making one loads JAX, and TOLIMAN's takes seconds; ``jitterkit info`` needs neither.
"""

from __future__ import annotations

import logging
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from jitterkit.errors import ConfigurationError, ErrorCode, FrameError
from jitterkit.frames import open_frames
from jitterkit.frames.cut_off import with_cut_off

if TYPE_CHECKING:
    from jitterkit.optics.pupil import Pupil

_LOG = logging.getLogger(__name__)

_STEPS = 1000
"""Fewest whole numbers from dark to peak: of 255, moments were off by nine errors of 3e5 electrons."""

_SHARE, _FALLEN = 0.01, 0.7
"""Share of the light that a level as at the edge would have, and ratio of the edge to what lies a quarter of
the way to the middle, from which it is no star's wing: one that falls with the distance squared has 0.56."""

_SAME, _CUT, _POWERS = 0.01, 0.02, (2.5, 4.0)
"""Relative difference of two scales, share of the light that may be cut off, and powers of the distance with
which wings fall: of a hard aperture with the third."""


def toliman(**options: int) -> Pupil:
    """Make TOLIMAN's diffractive pupil; see :func:`jitterkit.optics.toliman.toliman_pupil`."""
    from jitterkit.optics.toliman import toliman_pupil

    return toliman_pupil(**options)


def jwst() -> Pupil:
    """Draw a pupil like JWST's; see :func:`jitterkit.optics.observatories.jwst_pupil`."""
    from jitterkit.optics.observatories import jwst_pupil

    return jwst_pupil()


def hst() -> Pupil:
    """Draw a pupil like Hubble's; see :func:`jitterkit.optics.observatories.hst_pupil`."""
    from jitterkit.optics.observatories import hst_pupil

    return hst_pupil()


def plain(diameter: float, obscuration: float = 0.0, **options: Any) -> Pupil:
    """Make an obstructed circle; see :func:`jitterkit.optics.pupil.obstructed_circle`."""
    from jitterkit.optics.pupil import obstructed_circle

    return obstructed_circle(diameter, obscuration, **options)


def from_file(path: Path, diameter: float | None = None) -> Pupil:
    """Read a pupil; see :func:`jitterkit.optics.pupil_file.read_pupil`."""
    from jitterkit.optics.pupil_file import read_pupil

    return read_pupil(path, diameter)


def star(
    path: Path, hdu: int | None = None, pitch: float | None = None, *, whole: bool = True, oversample: int = 1
) -> np.ndarray:
    """Read a star image ``(ny, nx)`` from a FITS or TIFF file, less the bias that its header names.

    Parameters
    ----------
    path : Path
    hdu : int, optional
    pitch : float, optional
        arcsec that a sample is said to be wide; a header that contradicts it is warned of.
    whole : bool
        Whether the image is taken to hold all light; if much lies beyond its edge, that is warned of.
    oversample : int
        Samples per pixel and axis that it is said to have.

    Raises
    ------
    ConfigurationError
        If a pixel of it is masked or saturated, its samples are light at points, its header says another
        oversampling, or :func:`check_star` refuses it.
    FrameError
        If it cannot be read, or is not one image.
    """
    with open_frames(path, hdu=hdu) as frames:
        frame, count, points, samples = frames[0], len(frames), *map(frames.text, ("DET_SAMP", "OVERSAMP"))
    if count > 1:
        problem, remedy = (
            f"holds {count} images, and a PSF is one",
            "choose its hdu, or write one of the planes",
        )
        raise FrameError(ErrorCode.WRONG_SHAPE, path, problem, remedy)
    if points:
        problem = f"{path}: has the light at points, by DET_SAMP = {points}, and not that of whole pixels"
        raise ConfigurationError(ErrorCode.SAMPLING, f"{problem}; convert it by 'jitterkit instrument'.")
    if _is_number(samples) and float(samples) != oversample:
        problem = f"{path}: has OVERSAMP = {samples}, and oversample of [psf] is {oversample}"
        raise ConfigurationError(ErrorCode.CONFLICT, f"{problem}; correct one of them.")
    if frame.mask.any():
        problem = f"{path}: {int(frame.mask.sum())} pixels of the star have no value"
        raise ConfigurationError(ErrorCode.MISSING_VALUE, f"{problem}; interpolate over them first.")
    level = with_cut_off(frame).metadata.value("saturation")
    if level is not None and frame.data.max() >= level:
        problem = f"{path}: the star is cut off at {level:g}, where pixels are saturated"
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, f"{problem}; give one that was exposed for less.")
    image = frame.data - frame.metadata.value("bias", 0.0)
    check_star(path, image)
    scale = frame.metadata.plate_scale
    if scale is not None and pitch is not None and abs(scale.value / pitch - 1) > _SAME:
        _LOG.warning(
            "%s: a sample is %.4g arcsec wide by its %s, and %.4g by plate_scale and oversample, which are "
            "used.", path, scale.value, scale.source, pitch
        )  # fmt: skip
    beyond = _beyond(image)
    if whole and beyond > _CUT:
        _LOG.warning(
            "%s: about %.0f %% of the star's light lie beyond the edge, so that fluxes are too small; say "
            "enclosed, the share inside.", path, 100 * beyond
        )  # fmt: skip
    return image


def _is_number(text: str) -> bool:
    try:
        return float(text) > 0
    except ValueError:
        return False


def check_star(path: Path, image: np.ndarray) -> None:
    """Refuse a star image of few steps or with a pedestal, and warn of a small background.

    Raises
    ------
    ConfigurationError
        If it has fewer than 1000 whole numbers from dark to bright, its sum is not positive, or its edge
        would hold a third of all its light.
    """
    steps = image - image.min()
    if np.all(steps == np.rint(steps)) and 0 < steps.max() < _STEPS:
        problem = f"{path}: the star has {steps.max():g} steps from dark to bright, which cut its wings"
        remedy = "give it in 16 bits, exposed for longer, or as the mean of several frames"
        raise ConfigurationError(ErrorCode.SAMPLING, f"{problem}; {remedy}.")
    if not image.sum() > 0:
        problem = f"{path}: the star's image sums to {image.sum():.4g}, and must be positive"
        message = f"{problem}; subtract the background level, not more."
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, message)
    edge = _edge(image)
    if edge * image.size > image.sum() / 3:
        problem = f"{path}: the edge of the star's image stands at {edge:g}"
        found = "so that a third or more of its sum is background; subtract it"
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, f"{problem}, {found}.")
    ny, nx = image.shape
    inside = _edge(image[ny // 8 : ny - ny // 8, nx // 8 : nx - nx // 8])
    share = edge * image.size / (image.sum() - edge * image.size)
    if abs(share) > _SHARE and abs(edge) > _FALLEN * abs(inside):
        _LOG.warning(
            "%s: the star's image does not fall towards its edge, which stands at %.3g: if that is "
            "background, fluxes are wrong by %.0f %%; subtract it.", path, edge, 100 * share
        )  # fmt: skip


def _beyond(image: np.ndarray) -> float:
    """Return the share of the light outside, if a wing goes on to fall as it does towards the edge."""
    ny, nx = image.shape
    edge, inside = _edge(image), _edge(image[ny // 8 : ny - ny // 8, nx // 8 : nx - nx // 8])
    if not 0 < edge < _FALLEN * inside:
        return 0.0
    power = np.clip(np.log(inside / edge) / np.log(4 / 3), *_POWERS)
    outside = 0.5 * np.pi * edge * image.size / (power - 2)
    return float(outside / (image.sum() + outside))


def _edge(image: np.ndarray) -> float:
    """Return the median of the outermost pixels."""
    return float(np.median(np.concatenate([image[0], image[-1], image[:, 0], image[:, -1]])))
