"""TIFF in and out; the only module that touches ``tifffile``.

Pages are frames.  A TIFF stores its top row first while our row index grows upwards, so images are
flipped here, in both directions, and every Orientation is honoured.  Before tifffile sees a file its
chain of directories is walked: a chain that loops, or leaves the file, is refused at once.
"""

from __future__ import annotations

import logging
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import tifffile

from jitterkit.errors import ErrorCode, FrameError
from jitterkit.frames import pages
from jitterkit.frames.altered import scaled_up
from jitterkit.frames.files import truncated
from jitterkit.frames.frame import RawFrame
from jitterkit.frames.framefile import FrameFile, overheard, translated
from jitterkit.frames.metadata import Metadata
from jitterkit.frames.planes import roles_of_labels
from jitterkit.frames.sidecar import read_sidecars
from jitterkit.frames.units import factor

_LOG = logging.getLogger("tifffile")

ROW_ORDERS = {1: -1, 2: -1, 3: 1, 4: 1}
"""Rows upwards are the stored rows as they come (1) or turned over (-1); else they are columns (0)."""


_MOST_NAMED = 99
"""Pages whose names are read when a file is opened: each takes a tenth of a millisecond."""


class TiffFile(FrameFile):
    """The frames of a TIFF: its full-size pages, or the planes behind a single page of ImageJ or MetaMorph.

    Parameters
    ----------
    path : Path
        Classic or BigTIFF, of either byte order.
    hdu : int, optional
        A TIFF has none, so naming one is refused.

    Raises
    ------
    FrameError
        If it is in colour, has no usable pages, or is damaged.
    ConfigurationError
        If a TOML beside it cannot be used.
    """

    kind = "TIFF"

    def __init__(self, path: Path, hdu: int | None) -> None:
        if hdu is not None:
            problem = f"is a TIFF and has no HDU {hdu}"
            raise FrameError(ErrorCode.NO_IMAGE, path, problem, "leave the HDU out")
        super().__init__(path)
        with translated(path):
            self._pages = pages.full_pages(path)
        with translated(path) as caught, overheard(_LOG) as talk:
            self._tiff = self.enter_context(tifffile.TiffFile(path))
            try:
                page = self._page(0)
                self._planes = _planes_behind(path, self._tiff, page) if len(self._pages) == 1 else None
                self._count = len(self._pages) if self._planes is None else self._planes
                # where an ImageJ stack is cut short tifffile falls back to its first plane
                declared = int((self._tiff.imagej_metadata or {}).get("images", 1))
                _refuse_missing_planes(path, declared, self._count)
                ny, nx = page.imagelength, page.imagewidth
                self.shape = (ny, nx) if pages.orientation_of(page) < 5 else (nx, ny)
                self.dtype = np.dtype(page.dtype).newbyteorder("=")
                sidecars = read_sidecars(path).reordered(ROW_ORDERS.get(pages.orientation_of(page), 0))
                self._no_data = pages.no_data(page)
                self._line, unclear = pages.calibration_line(self._tiff.imagej_metadata or {})
                odd = (*unclear, *pages.curve_warnings(page), *self._size_warnings(), *self._label_warnings())
                self.metadata = _own_metadata(self._tiff, page, sidecars).warn(*odd)
            except BaseException:
                self.close()
                raise
        self.metadata = self.metadata.warn(*caught, *talk)

    def _size_warnings(self) -> list[str]:
        """Warn of pages that may be smaller copies of another, and not marked as such."""
        named = (self._tiff.pages[number] for number in self._pages[:_MOST_NAMED])
        sides = [(getattr(page, "imagelength", 0), getattr(page, "imagewidth", 0)) for page in named]
        copies = [str(index) for index, one in enumerate(sides) if pages.is_smaller_copy(one, max(sides))]
        said = f"pages {', '.join(copies[:9])} have the shape of a larger page: if they are its thumbnails"
        return [f"{said}, their plate scale is another one"] * bool(copies)

    def _label_warnings(self) -> list[str]:
        """Warn of planes or pages whose labels say that they are no images."""
        labels = [str(label) for label in (self._tiff.imagej_metadata or {}).get("Labels", [])]
        if not labels and self._planes is None and self._count <= _MOST_NAMED:
            tags = (getattr(self._tiff.pages[number], "tags", None) for number in self._pages)
            labels = [str(one.valueof("PageName", "")) if one else "" for one in tags]
        roles = roles_of_labels(labels) if len(labels) == self._count else []
        odd = [repr(label) for label, role in zip(labels, roles, strict=False) if role not in ("image", "")]
        return [f"planes that are no images by their labels are frames: {', '.join(odd[:9])}"] * bool(odd)

    def _page(self, index: int) -> Any:
        page = self._tiff.pages[self._pages[index]]
        pages.refuse_unusable(self.path, page)
        return page

    def _read(self, index: int) -> RawFrame:
        with overheard(_LOG) as talk:
            page = self._page(index if self._planes is None else 0)
            if self._planes is None:
                pages.refuse_missing_data(self.path, page, self._tiff.filehandle.size)
                stored = _decode(self.path, page)
            else:
                ny, nx = page.imagelength, page.imagewidth
                dtype = np.dtype(page.dtype).newbyteorder(self._tiff.byteorder)
                start = self._tiff.series[0].dataoffset + index * ny * nx * dtype.itemsize
                plane = self._tiff.filehandle.read_array(dtype, count=ny * nx, offset=start)
                stored = plane.reshape(ny, nx)
        upright = pages.ORIENTATIONS[pages.orientation_of(page)](stored)
        data = np.ascontiguousarray(upright, dtype=np.float64)
        if self._no_data is not None:
            data[data == self._no_data] = np.nan
        talk += scaled_up(data, self.metadata)
        if self._line is not None:
            data = self._line[0] + self._line[1] * data
        return RawFrame(data, metadata=self.metadata.warn(*talk), variance_source="")


