"""FITS in and out; the only module that touches ``astropy.io.fits``.

Reach for :func:`open`.  The chain of HDUs is walked in :mod:`~jitterkit.frames.header_blocks` first, so that
nothing is believed of a header that the file cannot hold.  The pixels are read one plane at a time in
:mod:`~jitterkit.frames.pixels`; headers, tiles and coordinates are astropy's.
"""

from __future__ import annotations

import bisect
import itertools
import math
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from astropy.io import fits

from jitterkit.errors import ErrorCode, FrameError
from jitterkit.frames.checksums import checksum_warnings, read_to_end
from jitterkit.frames.extensions import Group, Named, frame_groups
from jitterkit.frames.files import files_beside
from jitterkit.frames.fitsimage import FitsImage
from jitterkit.frames.framefile import FrameFile, Planes, translated
from jitterkit.frames.hdu import Unit
from jitterkit.frames.header_blocks import ends_early, open_bytes, refuse_missing_data, walk
from jitterkit.frames.pixels import Pixels
from jitterkit.frames.plainheader import PlainHeader

_READABLE = bytes(c if 32 <= c < 127 else ord("?") for c in range(256))
"""For ``bytes.translate``: FITS allows no other bytes in a header."""

_METHODS = ("RICE_1", "RICE_ONE", "GZIP_1", "GZIP_2", "PLIO_1", "HCOMPRESS_1", "NOCOMPRESS")
"""Compression methods that astropy can read."""

__all__ = [
    "FitsFile",
    "hdu_chain",
    "header_of",
    "image_groups",
    "is_plane",
    "open",
    "pixels_of",
    "write",
]


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
        self._handles: dict[Path, BinaryIO] = {}
        self._images: dict[int, FitsImage] = {}
        self._verified: set[int] = set()
        with translated(path) as caught:
            try:
                self._hdus, broken = hdu_chain(path, self._handle(path), hdu)
                self._groups = image_groups(path, self._handle(path), self._hdus, hdu)
                self._add_files_beside()
                self._starts = [0, *itertools.accumulate(map(_planes, self._groups))]
                self._count = self._starts[-1]
                first = self._image(0)
            except BaseException:
                self.close()
                raise
        self.hdu, self.shape, self.dtype = first.number, first.shape, first.dtype
        self.metadata = first.metadata.warn(*broken, *caught)

    def _handle(self, path: Path) -> BinaryIO:
        if path not in self._handles:
            self._handles[path] = open_bytes(path)
        return self._handles[path]

    def _add_files_beside(self) -> None:
        for role, other in files_beside(self.path):
            hdus, _ = hdu_chain(other, self._handle(other), None)
            for group in self._groups:
                group.add_from(role, hdus)

    def _image(self, number: int) -> FitsImage:
        if number not in self._images:
            group = self._groups[number]
            self._images[number] = FitsImage(group, self._hdus[0].header, self._opened, self._tables)
        return self._images[number]

    def _opened(self, named: Named) -> Pixels:
        handle = self._handle(named.unit.path)
        refuse_missing_data(named.unit, handle)
        pixels = pixels_of(handle, named)
        if named.unit.packed and named.role == "":
            named.header.warnings += _lossy(named.unit, named.header)
        return pixels

    def _tables(self) -> Any:
        handle = self._handle(self.path)
        handle.seek(0)
        return fits.open(handle, memmap=False)

    def _read(self, index: int) -> Planes:
        number = bisect.bisect_right(self._starts, index) - 1
        image = self._image(number)
        read = image.read(index - self._starts[number])
        self._verify(number, image)
        extra = self.metadata.warnings if number == 0 else ()
        return read._replace(metadata=read.metadata.warn(*image.metadata.warnings, *extra))

    def _verify(self, number: int, image: FitsImage) -> None:
        """Compare the HDUs of an image with their checksums when its first plane is read."""
        if number in self._verified:
            return
        wrong = []
        for pixels in image.used:
            handle = self._handle(pixels.unit.path)
            wrong += checksum_warnings(handle, pixels.unit, pixels.header)
            read_to_end(handle)
        image.metadata = image.metadata.warn(*wrong)
        self.metadata = self.metadata.warn(*wrong) if number == 0 else self.metadata
        self._verified.add(number)

    def _stacking(self) -> str:
        shared = any(_planes(group) > 1 and group.coordinates is None for group in self._groups)
        return "planes of one header" if shared else ""

    def _contents(self) -> list[tuple[str, str, str, str]]:
        if len(self._hdus) == 1:
            return []
        uses = {number: use for group in self._groups for number, use in group.units.items()}
        return [(one.title, one.unit.what, "", uses.get(one.unit.number, "not used")) for one in self._hdus]

    def close(self) -> None:
        """Close the file."""
        for handle in self._handles.values():
            handle.close()


def open(path: Path, hdu: int | None = None) -> FitsFile:
    """Open a FITS file; see :class:`FitsFile`."""
    return FitsFile(path, hdu)


def is_plane(path: Path, hdu: int | None = None) -> bool:
    """Tell from the layout of a file alone whether it holds one frame; errors are those of :func:`open`."""
    with translated(path), open_bytes(path) as handle:
        groups = image_groups(path, handle, hdu_chain(path, handle, hdu)[0], hdu)
        return len(groups) == 1 and _planes(groups[0]) == 1


def _planes(group: Group) -> int:
    return math.prod(group.image.unit.shape[:-2])


def hdu_chain(path: Path, handle: BinaryIO, hdu: int | None) -> tuple[list[Named], list[str]]:
    """All HDUs of a file, and a warning where those behind the image cannot be read."""
    hdus: list[Named] = []
    try:
        for unit in walk(path, handle):
            _ = unit.span, unit.bitpix, unit.is_image  # refuse what cannot be
            hdus.append(Named(unit, header_of(unit)))
    except FrameError as error:
        if not any(one.unit.is_image and hdu in (None, one.unit.number) for one in hdus):
            raise
        return hdus, [f"what follows HDU {hdus[-1].unit.number} is not used: {error.problem}"]
    return hdus, []


def image_groups(path: Path, handle: BinaryIO, hdus: list[Named], hdu: int | None) -> list[Group]:
    """The images asked for, with what belongs to each."""
    groups = frame_groups(hdus, hdu)
    if groups:
        return groups
    units, last = [one.unit for one in hdus], hdus[-1].unit
    if hdu is not None and 0 <= hdu <= last.number:
        problem = f"HDU {hdu} is not a two- or three-dimensional image but {units[hdu].what}"
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


def header_of(unit: Unit) -> PlainHeader:
    text = unit.text.translate(_READABLE).decode()
    header = PlainHeader(fits.Header.fromstring(text), text)
    if text.encode() != unit.text:
        header.warnings.append("the header holds bytes that are no text; read as '?'")
    return header


def pixels_of(handle: BinaryIO, named: Named) -> Pixels:
    """The pixels of an image; tiles are left to astropy."""
    unit, header = named.unit, named.header
    if not unit.packed:
        return Pixels(handle, unit, header)
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
    return Pixels(handle, unit, header, image)


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
