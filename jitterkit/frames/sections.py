"""Pixels that did not see the sky: outside of the sections that IRAF writes, or filled by a program."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from jitterkit.frames.cards import Cards
from jitterkit.frames.frame import RawFrame

_SECTION = re.compile(r"\[\s*(\d+)\s*:\s*(\d+)\s*,\s*(\d+)\s*:\s*(\d+)\s*\]")

_LEAST = 0.5
"""Share of the pixels that a section of data has at least."""

_CHANCE = 1e-6
"""Chance from which on a line of one value at the edge may be one of a frame."""


def outside_of_data(cards: Cards, shape: tuple[int, int]) -> tuple[np.ndarray | None, str]:
    """Find pixels that hold no sky: those outside of ``TRIMSEC`` or ``DATASEC``, or in ``BIASSEC``.

    Parameters
    ----------
    cards : Cards
    shape : (int, int)
        ``(ny, nx)`` of the image as stored.

    Returns
    -------
    outside : (ny, nx) bool array or None
        None where all pixels are data.
    warning : str
        Empty where all pixels are data.

    Notes
    -----
    The first of them decides.  If it does not lie in the image, that was trimmed later, and none counts.
    """
    for key in ("TRIMSEC", "DATASEC", "BIASSEC"):
        if (section := _SECTION.fullmatch(cards.text(key))) is None:
            continue
        x0, x1, y0, y1 = map(int, section.groups())
        (x0, x1), (y0, y1) = sorted((x0, x1)), sorted((y0, y1))
        outside = np.full(shape, key != "BIASSEC")
        outside[y0 - 1 : y1, x0 - 1 : x1] = key == "BIASSEC"
        is_of_image = x0 >= 1 and x1 <= shape[1] and y0 >= 1 and y1 <= shape[0]
        if not is_of_image or not 0 < outside.mean() <= _LEAST:
            break
        return outside, f"{key} = {section[0]!r}: {int(outside.sum())} pixels hold no sky and are masked"
    return None, ""


def without_border(raw: RawFrame) -> RawFrame:
    """Mask rows and columns at the edges that a program has filled with one value, with a warning.

    Parameters
    ----------
    raw : RawFrame

    Returns
    -------
    raw : RawFrame
        The same pixels.

    Notes
    -----
    A line of one value is chance where many pixels inside have that value too, or many of those next to the
    border, as around a star of few photons, and is kept.
    """
    data, inside = raw.data, raw.data
    ends, values = [0, data.shape[0], 0, data.shape[1]], set()
    side = kept = 0
    while kept < 4 and min(inside.shape) > 1:  # a border on one side hides those of the others
        line = (inside[0], inside[-1], inside[:, 0], inside[:, -1])[side]
        if (line == line[0]).all():
            ends[side] += (1, -1)[side % 2]
            values.add(float(line[0]))
            kept = 0
        else:
            side, kept = (side + 1) % 4, kept + 1
        inside = data[ends[0] : ends[1], ends[2] : ends[3]]
    if not values or inside.size < _LEAST * data.size:
        return raw
    ring = np.concatenate([inside[0], inside[-1], inside[:, 0], inside[:, -1]])
    parts = (inside, ring)
    shares = (max(np.mean(part == value) for part in parts) ** min(inside.shape) for value in values)
    border = np.ones(data.shape, bool)
    border[ends[0] : ends[1], ends[2] : ends[3]] = False
    if max(shares) * sum(data.shape) > _CHANCE or raw.mask[border].all():
        return raw
    shown = ", ".join(f"{value:g}" for value in sorted(values)[:3])
    said = f"{int(border.sum())} pixels in rows or columns of {shown} at the edges are masked"
    return replace(raw, mask=raw.mask | border, metadata=raw.metadata.warn(said))