def _decode(path: Path, page: Any) -> np.ndarray:
    try:
        return page.asarray().reshape(page.imagelength, page.imagewidth)
    except Exception as error:
        packing = getattr(page.compression, "name", str(page.compression)).lower()
        packing = f"{page.bitspersample}-bit packing" if packing == "none" else f"{packing} compression"
        if "imagecodecs" in str(error):
            problem = f"uses {packing}, which needs the imagecodecs package"
            remedy = "install it (pip install imagecodecs) or save the image uncompressed"
            raise FrameError(ErrorCode.MISSING_PACKAGE, path, problem, remedy) from error
        if isinstance(page.compression, int) and page.compression not in tifffile.TIFF.DECOMPRESSORS:
            problem, remedy = f"uses {packing}, which is not read", "save the image uncompressed"
            raise FrameError(ErrorCode.UNSUPPORTED_ENCODING, path, problem, remedy) from error
        raise


def _planes_behind(path: Path, tiff: tifffile.TiffFile, page: Any) -> int | None:
    """Count the planes that lie contiguously behind a single page, as ImageJ and MetaMorph write stacks."""
    # only these write so; asking OME for its series would open the other files of a set
    written = tiff.is_imagej or tiff.is_shaped or tiff.is_stk
    series = tiff.series[0] if written and tiff.series else None
    plane = page.imagelength * page.imagewidth
    if series is None or series.size <= plane:
        return None
    if series.dataoffset is None or series.size % plane or series.dtype != page.dtype:
        problem = "holds a stack not stored plane by plane"
        raise FrameError(ErrorCode.UNSUPPORTED_ENCODING, path, problem, "save one frame in each page")
    declared, left = series.size // plane, tiff.filehandle.size - series.dataoffset
    _refuse_missing_planes(path, declared, max(left // page.nbytes, 0))
    return declared


def _refuse_missing_planes(path: Path, declared: int, present: int) -> None:
    if declared > present:
        raise truncated(path, f"declares {declared} frames and holds {present}")


def _own_metadata(tiff: tifffile.TiffFile, page: Any, metadata: Metadata) -> Metadata:
    """Add to the sidecars what the TIFF itself says about exposure and colour."""
    exif, source, exposure = page.tags.get("ExifTag"), "OME", None
    ratio = exif.value.get("ExposureTime") if exif is not None and isinstance(exif.value, dict) else None
    text = tiff.ome_metadata or ""
    times = set(re.findall(r'ExposureTime="([\d.eE+-]+)"', text))
    units = set(re.findall(r'ExposureTimeUnit="([^"]+)"', text)) or {"s"}
    if isinstance(ratio, tuple) and len(ratio) == 2 and ratio[1]:
        source, exposure = "EXIF", ratio[0] / ratio[1]
    elif len(times) > 1 or len(units) > 1:
        exposure = math.nan
    elif times and (seconds := factor("exposure", units.pop())):
        exposure = float(times.pop()) * float(seconds)
    if exposure is not None and exposure > 0:
        metadata = metadata.fill(f"header {source} ExposureTime", exposure=exposure)
    elif exposure is not None and metadata.exposure is None:
        metadata = metadata.warn("the planes differ in their OME ExposureTime, which is ignored")
    elif metadata.exposure is None and (found := pages.exposure_in_words(page, tiff.imagej_metadata or {})):
        metadata = metadata.warn(f"{found!r} in the TIFF is not read: give --exposure if it is needed")
    channels = (
        (tiff.imagej_metadata or {}).get("channels", 1),
        *re.findall(r'SizeC="(\d+)"', tiff.ome_metadata or ""),
    )
    if any(int(number) > 1 for number in channels):
        metadata = metadata.warn("the TIFF has channels, which may be colours: they are taken for frames")
    name = getattr(page.photometric, "name", "")
    if name == "MINISWHITE":
        metadata = metadata.warn("the TIFF says that zero is white; the numbers are taken as stored")
    if name == "CFA":
        metadata = metadata.warn("the TIFF says that its pixels lie behind a colour mosaic")
    return metadata


def write(path: Path, array: np.ndarray) -> None:
    """Write an array, top row first; see :func:`jitterkit.frames.write_tiff`."""
    planes = array if array.ndim == 3 else array[None]
    with tifffile.TiffWriter(path, bigtiff=array.nbytes > 3 << 30) as tiff:
        for plane in planes:
            top_first = np.ascontiguousarray(plane[::-1])
            tiff.write(top_first, photometric="minisblack", metadata=None, contiguous=False)
