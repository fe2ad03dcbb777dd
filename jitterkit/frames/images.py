"""Images of FITS files that need not be frames: kernels, pupils, point-spread functions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from jitterkit.frames.files import open_bytes
from jitterkit.frames.framefile import translated
from jitterkit.frames.hdus import find_images, walk
from jitterkit.frames.pixels import open_pixels
from jitterkit.frames.plainheader import PlainHeader

__all__ = ["NamedImage", "read_image", "read_images"]


@dataclass(frozen=True)
class NamedImage:
    """One image of a FITS file that need not be a frame: a pupil, a PSF.

    Parameters
    ----------
    hdu : int
    name : str
        EXTNAME in upper case; empty if there is none.
    pixels : (..., ny, nx) array
        float64, scaled; blank pixels are NaN.
    header : PlainHeader
        Of its own HDU.
    """

    hdu: int
    name: str
    pixels: np.ndarray
    header: PlainHeader


def read_images(path: Path) -> tuple[list[NamedImage], Mapping[str, Any]]:
    """Read every image of a file, with its name and header.

    Parameters
    ----------
    path : Path
        Plain, gzipped or tile-compressed.

    Returns
    -------
    images : list of NamedImage
        In the order of the file.
    header : PlainHeader
        Of the primary HDU.

    Raises
    ------
    FrameError
        If the file cannot be read.
    """
    with translated(path), open_bytes(path) as handle:
        hdus = list(walk(path, handle))
        arrays = [hdu for hdu in hdus if hdu.what.startswith("an array")]
        images = [NamedImage(a.number, a.name, open_pixels(a).everything(), a.header) for a in arrays]
        return images, hdus[0].header


def read_image(path: Path) -> tuple[np.ndarray, Mapping[str, Any]]:
    """Read the first image of a file as one array, which need not be a frame: a kernel, say.

    Parameters
    ----------
    path : Path
        Plain, gzipped or tile-compressed.

    Returns
    -------
    image : (..., ny, nx) array
        float64, scaled; blank pixels are NaN.
    header : PlainHeader
        Of the same HDU.

    Raises
    ------
    FrameError
        If there is no image, or the file cannot be read.
    """
    with translated(path), open_bytes(path) as handle:
        image = find_images(path, handle, None)[0][0].image
        return open_pixels(image).everything(), image.header
