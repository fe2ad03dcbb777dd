"""The numbers of one image of a FITS file: as stored, and scaled as the header says.

Reach for :func:`open_pixels`, which holds what an image declares against what the file can hold before
anything is allocated.  Numbers are read unscaled, and BLANK, BSCALE and BZERO are applied in float64: exact
for every integer type up to 32 bits, and the same for plain and compressed images.  Tiles are astropy's.
"""

from __future__ import annotations

import gzip
import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, BinaryIO

import numpy as np

from jitterkit.errors import ErrorCode, FrameError
from jitterkit.frames.files import damaged, refuse_giant, truncated, unpacks_believably
from jitterkit.frames.fitsio import packed_image
from jitterkit.frames.hdu import Hdu, product_of

_DTYPES = {8: "u1", 16: "i2", 32: "i4", 64: "i8", -32: "f4", -64: "f8"}

_METHODS = ("RICE_1", "RICE_ONE", "GZIP_1", "GZIP_2", "PLIO_1", "HCOMPRESS_1", "NOCOMPRESS")
"""Compression methods that astropy can read."""

_MOST_TILE = 1 << 16
"""A tile may be larger than its image, up to this side [pixel]."""

_CHUNK = 100 * 2880
"""Bytes that are read at once where they are only summed."""

_ONES = 0xFFFFFFFF


