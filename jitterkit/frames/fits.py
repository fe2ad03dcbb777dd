"""FITS in and out; the only module that touches ``astropy.io.fits``.

The pixels are read unscaled, one plane at a time, and BLANK, BSCALE and BZERO are applied here in
float64: exact for every integer type up to 32 bits, and the same for plain and compressed images.
Reach for :func:`open`; what a header claims is checked in :mod:`~jitterkit.frames.header_blocks` first.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from astropy.io import fits

from jitterkit.errors import FrameError
from jitterkit.frames.framefile import FrameFile, translated
from jitterkit.frames.header import resolve_header
from jitterkit.frames.header_blocks import refuse_endless_header, refuse_missing_data
from jitterkit.frames.metadata import Metadata
from jitterkit.frames.placed import NONE_MASKED
from jitterkit.frames.wcs import celestial_wcs

__all__ = ["FitsFile", "open", "read_extensions", "read_image", "write"]

#: So many HDUs are searched for an image.
MOST_HDUS = 1000
DTYPES = {8: "u1", 16: "i2", 32: "i4", 64: "i8", -32: "f4", -64: "f8"}


class PlainHeader(dict):
    """The readable cards of a header, with their comments."""

    def __init__(self, header: fits.Header) -> None:
        super().__init__()
        self.comments: dict[str, str] = {}
        self.warnings: list[str] = []
        for card in header.cards:
            try:
                self[card.keyword] = card.value
                self.comments[card.keyword] = card.comment
            except Exception:  # VerifyError, and ValueError on bytes that are no text
                self.warnings.append(f"the header card {card.image.strip()[:60]!r} cannot be read")


class FitsFile(FrameFile):
    """The planes of one image HDU of a FITS file.

    Parameters
    ----------
    path : Path
        Plain, gzipped or tile-compressed.
    hdu : int, optional
        By default the first with a two- or three-dimensional image.

    Raises
    ------
    FrameError
        If there is no such HDU, no image, more data declared than present, or no readable header.
    """

    kind = "FITS"

    def __init__(self, path: Path, hdu: int | None) -> None:
        super().__init__(path)
        refuse_endless_header(path)
        with translated(path) as caught:
            self._handle = path.open("rb")  # ours to close: astropy leaves it open where it fails
            try:
                self._hdus = fits.open(self._handle, memmap=False, do_not_scale_image_data=True)
                _refuse_nonstandard(path, self._hdus)
                self._choose(hdu)
            except BaseException:
                self.close()
                raise
        self.metadata = self.metadata.warn(*caught)

    def _choose(self, hdu: int | None) -> None:
        self.hdu = _image_number(self.path, self._hdus, hdu)
        self._image = self._hdus[self.hdu]
        refuse_missing_data(self.path, self.hdu, self._image, _is_packed(self._image))
        header = PlainHeader(self._image.header)
        self._blank = header.get("BLANK") if self._image.header["BITPIX"] > 0 else None
        self._scale, self._zero = float(header.get("BSCALE", 1)), float(header.get("BZERO", 0))
        self.dtype = _stored_type(self._image.header["BITPIX"], self._scale, self._zero)
        *planes, ny, nx = self._image.shape
        self._planes = tuple(planes)
        self._count, self.shape = math.prod(planes), (ny, nx)
        self.metadata = self._resolve(header)

    def _resolve(self, header: PlainHeader) -> Metadata:
        wcs, messages = celestial_wcs(self._image.header)
        primary = PlainHeader(self._hdus[0].header) if self.hdu else None
        metadata = resolve_header(header, hdu=self.hdu or 0, inherit=primary, wcs=wcs)
        lossy = _lossy(self.path, self.hdu) if _is_packed(self._image) else []
        return metadata.warn(*header.warnings, *messages, *lossy)

    def _read(self, index: int) -> tuple[np.ndarray, np.ndarray, Metadata]:
        where = tuple(int(i) for i in np.unravel_index(index, self._planes)) if self._planes else ()
        raw = np.asarray(self._image.section[(*where, slice(None), slice(None))])
        if raw.shape != self.shape:
            raise FrameError(self.path, f"plane {index} is cut short", "copy the file again")
        data = raw.astype(np.float64)
        if (self._scale, self._zero) != (1.0, 0.0):
            data = data * self._scale + self._zero
        if self._blank is None:
            return data, NONE_MASKED, self.metadata
        return np.where(raw == self._blank, 0.0, data), raw == self._blank, self.metadata

    def close(self) -> None:
        """Close the file."""
        self._handle.close()


def open(path: Path, hdu: int | None = None) -> FitsFile:
    """Open a FITS file; see :class:`FitsFile`."""
    return FitsFile(path, hdu)


def _refuse_nonstandard(path: Path, hdus: fits.HDUList) -> None:
    # of a damaged primary header astropy makes HDUs without end
    if not isinstance(hdus[0], fits.PrimaryHDU):
        raise FrameError(path, "has a damaged primary header", "copy it again or convert it")


def _is_image(hdu: Any) -> bool:
    kinds = (fits.PrimaryHDU, fits.ImageHDU, fits.CompImageHDU)
    if not isinstance(hdu, kinds) or isinstance(hdu, fits.GroupsHDU):
        return False
    *planes, ny, nx = (0, 0, *hdu.shape) if len(hdu.shape) < 2 else hdu.shape
    return ny > 0 and nx > 0 and math.prod(planes) > 0 and sum(n > 1 for n in planes) <= 1


def _is_packed(hdu: Any) -> bool:
    return isinstance(hdu, fits.CompImageHDU)


def _what(hdu: Any) -> str:
    """Say what an HDU is, for a refusal."""
    if isinstance(hdu, fits.GroupsHDU):
        return "random groups"
    if isinstance(hdu, fits.BinTableHDU | fits.TableHDU):
        return "a table"
    shape = getattr(hdu, "shape", ())
    return f"an array of {' x '.join(map(str, shape[::-1]))}" if shape else "empty"


def _image_number(path: Path, hdus: fits.HDUList, hdu: int | None) -> int:
    return _first_image(path, hdus) if hdu is None else _named_image(path, hdus, hdu)


def _first_image(path: Path, hdus: fits.HDUList) -> int:
    contents = []
    for number, hdu in enumerate(islice(hdus, MOST_HDUS)):
        if _is_image(hdu):
            return number
        contents.append(f"HDU {number}: {_what(hdu)}")
    shown = ", ".join(contents[:6]) + (", ..." if len(contents) > 6 else "")
    raise FrameError(path, f"holds no image ({shown})", "give a file with a two- or three-dimensional image")


def _named_image(path: Path, hdus: fits.HDUList, number: int) -> int:
    last = len(hdus) - 1
    if not 0 <= number <= last:
        raise FrameError(path, f"has no HDU {number}", f"choose one from 0 to {last}")
    if not _is_image(hdus[number]):
        problem = f"HDU {number} is not a two- or three-dimensional image but {_what(hdus[number])}"
        raise FrameError(path, problem, "choose another HDU")
    return number


def _stored_type(bitpix: int, scale: float, zero: float) -> np.dtype:
    """Return the type of the numbers stored; FITS says uint16 by a BZERO of 32768."""
    if scale == 1 and bitpix > 8 and zero == 2.0 ** (bitpix - 1):
        return np.dtype(f"u{bitpix // 8}")
    return np.dtype("i1") if (bitpix, scale, zero) == (8, 1, -128) else np.dtype(DTYPES[bitpix])


def _lossy(path: Path, number: int | None) -> list[str]:
    """Warn of a compression that changed the pixels; only the table behind the image says so."""
    with fits.open(path, memmap=False, disable_image_compression=True) as hdus:
        header = hdus[number].header
    columns = {str(value).strip() for key, value in header.items() if key.startswith("TTYPE")}
    method = str(header.get("ZQUANTIZ", "NO_DITHER")).strip()
    if header.get("ZBITPIX", 8) < 0 and "ZSCALE" in columns and method != "NONE":
        return [f"the compression quantised the pixels (ZQUANTIZ = {method}): it is lossy"]
    names = {header[key]: header.get("ZVAL" + key[5:]) for key in header if key.startswith("ZNAME")}
    if str(header.get("ZCMPTYPE")).startswith("HCOMPRESS") and (names.get("SCALE") or 0) > 0:
        return [f"the compression (HCOMPRESS, scale {names['SCALE']:g}) is lossy"]
    return []


def write(path: Path, array: np.ndarray, header: Mapping[str, Any]) -> None:
    """Write an array; see :func:`jitterkit.frames.write_fits`."""
    cards = fits.Header()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fits.verify.VerifyWarning)  # a long comment is cut short
        for keyword, entry in header.items():
            cards.append(_card(keyword, entry), end=True)
        if path.name.lower().endswith(".fz"):
            kind = "RICE_1" if array.dtype.kind in "iu" and array.dtype.itemsize <= 4 else "GZIP_2"
            image = fits.CompImageHDU(array, cards, compression_type=kind, quantize_level=0.0)
            hdus = fits.HDUList([fits.PrimaryHDU(), image])
        else:
            hdus = fits.HDUList([fits.PrimaryHDU(array, cards)])
        hdus.writeto(path)


def _card(keyword: str, entry: Any) -> fits.Card:
    value, comment = entry if isinstance(entry, tuple) else (entry, "")
    value = value.item() if hasattr(value, "item") else value
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        value = fits.card.UNDEFINED
    if isinstance(value, str):
        value = value.encode("ascii", "replace").decode().replace("\n", " ")
    elif not isinstance(value, bool | int | float | fits.card.Undefined):
        value = str(value)
    name = keyword if len(keyword) <= 8 and " " not in keyword else f"HIERARCH {keyword}"
    return fits.Card(name, value, str(comment).encode("ascii", "replace").decode())


def read_extensions(path: Path) -> tuple[dict[str, np.ndarray], Mapping[str, Any]]:
    """Read every named image extension, as the pupil files have them.

    Parameters
    ----------
    path : Path
        Plain, gzipped or tile-compressed.

    Returns
    -------
    images : dict of str to array
        float64, by extension name in upper case.
    header : PlainHeader
        Of the primary HDU.

    Raises
    ------
    FrameError
        If the file cannot be read.
    """
    refuse_endless_header(path)
    with translated(path), fits.open(path, mode="readonly", memmap=False) as hdus:
        named = {hdu.name.upper(): hdu for hdu in hdus[1:] if hdu.name and hdu.is_image}
        images = {name: np.asarray(hdu.data, dtype=float) for name, hdu in named.items()}
        return images, PlainHeader(hdus[0].header)


def read_image(path: Path) -> tuple[np.ndarray, Mapping[str, Any]]:
    """Read the first image of a file as one array, which need not be a frame: a kernel, say.

    Parameters
    ----------
    path : Path
        Plain, gzipped or tile-compressed.

    Returns
    -------
    image : (..., ny, nx) array
        float64, scaled; blank pixels are NaN.
    header : PlainHeader
        Of the same HDU.

    Raises
    ------
    FrameError
        If there is no image, or the file cannot be read.
    """
    refuse_endless_header(path)
    with translated(path), fits.open(path, mode="readonly", memmap=False) as hdus:
        number = _first_image(path, hdus)
        refuse_missing_data(path, number, hdus[number], _is_packed(hdus[number]))
        header = PlainHeader(hdus[number].header)
        return np.asarray(hdus[number].data, dtype=float), header
