"""One image of a FITS file with what the file says about its pixels: mask, variance, numbers, coordinates."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from jitterkit.frames.cards import Cards
from jitterkit.frames.extensions import Group, Named
from jitterkit.frames.framefile import Planes
from jitterkit.frames.header import rate_of_brightness, resolve_header
from jitterkit.frames.metadata import Known, Metadata
from jitterkit.frames.pixels import Pixels
from jitterkit.frames.placed import NONE_MASKED
from jitterkit.frames.plainheader import PlainHeader
from jitterkit.frames.planes import refuse_colour, rows_from_the_top
from jitterkit.frames.quality import bad_bits, quality_of
from jitterkit.frames.sky import turned_over
from jitterkit.frames.uncertainty import usable
from jitterkit.frames.units import COUNTS, RATES
from jitterkit.frames.wcs import celestial_wcs

__all__ = ["FitsImage"]


class FitsImage:
    """The planes of one image HDU.

    Parameters
    ----------
    group : Group
        The image, and what belongs to it.
    primary : PlainHeader
        Of the primary HDU.
    opened : callable
        Gives the pixels of an HDU.
    tables : callable
        Gives the HDUs of the file as astropy has them, for coordinates with lookup tables.

    Attributes
    ----------
    number : int
        Of the HDU.
    count : int
        Number of planes.
    shape : (int, int)
        ``(ny, nx)``.
    dtype : numpy.dtype
        As stored.
    used : list of Pixels
        Those of every HDU that is read.
    metadata : Metadata
    """

    def __init__(
        self,
        group: Group,
        primary: PlainHeader,
        opened: Callable[[Named], Pixels],
        tables: Callable[[], Any],
    ) -> None:
        self.group, self.pixels, self._factor = group, opened(group.image), 1.0
        self.dtype = self.pixels.dtype  # refuses a scaling that cannot be read
        self._quality = None if group.quality is None else opened(group.quality)
        self._noise = {role: opened(one) for role, one in group.noise.items()}
        unit, header = self.pixels.unit, self.pixels.header
        *planes, ny, nx = unit.shape
        self.number, self.count, self.shape = unit.number, math.prod(planes), (ny, nx)
        inherit = primary if unit.number and header.get("INHERIT") is not False else None
        refuse_colour(unit.path, unit.shape, header, inherit)
        from_top, odd = rows_from_the_top(header, inherit)
        wcs, messages = celestial_wcs(header, tables)
        if wcs is not None and from_top:
            wcs = turned_over(wcs, ny)
            messages += ["the WCS has lookup tables, which are not turned over, and is ignored"] * (
                wcs is None
            )
        metadata = resolve_header(header, hdu=unit.number, inherit=inherit, wcs=wcs)
        rate = rate_of_brightness(header, metadata.unit, inherit)
        if rate is not None:
            self._factor, known = rate
            metadata = metadata.override(known.source, unit=known)
        elif metadata.value("unit", "adu") not in COUNTS + RATES:
            odd.append(f"the pixels are in {metadata.value('unit')}, which is neither ADU nor electrons")
        if self._quality is not None and group.quality is not None:
            cards = Cards([(header, unit.number), *([] if inherit is None else [(inherit, 0)])])
            bits, convention = bad_bits(self._quality.header, cards)
            known = Known(bits, "", f"{group.quality.label}, convention: {convention}")
            metadata = metadata.override(known.source, bad_bits=known)
        metadata = metadata.warn(*header.warnings, *messages, *odd, *group.warnings)
        self.metadata = metadata.reordered(-1) if from_top else metadata

    @property
    def used(self) -> list[Pixels]:
        """The pixels of every HDU that is read."""
        return [self.pixels, *([] if self._quality is None else [self._quality]), *self._noise.values()]

    def read(self, index: int) -> Planes:
        """Return one plane, with the warnings that its variance earns."""
        data, blank = self.pixels.plane(index)
        mask = np.zeros(self.shape, bool) if blank is None else blank
        data = data * self._factor if self._factor != 1.0 else data
        quality = None
        if self._quality is not None:
            plane = self._quality.plane(_place(self._quality, index))
            quality = quality_of(*plane, width=8 * self._quality.dtype.itemsize)
            quality[mask] = -1
        variance, unusable, warning = self._variance(index)
        if unusable is not None:
            mask = mask | unusable
        metadata = self._of_plane(index).warn(*[warning] * bool(warning))
        if metadata.row_order == -1:
            data, mask = np.ascontiguousarray(data[::-1]), mask[::-1]
            quality, variance = (None if a is None else a[::-1] for a in (quality, variance))
        mask = mask if mask.any() else NONE_MASKED
        return Planes(data, mask, metadata, self.number, variance, self.group.noise_label, quality)

    def _of_plane(self, index: int) -> Metadata:
        """What is known about a plane: a WCS of its own is not read, and the first plane's is not its."""
        table, metadata = self.group.coordinates, self.metadata
        if table is None or index == 0:
            return metadata
        scale = metadata.plate_scale
        by_wcs = scale is not None and scale.source.startswith("header WCS")
        metadata = replace(metadata, wcs=None, plate_scale=None if by_wcs else scale)
        said = f"the WCS of each plane but the first, in the table of HDU {table.unit.number}, is not read"
        return metadata.warn(f"{said}: give --plate-scale")

    def _variance(self, index: int) -> tuple[np.ndarray | None, np.ndarray | None, str]:
        """Variance of the stored numbers, pixels that have none where it is not used, and a warning."""
        if not self._noise:
            return None, None, ""
        total = np.zeros(self.shape)
        for role, pixels in self._noise.items():
            values, blank = pixels.plane(_place(pixels, index))
            values[values < 0] = np.nan  # BITPIX cannot say that a variance is unknown
            if role == "weight":
                with np.errstate(divide="ignore"):
                    values = 1 / values
            total += values**2 if role == "sigma" else values
            if blank is not None:
                total[blank] = np.nan
        name = self.group.noise_label
        if self.group.weight_is_time:
            return None, ~np.isfinite(total), f"{name} may be an exposure time: only its zeros are used"
        variance, warning = usable(total * self._factor**2, name)
        return variance, None, warning


def _place(pixels: Pixels, index: int) -> int:
    """The plane that goes with one of the image: a single one goes with all."""
    return index if math.prod(pixels.unit.shape[:-2]) > 1 else 0
