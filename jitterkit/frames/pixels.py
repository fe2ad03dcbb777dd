"""The numbers of one image of a FITS file: as stored, and scaled as the header says.

Reach for :class:`Pixels`; what it may touch has been held against the size of the file before
(:mod:`~jitterkit.frames.header_blocks`).  Numbers are read unscaled, and BLANK, BSCALE and BZERO are applied
in float64: exact for every integer type up to 32 bits, and the same for plain and compressed images.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, BinaryIO

import numpy as np

from jitterkit.errors import ErrorCode, FrameError
from jitterkit.frames.hdu import Unit
from jitterkit.frames.plainheader import PlainHeader

__all__ = ["Pixels"]

DTYPES = {8: "u1", 16: "i2", 32: "i4", 64: "i8", -32: "f4", -64: "f8"}


@dataclass(frozen=True)
class Pixels:
    """The pixels of an image HDU.

    Parameters
    ----------
    handle : file object
        The unpacked bytes of the file.
    unit : Unit
        Where they are, and in what shape.
    header : PlainHeader
        Of the image: BSCALE, BZERO and BLANK are obeyed.
    packed : astropy.io.fits.CompImageHDU, optional
        What unpacks the tiles, unscaled; without it the pixels are read as they stand in the file.
    """

    handle: BinaryIO
    unit: Unit
    header: PlainHeader
    packed: Any = None

    @cached_property
    def scaling(self) -> tuple[float, float, int | None]:
        """BSCALE, BZERO, and the stored number that stands for no value, None where there is none."""
        scale, zero = self._number("BSCALE", 1), self._number("BZERO", 0)
        if not (math.isfinite(scale) and math.isfinite(zero)) or scale == 0:
            problem = f"has BSCALE = {scale:g} and BZERO = {zero:g}, of which no pixel value follows"
            raise FrameError(ErrorCode.DAMAGED, self.unit.path, problem, "mend its header")
        blank = self._number("BLANK", None) if self.unit.bitpix > 0 else None
        if blank is not None:
            blank = int(blank) if float(blank).is_integer() else None
        return float(scale), float(zero), blank

    def _number(self, key: str, default: Any) -> Any:
        """A number on which every pixel depends: not to be passed over where it cannot be read."""
        value = self.header.get(key, default)
        if key in self.header.unreadable:
            said = "cannot be read"
        elif key in self.header.valueless and default is not None:
            said = "has no value"
        elif value is not default and (isinstance(value, bool) or not isinstance(value, int | float)):
            said = f"is {str(value)[:40]!r}, not a number"
        else:
            return value
        problem = f"has pixels that depend on {key}, which {said}"
        raise FrameError(ErrorCode.DAMAGED, self.unit.path, problem, "mend its header")

    @property
    def dtype(self) -> np.dtype:
        """Of the numbers stored; FITS says uint16 by a BZERO of 32768."""
        (scale, zero, _), bitpix = self.scaling, self.unit.bitpix
        if scale == 1 and bitpix > 8 and zero == 2.0 ** (bitpix - 1):
            return np.dtype(f"u{bitpix // 8}")
        return np.dtype("i1") if (bitpix, scale, zero) == (8, 1, -128) else np.dtype(DTYPES[bitpix])

    def plane(self, index: int) -> tuple[np.ndarray, np.ndarray | None]:
        """Return one plane and where it is blank, None where no pixel can be.

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
        *planes, ny, nx = self.unit.shape
        if self.packed is None:
            return self._scaled(self._numbers(index * ny * nx, (ny, nx)))
        where = tuple(int(i) for i in np.unravel_index(index, planes)) if planes else ()
        return self._scaled(np.asarray(self.packed.section[(*where, slice(None), slice(None))]))

    def everything(self) -> np.ndarray:
        """Return all pixels in the shape of the image, as float64; blank ones are NaN."""
        stored = self._numbers(0, self.unit.shape) if self.packed is None else self.packed.section[...]
        values, blank = self._scaled(np.asarray(stored))
        if blank is not None:
            values[blank] = np.nan
        return values

    def _numbers(self, first: int, shape: tuple[int, ...]) -> np.ndarray:
        dtype = np.dtype(DTYPES[self.unit.bitpix]).newbyteorder(">")
        self.handle.seek(self.unit.data + first * dtype.itemsize)
        length = math.prod(shape) * dtype.itemsize
        content = self.handle.read(length)
        if len(content) < length:
            problem = f"ends {length - len(content)} bytes before its pixels do"
            raise FrameError(ErrorCode.TRUNCATED, self.unit.path, problem, "it is truncated: copy it again")
        return np.frombuffer(content, dtype).reshape(shape)

    def _scaled(self, stored: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
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
        where = stored == blank
        values[where] = 0.0
        return values, where
