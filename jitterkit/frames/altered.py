"""Pixels that do not hold what the detector read of the sky, as a program has scaled or filled them.

:func:`scaled_up` warns of few bits that were scaled to 16.  Programs shift 12 bits left by four, or stretch
them so that full scale becomes 65535; the gain in e-/ADU, the saturation and the bias of a data sheet are
then 16 times off.  :func:`outside_of_data` finds pixels outside of the sections that IRAF writes, and
:func:`without_border` masks those at the edges that have been filled.
"""

from __future__ import annotations

import itertools
import math
import re
from dataclasses import replace

import numpy as np

from jitterkit.frames.cards import Cards
from jitterkit.frames.frame import RawFrame
from jitterkit.frames.metadata import Metadata

_BITS = (8, 10, 12, 14)
"""Of the converters of cameras."""

_FULL = 65535

_FEW, _MANY = 1 << 12, 1 << 18
"""Pixels that are looked at, first and where these are scaled."""

_MOST_ODD, _FEWEST, _DISTINCT = 0.01, 64, 8
"""Share of pixels that a program has changed since, such as a stamp in the first row; pixels away from the
most frequent value, and different values among them, that show a step."""


_COMMON, _LEAST = 8, 3
"""Frequent values, of whose divisors one is the step, and the step from which pixels are warned of."""


def scaled_up(data: np.ndarray, metadata: Metadata, scale: float = 1.0) -> list[str]:
    """Warn of pixels that were scaled up, of which a gain may be that of the converter.

    Parameters
    ----------
    data : (ny, nx) array
    metadata : Metadata
        What the file says; pixels in electrons have no gain.
    scale : float
        ``BSCALE``, by which the stored numbers were multiplied as the file says.

    Returns
    -------
    warnings : list of str
        Empty for numbers that are no integers, use all 16 bits, or are too few or too alike to show it.

    Notes
    -----
    A mean of two frames of 12 bits, scaled by 16, is taken for one of 13.  Up to 1 % of the pixels may differ
    from the rule.
    """
    if metadata.value("unit", "adu") != "adu":
        return []
    stored = (data if scale == 1 else data / scale).ravel()
    for most in (_FEW, _MANY):
        sample = stored[:: max(1, stored.size // most)]
        finite = sample[np.abs(sample) < 2**53]
        values = finite[finite == np.rint(finite)]
        if not values.size or values.size < (1 - _MOST_ODD) * finite.size:
            return []
        numbers, counts = np.unique(values, return_counts=True)
        usual = numbers[np.argmax(counts)]
        other = values[values != usual].astype(np.int64)
        if other.size < _FEWEST:
            return []
        found = _scaling(other, int(usual), _BITS if values.min() >= 0 and values.max() <= _FULL else ())
        if found is None:
            return []
        factor, how = found
    said = f"pixels are {how}"
    if metadata.gain is None:
        return [f"{said}: divide a gain in e-/ADU that is of unscaled numbers by {factor:.6g} (--gain)"]
    gain, unscaled = metadata.gain, metadata.gain.value / factor
    own = f"{gain.source} = {gain.value:g} e-/ADU"
    return [f"{said}: if {own} is that of the unscaled numbers, give --gain {unscaled:g}"]


def _scaling(values: np.ndarray, usual: int, stretched: tuple[int, ...]) -> tuple[float, str] | None:
    """Return by what factor numbers were scaled, and how that shows, in words; None where nothing shows.

    They are those of fewer bits, of which ``stretched`` are possible, with the full scale of 16; or their
    differences from the most frequent one are multiples, from 3 on.
    """
    for bits in stretched:
        full, shift = (1 << bits) - 1, 16 - bits
        codes = np.rint(values * (full / _FULL)).astype(np.int64)
        if np.mean(values % (1 << shift) == 0) >= 1 - _MOST_ODD:
            break  # they are multiples
        upper = values >> shift
        repeated = (upper << shift) | (upper >> (bits - shift) if bits >= shift else upper)
        for made in (np.rint(codes * (_FULL / full)), repeated):
            same = made == values
            if same.mean() >= 1 - _MOST_ODD and len(np.unique(values[same])) >= _DISTINCT:
                return _FULL / full, f"those of {bits} bits stretched to 16"
    apart = values - usual
    numbers, counts = np.unique(apart, return_counts=True)
    common = numbers[np.argsort(counts)[-_COMMON:]]
    for step in sorted({math.gcd(*map(int, pair)) for pair in itertools.combinations(common, 2)})[::-1]:
        whole = apart % step == 0
        if whole.mean() >= 1 - _MOST_ODD and len(np.unique(apart[whole])) >= _DISTINCT:
            of_bits = f", as of {17 - step.bit_length()} bits scaled to 16" * (step & (step - 1) == 0)
            return (float(step), f"multiples of {step}{of_bits}") if step >= _LEAST else None
    return None


_SECTION = re.compile(r"\[\s*(\d+)\s*:\s*(\d+)\s*,\s*(\d+)\s*:\s*(\d+)\s*\]")

_LEAST_SHARE = 0.5
"""Share of the pixels that a section of data has at least."""

_CHANCE = 1e-6
"""Chance from which on a line of one value at the edge may be one of a frame."""


def outside_of_data(cards: Cards, shape: tuple[int, int]) -> tuple[np.ndarray | None, str]:
    """Find pixels without sky: outside of ``TRIMSEC``, ``DATASEC`` or ``RTDATSEC`` (ING), or in ``BIASSEC``.

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
    for key in ("TRIMSEC", "DATASEC", "RTDATSEC", "BIASSEC"):
        if (section := _SECTION.fullmatch(cards.text(key))) is None:
            continue
        x0, x1, y0, y1 = map(int, section.groups())
        (x0, x1), (y0, y1) = sorted((x0, x1)), sorted((y0, y1))
        outside = np.full(shape, key != "BIASSEC")
        outside[y0 - 1 : y1, x0 - 1 : x1] = key == "BIASSEC"
        is_of_image = x0 >= 1 and x1 <= shape[1] and y0 >= 1 and y1 <= shape[0]
        if not is_of_image or not 0 < outside.mean() <= _LEAST_SHARE:
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
    if not values or inside.size < _LEAST_SHARE * data.size:
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
