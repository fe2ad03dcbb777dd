"""Pixels of few bits that a program has scaled to 16: a gain of the converter is not theirs.

Reach for :func:`scaled_up`, which warns of them.  Programs shift 12 bits left by four, or stretch them so
that full scale becomes 65535; the gain in e-/ADU, the saturation and the bias of a data sheet are then 16
times off.
"""

from __future__ import annotations

import itertools
import math

import numpy as np

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
        stretched = _stretched(other) if values.min() >= 0 and values.max() <= _FULL else None
        found = stretched or _multiplied(other - int(usual))
        if found is None:
            return []
        factor, how = found
    said = f"pixels are {how}"
    if metadata.gain is None:
        return [f"{said}: divide a gain in e-/ADU that is of unscaled numbers by {factor:.6g} (--gain)"]
    gain, unscaled = metadata.gain, metadata.gain.value / factor
    own = f"{gain.source} = {gain.value:g} e-/ADU"
    return [f"{said}: if {own} is that of the unscaled numbers, give --gain {unscaled:g}"]


def _multiplied(apart: np.ndarray) -> tuple[float, str] | None:
    """Recognise numbers whose differences from the most frequent one are multiples, from 3 on.

    Returns by what factor the pixels were scaled, and how that shows, in words.
    """
    numbers, counts = np.unique(apart, return_counts=True)
    common = numbers[np.argsort(counts)[-_COMMON:]]
    for step in sorted({math.gcd(*map(int, pair)) for pair in itertools.combinations(common, 2)})[::-1]:
        whole = apart % step == 0
        if whole.mean() >= 1 - _MOST_ODD and len(np.unique(apart[whole])) >= _DISTINCT:
            bits = f", as of {17 - step.bit_length()} bits scaled to 16" * (step & (step - 1) == 0)
            return (float(step), f"multiples of {step}{bits}") if step >= _LEAST else None
    return None


def _stretched(numbers: np.ndarray) -> tuple[float, str] | None:
    """Recognise numbers from 0 to 65535 that are those of fewer bits with the same full scale, likewise."""
    for bits in _BITS:
        full, shift = (1 << bits) - 1, 16 - bits
        codes = np.rint(numbers * (full / _FULL)).astype(np.int64)
        if np.mean(numbers % (1 << shift) == 0) >= 1 - _MOST_ODD:
            return None  # they are multiples
        upper = numbers >> shift
        repeated = (upper << shift) | (upper >> (bits - shift) if bits >= shift else upper)
        for made in (np.rint(codes * (_FULL / full)), repeated):
            same = made == numbers
            if same.mean() >= 1 - _MOST_ODD and len(np.unique(numbers[same])) >= _DISTINCT:
                return _FULL / full, f"those of {bits} bits stretched to 16"
    return None
