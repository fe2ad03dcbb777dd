"""Pupils and star images, made only when an instrument's optics are first asked for.

Making one loads JAX, and TOLIMAN's takes seconds; ``jitterkit info`` needs neither.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.frames import open_frames

if TYPE_CHECKING:
    from jitterkit.optics.pupil import Pupil


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
        If a pixel of it is masked, or a pedestal is left under the star: its edge would hold a third of
        all its light.
    FrameError
        If it cannot be read.
    """
    with open_frames(path, hdu=hdu) as frames:
        frame = frames[0]
    if frame.mask.any():
        problem = f"{path}: {int(frame.mask.sum())} pixels of the star have no value"
        raise ConfigurationError(ErrorCode.MISSING_VALUE, f"{problem}; interpolate over them first.")
    image = frame.data - frame.metadata.value("bias", 0.0)
    edge = np.median(np.concatenate([image[0], image[-1], image[:, 0], image[:, -1]]))
    if edge * image.size > image.sum() / 3:
        raise ConfigurationError(
            ErrorCode.OUT_OF_RANGE,
            f"{path}: the edge of the star's image stands at {edge:g}, so that a third or more of its sum is "
            "background; subtract it.",
        )
    return image
