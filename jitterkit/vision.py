"""The only door to OpenCV.

OpenCV silently returns garbage for big-endian arrays and refuses several types, so everything passes
:func:`native` first.  It is used for masks, components and smoothing, never for sub-pixel work:
``warpAffine`` is wrong by 0.01 to 0.06 pixels.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from jitterkit.errors import ErrorCode, JitterkitError

SUPPORTED = ("uint8", "uint16", "int16", "int32", "float32", "float64")


def native(image: np.ndarray) -> np.ndarray:
    """Return an image as OpenCV can take it.

    Parameters
    ----------
    image : (ny, nx) array
        Any real type, byte order and strides.

    Returns
    -------
    image : (ny, nx) array
        Native byte order and contiguous; the same object where it was so already.  Booleans become
        uint8, small integers keep their values in int16 or int32, and everything else float64.

    Raises
    ------
    JitterkitError
        If the image is not two-dimensional, is empty, or is not real.
    """
    array = np.asarray(image)
    if array.ndim != 2 or 0 in array.shape or array.dtype.kind not in "buif":
        code = ErrorCode.WRONG_SHAPE if array.dtype.kind in "buif" else ErrorCode.WRONG_TYPE
        problem = f"shape {array.shape} of type {array.dtype} is not an image"
        raise JitterkitError(code, f"{problem}; give real numbers, (ny, nx).")
    name = {"bool": "uint8", "int8": "int16"}.get(array.dtype.name, array.dtype.name)
    return np.ascontiguousarray(array, dtype=name if name in SUPPORTED else "float64")


def median_filter(image: np.ndarray, size: int) -> np.ndarray:
    """Return the running median over a square; borders are replicated.

    Parameters
    ----------
    image : (ny, nx) array
        uint8 and uint16 are filtered as they are, other types as float32.
    size : {3, 5}
        Side of the square [pixels].

    Raises
    ------
    JitterkitError
        If the size is another.
    """
    if size not in (3, 5):
        problem = f"a median over {size} x {size} pixels is not offered; use 3 or 5."
        raise JitterkitError(ErrorCode.OUT_OF_RANGE, problem)
    array = native(image)
    return cv2.medianBlur(array if array.dtype in (np.uint8, np.uint16) else array.astype(np.float32), size)


def box_mean(image: np.ndarray, size: int | tuple[int, int]) -> np.ndarray:
    """Return the running mean over a box; the image is mirrored at its borders.

    Parameters
    ----------
    image : (ny, nx) array
        Integers are averaged as float64.
    size : int or (int, int)
        Side of a square, or height and width [pixels]; the pixel with index ``size // 2`` gets the mean.
    """
    array = native(image)
    height, width = (size, size) if isinstance(size, int) else size
    return cv2.blur(array if array.dtype.kind == "f" else array.astype(np.float64), (width, height))


def bin_mean(image: np.ndarray, factor: int) -> np.ndarray:
    """Return the means of blocks of ``factor`` x ``factor`` pixels, the incomplete last ones left out."""
    array = native(image)
    ny, nx = array.shape[0] // factor, array.shape[1] // factor
    array = array if array.dtype.kind == "f" else array.astype(np.float64)
    return cv2.resize(array[: ny * factor, : nx * factor], (nx, ny), interpolation=cv2.INTER_AREA)


@dataclass(frozen=True, eq=False)
class Components:
    """Connected parts of a mask, numbered from 1; 0 is what belongs to none.

    Parameters
    ----------
    labels : (ny, nx) int32 array
    area : (n,) int array
        [pixels]
    box : (n, 4) int array
        ``x0, y0, nx, ny`` of each.
    centroid : (n, 2) float array
        ``x, y`` of each [pixels].
    """

    labels: np.ndarray
    area: np.ndarray
    box: np.ndarray
    centroid: np.ndarray


def components(mask: np.ndarray) -> Components:
    """Find the parts of a mask that hang together, corners included."""
    array = native(np.asarray(mask, dtype=bool))
    _, labels, stats, centroids = cv2.connectedComponentsWithStats(array, connectivity=8, ltype=cv2.CV_32S)
    return Components(labels, stats[1:, cv2.CC_STAT_AREA], stats[1:, :4], centroids[1:])
