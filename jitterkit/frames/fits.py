"""FITS in and out; the only module that touches ``astropy.io.fits``.

Reach for :func:`open`.  The chain of HDUs is walked in :mod:`~jitterkit.frames.header_blocks` first, so that
nothing is believed of a header that the file cannot hold.  The pixels are read one plane at a time in
:mod:`~jitterkit.frames.pixels`; headers, tiles and coordinates are astropy's.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from astropy.io import fits

from jitterkit.errors import ErrorCode, FrameError
from jitterkit.frames.checksums import checksum_warnings, read_to_end
from jitterkit.frames.framefile import FrameFile, translated
from jitterkit.frames.hdu import Unit
from jitterkit.frames.header import rate_of_brightness, resolve_header
from jitterkit.frames.header_blocks import ends_early, open_bytes, refuse_missing_data, walk
from jitterkit.frames.metadata import Metadata
from jitterkit.frames.pixels import Pixels
from jitterkit.frames.placed import NONE_MASKED
from jitterkit.frames.plainheader import PlainHeader
from jitterkit.frames.planes import refuse_colour, rows_from_the_top
from jitterkit.frames.sky import turned_over
from jitterkit.frames.units import COUNTS, RATES
from jitterkit.frames.wcs import celestial_wcs

_READABLE = bytes(c if 32 <= c < 127 else ord("?") for c in range(256))
"""For ``bytes.translate``: FITS allows no other bytes in a header."""

_METHODS = ("RICE_1", "RICE_ONE", "GZIP_1", "GZIP_2", "PLIO_1", "HCOMPRESS_1", "NOCOMPRESS")
"""Compression methods that astropy can read."""

__all__ = ["FitsFile", "is_plane", "open", "read_extensions", "read_image", "write"]


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
        self._factor, self._verified = 1.0, False
        with translated(path) as caught:
            self._handle = open_bytes(path)
            try:
                self._choose(*_image_unit(path, self._handle, hdu))
            except BaseException:
                self.close()
                raise
        self.metadata = self.metadata.warn(*caught)

    def _choose(self, unit: Unit, primary: Unit) -> None:
        refuse_missing_data(unit, self._handle)
        self._header, self._pixels = _opened(self._handle, unit)
        header = self._header
        self.hdu, self.dtype = unit.number, self._pixels.dtype
        *planes, ny, nx = unit.shape
        self._count, self.shape = math.prod(planes), (ny, nx)
        wcs, messages = celestial_wcs(header)
        inherit = _header(primary) if unit.number and header.get("INHERIT") is not False else None
        refuse_colour(self.path, unit.shape, header, inherit)
        from_top, odd = rows_from_the_top(header, inherit)
        if wcs is not None and from_top:
            wcs = turned_over(wcs, ny)
        metadata = resolve_header(header, hdu=unit.number, inherit=inherit, wcs=wcs)
        rate = rate_of_brightness(header, metadata.unit, inherit)
        if rate is not None:
            self._factor, known = rate
            metadata = metadata.override(known.source, unit=known)
        elif metadata.value("unit", "adu") not in COUNTS + RATES:
            odd.append(f"the pixels are in {metadata.value('unit')}, which is neither ADU nor electrons")
        lossy = _lossy(unit, header) if unit.packed else []
        metadata = metadata.warn(*header.warnings, *messages, *lossy, *odd)
        self.metadata = metadata.reordered(-1) if from_top else metadata

    def _read(self, index: int) -> tuple[np.ndarray, np.ndarray, Metadata]:
        data, blank = self._pixels.plane(index)
        self._verify()
        mask = NONE_MASKED if blank is None else blank
        if self._factor != 1.0:
            data *= self._factor
        if self.metadata.row_order == -1:
            data, mask = np.ascontiguousarray(data[::-1]), mask[::-1] if mask.ndim else mask
        return data, mask, self.metadata

    def _verify(self) -> None:
        """Hold the file against its checksums when its first frame is read."""
        if not self._verified:
            wrong = checksum_warnings(self._handle, self._pixels.unit, self._header)
            read_to_end(self._handle)
            self.metadata, self._verified = self.metadata.warn(*wrong), True

    def close(self) -> None:
        """Close the file."""
        self._handle.close()


def open(path: Path, hdu: int | None = None) -> FitsFile:
    """Open a FITS file; see :class:`FitsFile`."""
    return FitsFile(path, hdu)


def is_plane(path: Path, hdu: int | None = None) -> bool:
    """Tell from the layout of a file alone whether it holds one frame; errors are those of :func:`open`."""
    with translated(path), open_bytes(path) as handle:
        *planes, _, _ = _image_unit(path, handle, hdu)[0].shape
        return math.prod(planes) == 1


def _image_unit(path: Path, handle: BinaryIO, hdu: int | None) -> tuple[Unit, Unit]:
    """The HDU of the image asked for, and the primary HDU."""
    units: list[Unit] = []
    for unit in walk(path, handle):
        units.append(unit)
        if unit.number == hdu or (hdu is None and unit.is_image):
            break
    last = units[-1]
    if last.is_image and hdu in (None, last.number):
        return last, units[0]
    if hdu == last.number:
        problem = f"HDU {hdu} is not a two- or three-dimensional image but {last.what}"
        raise FrameError(ErrorCode.NO_IMAGE, path, problem, "choose another HDU")
    if hdu is None:
        contents = [f"HDU {unit.number}: {unit.what}" for unit in units[:6]] + ["..."] * (len(units) > 6)
        problem = f"holds no image ({', '.join(contents)})"
        remedy = "give a file with a two- or three-dimensional image"
    else:
        problem, remedy = f"has no HDU {hdu}", f"choose one from 0 to {last.number}"
    if ends_early(last, handle):
        raise FrameError(ErrorCode.TRUNCATED, path, problem, "it is truncated: copy it again")
    raise FrameError(ErrorCode.NO_IMAGE, path, problem, remedy)


def _header(unit: Unit) -> PlainHeader:
    text = unit.text.translate(_READABLE).decode()
    header = PlainHeader(fits.Header.fromstring(text), text)
    if text.encode() != unit.text:
        header.warnings.append("the header holds bytes that are no text; read as '?'")
    return header


def _opened(handle: BinaryIO, unit: Unit) -> tuple[PlainHeader, Pixels]:
    """The header of an image and its pixels; tiles are left to astropy."""
    header = _header(unit)
    if not unit.packed:
        return header, Pixels(handle, unit, header)
    method = header.get("ZCMPTYPE")
    if isinstance(method, str) and method not in _METHODS:
        problem = f"HDU {unit.number} uses {method[:40]!r} compression, which is not read"
        raise FrameError(ErrorCode.UNSUPPORTED_ENCODING, unit.path, problem, "save the image uncompressed")
    handle.seek(0)
    tables = fits.open(handle, memmap=False, disable_image_compression=True)
    table = tables[unit.number]
    if "BLANK" not in header:  # one without a value astropy would compare with
        table.header.remove("BLANK", ignore_missing=True, remove_all=True)
    image = fits.CompImageHDU(bintable=table, do_not_scale_image_data=True)
    return header, Pixels(handle, unit, header, image)


def _lossy(unit: Unit, header: PlainHeader) -> list[str]:
    """Warn of a compression that changed the pixels; only the table behind the image says so."""
    columns = [str(header.get(f"TTYPE{n}")).strip() for n in range(1, unit.whole("TFIELDS") + 1)]
    method = str(header.get("ZQUANTIZ", "NO_DITHER")).strip()
    if unit.bitpix < 0 and "ZSCALE" in columns and method != "NONE":
        return [f"the compression quantised the pixels (ZQUANTIZ = {method}): it is lossy"]
    options = {str(header.get(f"ZNAME{n}")).strip(): header.get(f"ZVAL{n}") for n in range(1, 10)}
    scale = options.get("SCALE")
    if str(header.get("ZCMPTYPE")).startswith("HCOMPRESS") and isinstance(scale, int | float) and scale > 0:
        return [f"the compression (HCOMPRESS, scale {scale:g}) is lossy"]
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
    with translated(path), open_bytes(path) as handle:
        units = list(walk(path, handle))
        images = {}
        for unit in units[1:]:
            name = str(_header(unit).get("EXTNAME", "")).strip().upper()
            if name and unit.what.startswith("an array"):
                images[name] = _everything(handle, unit)[0]
        return images, _header(units[0])


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
    with translated(path), open_bytes(path) as handle:
        return _everything(handle, _image_unit(path, handle, None)[0])


def _everything(handle: BinaryIO, unit: Unit) -> tuple[np.ndarray, PlainHeader]:
    refuse_missing_data(unit, handle)
    header, pixels = _opened(handle, unit)
    return pixels.everything(), header
