"""What a detector adds to the knowledge about a frame: numbers, and the end of the range.

:func:`supplement` lays a number under what the frame says of itself, by the ranks of
:mod:`jitterkit.frames.metadata`; :func:`ceiling` finds the level that ends the range;
:func:`own` decides between a detector's map and the one number that a frame's metadata can hold.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from jitterkit.detectors.characteristics import Characteristics
from jitterkit.detectors.response import measured
from jitterkit.errors import ErrorCode, FrameError
from jitterkit.frames.metadata import Metadata, Sourced

ASSUMED: Mapping[str, float] = {"gain": 1.0, "read_noise": 0.0, "bias": 0.0}
"""What is taken where nobody says: a counter of electrons without noise."""

WELL_MARGIN = 5.0
"""Read-out sigmas below the full well from which a pixel counts as full: one in 3 million escapes."""

SAME = 1e-6
"""Relative difference below which two numbers are one: what a header's decimals leave."""


def supplement(metadata: Metadata, name: str, value: Any, source: str) -> Metadata:
    """Add a value to what is known about a frame, unless somebody as authoritative has spoken.

    Of two sources of one rank the one already there is heard: a frame is nearer to itself.
    """
    present: Sourced | None = getattr(metadata, name)
    if present is not None and present.precedence <= Sourced(value, "", source).precedence:
        return metadata
    return metadata.override(source, **{name: value})


def ceiling(detector: Characteristics, metadata: Metadata) -> tuple[str, float]:
    """Return the lowest level that ends the range, ADU, and which of a detector's numbers sets it."""
    gain, noise, bias = (metadata.value(name) for name in ASSUMED)
    levels = {"saturation": detector.saturation if detector.saturation is not None else math.inf}
    levels["bits"] = detector.largest
    well = detector.full_well
    if well is not None:
        margin, shown = min(WELL_MARGIN * (noise**2 + gain**2 / 12) ** 0.5, well / 2), well
        if detector.nonlinearity is not None:
            shown = float(measured(np.asarray(well), detector.nonlinearity, well))
        levels["full_well"] = bias + (shown - margin) / gain
    name = min(levels, key=lambda key: levels[key])
    return name, levels[name]


def own(detector: Characteristics, name: str, metadata: Metadata) -> np.ndarray | float:
    """Return a number of a frame: the detector's map where the metadata hold that map's nominal value."""
    value, stated, nominal = getattr(detector, name), metadata.value(name), detector.nominal(name)
    is_map = np.ndim(value) and nominal is not None and math.isclose(stated, nominal, rel_tol=SAME)
    return value if is_map else stated


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
