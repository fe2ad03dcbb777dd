"""Pupils and star images, made only when an instrument's optics are first asked for.

Making one loads JAX, and TOLIMAN's takes seconds; ``jitterkit info`` needs neither.
"""

from __future__ import annotations

import logging
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.frames import open_frames

if TYPE_CHECKING:
    from jitterkit.optics.pupil import Pupil

_LOG = logging.getLogger(__name__)

_STEPS = 1000
"""Fewest whole numbers from dark to peak: of 255, moments were off by nine errors of 3e5 electrons."""

_SHARE, _FALLEN = 0.01, 0.7
"""Share of the light that a level as at the edge would have, and ratio of the edge to what lies a quarter of
the way to the middle, from which it is no star's wing: one that falls with the distance squared has 0.56."""


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


def star(path: Path, hdu: int | None = None) -> np.ndarray:
    """Read a star image ``(ny, nx)`` from a FITS or TIFF file, less the bias that its header names.

    Raises
    ------
    ConfigurationError
        If a pixel of it is masked, or :func:`check_star` refuses it.
    FrameError
        If it cannot be read.
    """
    with open_frames(path, hdu=hdu) as frames:
        frame = frames[0]
    if frame.mask.any():
        problem = f"{path}: {int(frame.mask.sum())} pixels of the star have no value"
        raise ConfigurationError(ErrorCode.MISSING_VALUE, f"{problem}; interpolate over them first.")
    image = frame.data - frame.metadata.value("bias", 0.0)
    check_star(path, image)
    return image


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
        raise ConfigurationError(
            ErrorCode.SAMPLING,
            f"{path}: the star has {steps.max():g} steps from dark to bright, which cut its wings; "
            "give it in 16 bits, exposed for longer, or as the mean of several frames.",
        )
    if not image.sum() > 0:
        problem = f"{path}: the star's image sums to {image.sum():.4g}, and must be positive"
        raise ConfigurationError(
            ErrorCode.OUT_OF_RANGE, f"{problem}; subtract the background level, not more."
        )
    edge = _edge(image)
    if edge * image.size > image.sum() / 3:
        raise ConfigurationError(
            ErrorCode.OUT_OF_RANGE,
            f"{path}: the edge of the star's image stands at {edge:g}, so that a third or more of its sum is "
            "background; subtract it.",
        )
    ny, nx = image.shape
    inside = _edge(image[ny // 8 : ny - ny // 8, nx // 8 : nx - nx // 8])
    share = edge * image.size / (image.sum() - edge * image.size)
    if abs(share) > _SHARE and abs(edge) > _FALLEN * abs(inside):
        _LOG.warning(
            "%s: the star's image does not fall towards its edge, which stands at %.3g: if that is "
            "background, fluxes are wrong by %.0f %%; subtract it.", path, edge, 100 * share
        )  # fmt: skip


def _edge(image: np.ndarray) -> float:
    """Return the median of the outermost pixels."""
    return float(np.median(np.concatenate([image[0], image[-1], image[:, 0], image[:, -1]])))
