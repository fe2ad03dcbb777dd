"""One image of a FITS file with what the file says about its pixels: mask, variance, numbers, coordinates."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from jitterkit.errors import ErrorCode, FrameError
from jitterkit.frames.altered import outside_of_data, scaled_up
from jitterkit.frames.beside import bad_bits, quality_of, rate_of_brightness, rows_from_the_top, usable
from jitterkit.frames.cards import Cards
from jitterkit.frames.dialects import CAPTURE_PROGRAM, SOFTWARE_KEYS
from jitterkit.frames.doubts import READS
from jitterkit.frames.files import in_colour
from jitterkit.frames.frame import RawFrame
from jitterkit.frames.group import Group
from jitterkit.frames.hdu import Hdu
from jitterkit.frames.header import resolve
from jitterkit.frames.metadata import Sourced
from jitterkit.frames.pixels import open_pixels
from jitterkit.frames.sky import turned_over
from jitterkit.frames.units import COUNTS, RATES
from jitterkit.frames.wcs import celestial_wcs

_MOSAIC_KEYS = ("BAYERPAT", "COLORTYP", "BAYRPAT", "CFA", "CFAIMAGE")

_MOST_BAD = 0.5
"""Share of masked pixels from which a mask may have the opposite meaning."""

_NO_MOSAIC = ("", "NONE", "MONO", "MONOCHROME", "GRAY", "GREY", "L")


class FitsImage:
    """The planes of one image HDU.

    Parameters
    ----------
    group : Group
        The image, and what belongs to it.
    primary : mapping
        Header of the primary HDU.
    tables : callable
        Gives the HDUs of the file as astropy has them, for coordinates with lookup tables.

    Attributes
    ----------
    hdu : Hdu
    shape : (int, int)
        ``(ny, nx)``.
    dtype : numpy.dtype
        As stored.
    metadata : Metadata
    """

    def __init__(self, group: Group, primary: Mapping[str, Any], tables: Callable[[], Any]) -> None:
        self.group, self.hdu = group, group.image
        self._pixels = open_pixels(self.hdu)
        self.dtype = self._pixels.dtype  # refuses a scaling that cannot be read
        self._parts = {role: open_pixels(part) for role, part in group.parts.items()}
        self._noise = {role: part for role, part in group.parts.items() if role != "quality"}
        self._factor, self._unverified = 1.0, True
        self.shape = self.hdu.shape[-2], self.hdu.shape[-1]
        header, number, quality = self.hdu.header, self.hdu.number, self.group.parts.get("quality")
        alone = str(header.get("INHERIT", "")).strip().upper() in ("F", "FALSE")
        inherit = primary if number and not alone else None
        cards = Cards(header, number, inherit)
        odd = [] if self.hdu.role else self._pixels.warnings()
        _check_planes(self.hdu, cards, odd)
        self._outside, cut = (None, "") if self.hdu.role else outside_of_data(cards, self.shape)
        odd += [cut] * bool(cut)
        from_top = rows_from_the_top(cards)
        said = (cards.find(key) or ("",) for key in _MOSAIC_KEYS)
        if any(isinstance(one[0], str) and one[0].strip().upper() not in _NO_MOSAIC for one in said):
            odd.append("the header says that its pixels lie behind a colour mosaic")
        wcs, messages = celestial_wcs(header, tables)
        if wcs is not None and from_top:
            wcs = turned_over(wcs, self.shape[0])
            odd += ["the WCS has lookup tables, which are not turned over, and is ignored"] * (wcs is None)
        metadata = resolve(cards, wcs)
        rate = rate_of_brightness(cards, metadata.unit)
        if rate is not None:
            self._factor, known = rate
            metadata = metadata.override(known.source, unit=known)
        elif metadata.value("unit", "adu") not in COUNTS + RATES:
            odd.append(f"the pixels are in {metadata.value('unit')}, which is neither ADU nor electrons")
        if quality is not None:
            bits, convention = bad_bits(quality.header, cards)
            known = Sourced(bits, "", f"{quality.label}, convention: {convention}")
            metadata = metadata.override(known.source, bad_bits=known)
        metadata = metadata.warn(*header.warnings, *messages, *odd, *self.group.warnings)
        self.metadata = metadata.reordered(-1) if from_top else metadata

    def read(self, index: int) -> RawFrame:
        """Return one plane; the first time all HDUs that are read are compared with their checksums."""
        from jitterkit.frames.hidden import hidden_light  # 0.2 s

        data, blank = self._pixels.plane(index)
        self.metadata = self.metadata.warn(*scaled_up(data, self.metadata, self._pixels.scaling[0]))
        mask = np.zeros(self.shape, bool) if blank is None else blank
        mask = mask if self._outside is None else mask | self._outside
        data = data * self._factor if self._factor != 1.0 else data
        quality = self._quality(index, mask) if "quality" in self._parts else None
        name = " + ".join(part.label for part in self._noise.values())
        variance, unusable, warning = self._variance(index, name) if name else (None, None, "")
        mask = mask if unusable is None else mask | unusable
        odd = [warning] * bool(warning)
        hidden = hidden_light(data, mask, self.metadata, quality, variance)
        if hidden is not None:
            labels = " and ".join(part.label for part in self.group.parts.values())
            odd.append(f"{hidden.sentence(labels or 'NaN')}: {hidden.remedy}")
        if self._unverified:
            used, self._unverified = [self._pixels, *self._parts.values()], False
            self.metadata = self.metadata.warn(*(text for one in used for text in one.checksum_warnings()))
        metadata, table = self.metadata, self.group.coordinates
        if table is not None and (*self.hdu.layers, *range(index + 1))[index] > 0:
            # its own WCS is not read, and that of the first plane is not its
            scale = metadata.plate_scale
            by_wcs = scale is not None and scale.source.startswith("header WCS")
            metadata = replace(metadata, wcs=None, plate_scale=None if by_wcs else scale)
            said = f"the WCS of each plane but the first, in the table of HDU {table.number}, is not read"
            metadata = metadata.warn(f"{said}: give --plate-scale")
        metadata = metadata.warn(*odd)
        if metadata.row_order == -1:
            data, mask = data[::-1], mask[::-1]
            quality, variance = (None if a is None else a[::-1] for a in (quality, variance))
        return RawFrame(
            data,
            mask,
            metadata,
            hdu=self.hdu.number,
            variance=variance,
            variance_source=name,
            weighted="weight" in self._noise,
            quality=quality,
        )

    def _quality(self, index: int, mask: np.ndarray) -> np.ndarray:
        """Bits of the quality plane, -1 where a pixel is masked; warn where they mask most pixels."""
        pixels = self._parts["quality"]
        quality = quality_of(*pixels.plane(index), width=8 * pixels.dtype.itemsize)
        quality[mask] = -1
        bad = np.mean(quality & int(self.metadata.value("bad_bits")) != 0)
        if bad > _MOST_BAD:
            found = f"{self.group.parts['quality'].label} masks {bad:.0%} of the pixels"
            self.metadata = self.metadata.warn(f"{found}: if 1 means good in it, give --bad-bits 0")
        return quality

    def _variance(self, index: int, name: str) -> tuple[np.ndarray | None, np.ndarray | None, str]:
        """Variance of the stored numbers, pixels that have none where it is not used, and a warning."""
        total = np.zeros(self.shape)
        for role in self._noise:
            values, blank = self._parts[role].plane(index)
            values[values < 0] = np.nan  # BITPIX cannot say that a variance is unknown
            if role == "weight":
                with np.errstate(divide="ignore"):
                    values = 1 / values
            total += values**2 if role == "sigma" else values
            if blank is not None:
                total[blank] = np.nan
        if self.group.weight_is_time:
            return None, ~np.isfinite(total), f"{name} may be an exposure time: only its zeros are used"
        variance, warning = usable(total * self._factor**2, name)
        return variance, None, warning


_NARROW = 5
"""Columns from which on a plane may be an image: fewer are channels of colour, or frames."""


def _check_planes(hdu: Hdu, cards: Cards, odd: list[str]) -> None:
    """Raise FrameError for an image in colour, as for a TIFF; add a remark where only its program says so.

    Warn of the reads of one ramp, each of which has the light of those before it too; a cube of JWST has
    integrations unless it has four axes.
    """
    counts = [key for key in ("NGROUPS", *READS) if (cards.find(key) or (0,))[0] == hdu.planes > 1]
    if counts and (cards.dialect.name != "JWST" or len(hdu.shape) == 4):
        found = f"the planes may be the {hdu.planes} reads of one ramp ({counts[0]}), and not frames"
        odd.append(f"{found}: give the file of its slope (JWST: _rate)")
    for axis, side in enumerate(reversed(hdu.shape), 1):
        name = hdu.words(f"CTYPE{axis}").upper() if side in (3, 4) else ""
        if name in ("RGB", "RGBA", "COLOR", "COLOUR"):
            raise in_colour(hdu.path, side, f"CTYPE{axis} = {name!r}")
    if len(hdu.shape) < 3:
        return
    n, ny, nx = hdu.shape[-3:]
    if (nx < _NARROW and min(n, ny) >= 4 * _NARROW) or 2 * nx <= ny == n:
        problem = f"has {n} planes of {nx} x {ny} pixels, so that its frames seem to lie along the first axis"
        remedy = "write them along the last (numpy.moveaxis(cube, -1, 0)), and colours as one channel"
        raise FrameError(ErrorCode.WRONG_SHAPE, hdu.path, problem, remedy)
    if 3 not in (hdu.shape[0], hdu.shape[-1]):
        return
    space = (cards.text("COLORSPC") or cards.text("COLORSPACE")).upper()
    if space in ("RGB", "SRGB"):
        raise in_colour(hdu.path, 3, f"COLORSPC = {space!r}")
    mosaic = (cards.find("BAYERPAT") or ("",))[0]
    if isinstance(mosaic, str) and mosaic.strip().upper() not in _NO_MOSAIC:
        raise in_colour(hdu.path, 3, f"BAYERPAT = {mosaic.strip().upper()!r}")
    program = next(filter(CAPTURE_PROGRAM.search, map(cards.text, SOFTWARE_KEYS)), None)
    if hdu.planes == 3 and program is not None:
        odd.append(
            f"three planes by {program} are taken for three frames: if they are colours, give one alone"
        )
