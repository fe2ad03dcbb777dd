"""From the unit in which a frame's pixels are stored to counts, ADU or electrons."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from jitterkit.errors import ErrorCode, FrameError
from jitterkit.frames.frame import RawFrame
from jitterkit.frames.metadata import RANKS, Known
from jitterkit.frames.units import COUNTS, RATES

GUESSED = ("preset", "assumed")
"""How the sources begin of numbers that nobody said of this frame or camera."""

NORMALISED = (
    "the pixels are floats from 0 to 1, as Siril and PixInsight write, neither ADU nor electrons: errors and "
    "chi-squared are not valid; use the frame before it was normalised"
)
"""Remark on a frame of which :func:`is_normalised` is true."""


def in_counts(raw: RawFrame) -> RawFrame:
    """Return a frame whose pixels are counts.

    Parameters
    ----------
    raw : RawFrame
        In ADU or electrons, or in either per second.

    Returns
    -------
    counts : RawFrame
        Rates are multiplied by the exposure; of rates in ADU the bias is taken to be subtracted.

    Raises
    ------
    FrameError
        If the unit is another (code ``unknown_unit``), or a rate has no exposure.
    """
    unit, known = raw.unit, raw.metadata.unit
    if unit in COUNTS or known is None:
        return raw
    where = raw.path or raw.name
    if unit not in RATES:
        raise FrameError(
            ErrorCode.UNKNOWN_UNIT,
            where,
            f"has pixels in {unit} ({known.source}), which is neither ADU nor electrons",
            "convert them to ADU or electrons, or correct the unit",
        )
    exposure = raw.metadata.exposure
    if exposure is None or exposure.value == 0 or exposure.source.startswith(GUESSED):
        raise FrameError(
            ErrorCode.MISSING_VALUE,
            where,
            f"has pixels in {unit} ({known.source}), and its exposure is not known",
            "give --exposure, in s",
        )
    counted = Known(unit.removesuffix("/s"), "", f"{known.source} in {unit} times {exposure.source}")
    metadata = raw.metadata.override(counted.source, unit=counted)
    bias = metadata.bias
    if counted.value == "adu" and (bias is None or bias.rank >= RANKS.index("instrument file")):
        metadata = metadata.override("argument, as the pixels are a rate", bias=0.0)
    variance = None if raw.variance is None else raw.variance * exposure.value**2
    return replace(raw, data=raw.data * exposure.value, variance=variance, metadata=metadata)


def is_normalised(raw: RawFrame) -> bool:
    """Return whether pixels that count as ADU are fractions of full scale: floats from 0 to 1.

    Parameters
    ----------
    raw : RawFrame
    """
    good = raw.data[~raw.mask]
    if raw.unit != "adu" or not good.size or good.min() < 0 or not 0 < good.max() <= 1:
        return False
    return not np.array_equal(good, np.rint(good))
