"""Maps: numbers of a detector that differ from pixel to pixel.

A number of a detector may be one for all pixels or a map ``(ny, nx)`` of the whole detector.
:func:`piece` takes what lies under a frame, :func:`nominal` the one number that stands for a map.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from jitterkit.errors import ErrorCode, FrameError

FLOATS = ("bias", "read_noise", "dark_current", "flat", "pixel_shift_x", "pixel_shift_y")
"""What of a detector may be a map of numbers."""

MAPS = (*FLOATS, "bad_pixels")
"""What of a detector may be a map."""

ONLY_MAPS = ("flat", "pixel_shift_x", "pixel_shift_y")
"""Of these, what must not be one number."""


def as_map(values: Any) -> Any:
    """Return a map as an array of floats (those of 32 bits stay), a number as one, None as None."""
    if values is None or np.ndim(values) == 0:
        return values
    array = np.asarray(values)
    return array if array.dtype == np.float32 else array.astype(float)


def nominal(values: np.ndarray | float | None) -> float | None:
    """Return the number that stands for a map: its median, of what is finite."""
    if values is None or np.ndim(values) == 0:
        return None if values is None else float(values)
    finite = np.asarray(values)[np.isfinite(values)]
    return float(np.median(finite)) if finite.size else None


def piece(
    name: str, values: np.ndarray | float, frame: str | Path, origin: tuple[int, int], shape: tuple[int, ...]
) -> np.ndarray | float:
    """Return what of a map lies under a frame.

    Parameters
    ----------
    name : str
        Of the map, a word of :data:`MAPS`.
    values : (ny, nx) array or float
        A number is handed back.
    frame : str or Path
        Named in complaints.
    origin : (int, int)
        ``(x0, y0)`` of the frame on the detector.
    shape : (int, int)
        ``(ny, nx)`` of the frame.

    Returns
    -------
    values : (ny, nx) array or float

    Raises
    ------
    FrameError
        If the map does not cover the frame.
    """
    if np.ndim(values) == 0:
        return values
    (x0, y0), (ny, nx) = origin, shape
    cut = np.asarray(values)[y0 : y0 + ny, x0 : x0 + nx]
    if cut.shape != shape:
        height, width = np.shape(values)
        last = f"column {x0 + nx - 1}, row {y0 + ny - 1}"
        what = "bad-pixel map" if name == "bad_pixels" else f"map {name}"
        problem = f"ends at {last}, beyond the {what} of {width} x {height}"
        remedy = "give a map of the whole detector, or none"
        raise FrameError(ErrorCode.WRONG_INSTRUMENT, frame, problem, remedy)
    return cut if cut.dtype == bool else cut.astype(float)