@dataclass(frozen=True, eq=False)
class Pixels:
    """The pixels of an image HDU.

    Parameters
    ----------
    hdu : Hdu
        Where they are, and in what shape; BSCALE, BZERO and BLANK of its header are obeyed.
    packed : astropy.io.fits.CompImageHDU, optional
        What unpacks the tiles, unscaled; without it the pixels are read as they stand in the file.
    """

    hdu: Hdu
    packed: Any = None

    @cached_property
    def scaling(self) -> tuple[float, float, int | None]:
        """BSCALE, BZERO, and the stored number that stands for no value, None where there is none."""
        scale, zero = self._number("BSCALE", 1), self._number("BZERO", 0)
        if not (math.isfinite(scale) and math.isfinite(zero)) or scale == 0:
            problem = f"has BSCALE = {scale:g} and BZERO = {zero:g}, of which no pixel value follows"
            raise FrameError(ErrorCode.DAMAGED, self.hdu.path, problem, "mend its header")
        blank = self._number("BLANK", None) if self.hdu.bitpix > 0 else None
        if blank is not None and not self._is_stored(blank):
            blank = (blank - zero) / scale  # of a writer who scaled it too
        blank = int(blank) if blank is not None and self._is_stored(blank) else None
        return float(scale), float(zero), blank

    def _is_stored(self, value: float) -> bool:
        """Return whether a number is one that the integers of the file can hold."""
        limits = np.iinfo(_DTYPES[self.hdu.bitpix])
        return math.isfinite(value) and float(value).is_integer() and limits.min <= value <= limits.max

    def _number(self, key: str, default: Any) -> Any:
        """A number on which every pixel depends: not to be passed over where it cannot be read."""
        value = self.hdu.header.get(key, default)
        said = self.hdu.header.faults.get(key, "")
        if said == "has no value" and default is None:
            said = ""
        if value is not default and (isinstance(value, bool) or not isinstance(value, int | float)):
            said = f"is {str(value)[:40]!r}, not a number"
        if said:
            problem = f"has pixels that depend on {key}, which {said}"
            raise FrameError(ErrorCode.DAMAGED, self.hdu.path, problem, "mend its header")
        return value

    @property
    def dtype(self) -> np.dtype:
        """Return the type of the numbers stored; FITS says uint16 by a BZERO of 32768."""
        (scale, zero, _), bitpix = self.scaling, self.hdu.bitpix
        if scale == 1 and bitpix > 8 and zero == 2.0 ** (bitpix - 1):
            return np.dtype(f"u{bitpix // 8}")
        return np.dtype("i1") if (bitpix, scale, zero) == (8, 1, -128) else np.dtype(_DTYPES[bitpix])

    def plane(self, index: int | None) -> tuple[np.ndarray, np.ndarray | None]:
        """Return one plane, or all of them, and where they are blank, None where no pixel can be.

        Parameters
        ----------
        index : int or None
            Among the planes of the HDU that count; a single one goes with all.  None for the whole image.

        Returns
        -------
        values : (ny, nx) array
            float64; 0 where blank.
        blank : (ny, nx) bool array or None

        Raises
        ------
        FrameError
            If the file ends before the plane does.
        """
        where: tuple[int, ...] = ()
        if index is not None and len(self.hdu.shape) > 2:
            index = index if self.hdu.planes > 1 else 0
            index = self.hdu.layers[index] if self.hdu.layers else index
            where = tuple(map(int, np.unravel_index(index, self.hdu.shape[:-2])))
        shape, dtype = self.hdu.shape[len(where) :], np.dtype(_DTYPES[self.hdu.bitpix]).newbyteorder(">")
        if self.packed is not None:
            stored = np.asarray(self.packed.section[(*where, *[slice(None)] * len(shape))])
        else:
            length = math.prod(shape) * dtype.itemsize
            first = int(np.ravel_multi_index(where, self.hdu.shape[: len(where)])) if where else 0
            self.hdu.handle.seek(self.hdu.data + first * length)
            content = self.hdu.handle.read(length)
            if len(content) < length:
                raise truncated(self.hdu.path, f"ends {length - len(content)} bytes before its pixels do")
            stored = np.frombuffer(content, dtype).reshape(shape)
        scale, zero, blank = self.scaling
        if stored.dtype.kind == "i" and stored.dtype.itemsize == 8 and (scale, zero) == (1.0, 2.0**63):
            # unsigned: a sum of floats would lose ten bits
            whole = stored.astype(np.int64).view(np.uint64) ^ np.uint64(2**63)
            values, zero = whole.astype(np.float64), 0.0
        else:
            values = stored.astype(np.float64)
        if scale != 1.0:
            values *= scale  # in place: a frame of 61 million pixels is 0.5 GB
        if zero != 0.0:
            values += zero
        if blank is None:
            return values, None
        empty = stored == blank
        values[empty] = 0.0
        return values, empty

    def everything(self) -> np.ndarray:
        """Return all pixels in the shape of the image, as float64; blank ones are NaN."""
        values, blank = self.plane(None)
        if blank is not None:
            values[blank] = np.nan
        return values

    def checksum_warnings(self) -> list[str]:
        """Compare the HDU with the checksums in its header, and read a gzip to the CRC at its end.

        Returns
        -------
        warnings : list of str
            One for each checksum that is wrong; none where there are none.

        Notes
        -----
        Sums of 32-bit words in ones' complement, FITS 4.0, appendix J.  The whole HDU, the card CHECKSUM
        included, sums to zero (all bits set).
        """
        hdu, found = self.hdu, []
        if "DATASUM" in hdu.header or "CHECKSUM" in hdu.header:
            data, said = _sum(hdu.handle, hdu.data, hdu.span), hdu.words("DATASUM")
            whole = _sum(hdu.handle, hdu.start, hdu.data - hdu.start) + data
            if said.isdecimal() and int(said) % _ONES != data:
                found.append(
                    f"the pixels do not have the checksum of the header (DATASUM = {said}): "
                    "the file was damaged or its pixels were changed"
                )
            elif hdu.words("CHECKSUM").strip("0") and whole % _ONES:
                found.append("the header was changed after its CHECKSUM was written")
        while isinstance(hdu.handle, gzip.GzipFile) and hdu.handle.read(_CHUNK):
            pass
        return found

    def warnings(self) -> list[str]:
        """Warn of a compression that changed the pixels, and of a BLANK that is not as FITS defines it.

        Only the table behind a compressed image says the first; BLANK is a stored number of integers.
        """
        hdu, found, value = self.hdu, [], self.hdu.header.get("BLANK")
        if self.packed is not None:
            method = hdu.words("ZQUANTIZ") or "NO_DITHER"
            options = {hdu.words(f"ZNAME{n}"): hdu.header.get(f"ZVAL{n}") for n in range(1, 10)}
            scale = options.get("SCALE") if hdu.words("ZCMPTYPE").startswith("HCOMPRESS") else None
            if hdu.bitpix < 0 and "ZSCALE" in hdu.columns and method != "NONE":
                found.append(f"the compression quantised the pixels (ZQUANTIZ = {method}): it is lossy")
            elif isinstance(scale, int | float) and scale > 0:
                found.append(f"the compression (HCOMPRESS, scale {scale:g}) is lossy")
        if isinstance(value, bool) or not isinstance(value, int | float):
            return found
        if hdu.bitpix < 0:
            found.append(f"BLANK = {value:g} means nothing among floats: pixels of that value count")
        elif not self._is_stored(value):
            read = f"is read as {value:g} after BSCALE and BZERO"
            read = "is ignored" if self.scaling[2] is None else read
            found.append(f"BLANK = {value:g} is none of the numbers that {hdu.bitpix} bits hold and {read}")
        return found


