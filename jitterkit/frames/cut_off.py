"""Pixels that all have the largest number of a frame: light was lost there, whatever the header says.

Reach for :func:`with_cut_off`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import ndimage

from jitterkit.frames.frame import RawFrame
from jitterkit.frames.metadata import PRECEDENCE, Sourced
from jitterkit.frames.units import COUNTS

_FEWEST, _LARGEST_SHARE = 3, 0.25
"""Adjoining pixels of one value, and their share of a frame, beyond which they are no core of a star."""

_ALIKE = 0.5
"""Share of different values around them up to which an image has no noise, and is equal by its symmetry."""

_ROUNDING = 1e-6
"""Share of the largest number by which two numbers of a computed image may differ that are equal."""

_CHANCE = 1e-6
"""Chance from which on a few equal pixels may be those of a top that was not cut off."""

_AROUND = np.ones((3, 3), bool)


def with_cut_off(raw: RawFrame) -> RawFrame:
    """Take the largest number of a frame as its saturation level, where a core of a star is cut off there.

    Parameters
    ----------
    raw : RawFrame

    Returns
    -------
    raw : RawFrame
        With that level and a warning; as given where its level is known to be as low, or no core is cut off.

    Notes
    -----
    Three or more adjoining pixels have the largest number, and the pixels around them differ from it by so
    many steps of the numbers that as many equal ones are no chance.  A level that the user has given stays.
    """
    good = ~raw.mask & np.isfinite(raw.data)
    known = raw.metadata.saturation
    if raw.unit not in COUNTS or not good.any():
        return raw
    top = float(raw.data[good].max())
    if known is not None and (known.value <= top or known.precedence < PRECEDENCE.index("pixels")):
        return raw
    labels, count = ndimage.label(good & (raw.data == top), _AROUND)
    sizes = np.bincount(labels.ravel())[1:]
    if not count or not _FEWEST <= sizes.max() <= _LARGEST_SHARE * raw.data.size:
        return raw
    core = labels == sizes.argmax() + 1
    ring = raw.data[ndimage.binary_dilation(core, _AROUND) & ~core & good]
    differences = np.diff(np.unique(np.append(ring, top)))
    differences = differences[differences > _ROUNDING * abs(top)]
    if not differences.size or differences.size + 1 <= _ALIKE * len(ring):
        return raw
    steps = float(np.median(top - ring) / differences.min())
    if max(steps, 1.0) ** (1.0 - sizes.max()) > _CHANCE:
        return raw
    unit = "ADU" if raw.unit == "adu" else "e-"
    said = f"{sizes.max()} adjoining pixels have the largest number of the frame, {top:g} {unit}"
    level = Sourced(top, unit, "pixels that are cut off")
    metadata = replace(raw.metadata, saturation=level)
    return raw.with_metadata(metadata.warn(f"{said}: they are taken as saturated; give --saturation"))