def _sum(handle: BinaryIO, start: int, length: int) -> int:
    """Sum words of 32 bits modulo 2^32 - 1, as ones' complement does."""
    handle.seek(start)
    total = 0
    while length > 0 and (content := handle.read(min(length, _CHUNK))):
        words = np.frombuffer(content.ljust(-(-len(content) // 4) * 4, b"\0"), ">u4")
        total += int(words.sum(dtype=np.uint64))
        length -= len(content)
    return total % _ONES


def open_pixels(hdu: Hdu) -> Pixels:
    """Compare what an image declares with what its file can hold, and make its pixels readable.

    Raises
    ------
    FrameError
        If the pixels cannot all be there, a frame is larger than any detector's, or their compression is not
        read.

    Notes
    -----
    *Fails when* a compressed file is damaged within the reason of
    :func:`~jitterkit.frames.files.unpacks_believably`; then reading it fails.
    """
    nx, ny = (*hdu.shape[::-1], 1)[:2]
    size, zipped = hdu.path.stat().st_size, isinstance(hdu.handle, gzip.GzipFile)
    declared, planes = abs(hdu.bitpix) // 8 * math.prod(hdu.shape), math.prod(hdu.shape[:-2])
    held = hdu.data + (hdu.span if hdu.packed else declared) <= size
    short = not held
    if hdu.packed or zipped:  # of what is packed a frame still takes a byte
        short = not unpacks_believably(declared, nx * ny, size) or planes > size
    if hdu.packed:
        short = short or _tiles(hdu) > hdu.whole("NAXIS2") or not (held or zipped)
    elif zipped and not short and planes > 1:  # a single plane is read at once, or found missing then
        hdu.handle.seek(hdu.data + declared - 1)
        short = not hdu.handle.read(1)
    if short:
        amount = declared if declared < 10**18 else "more than 10^18"
        problem = f"declares {amount} bytes of pixels and the file of {size} bytes lacks them"
        # a complete table may be too short for the pixels that it declares
        raise (damaged if held and not zipped else truncated)(hdu.path, f"HDU {hdu.number} {problem}")
    refuse_giant(hdu.path, f"HDU {hdu.number}", nx, ny)
    if not hdu.packed:
        return Pixels(hdu)
    method = hdu.header.get("ZCMPTYPE")
    if isinstance(method, str) and method not in _METHODS:
        problem = f"HDU {hdu.number} uses {method[:40]!r} compression, which is not read"
        raise FrameError(ErrorCode.UNSUPPORTED_ENCODING, hdu.path, problem, "save the image uncompressed")
    return Pixels(hdu, packed_image(hdu.handle, hdu.number, blank="BLANK" in hdu.header))


def _tiles(hdu: Hdu) -> int:
    """Return how many tiles the image has; each is a row of the table."""
    sides = hdu.shape[::-1]
    tile = [hdu.whole(f"ZTILE{n}", side if n == 1 else 1) for n, side in enumerate(sides, 1)]
    if any(not 0 < length <= max(side, _MOST_TILE) for length, side in zip(tile, sides, strict=True)):
        raise hdu.refusal(f"declares tiles of {product_of(tuple(tile[::-1]))} pixels")
    return math.prod(-(-side // length) for side, length in zip(sides, tile, strict=True))
