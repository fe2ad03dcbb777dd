"""Which pages of a TIFF are frames, held with suspicion against the file that has them.

A TIFF is a linked list of directories, so a damaged one may loop or point anywhere: :func:`full_pages`
follows the links without reading pixels.  Then :func:`refuse_unusable` looks at a page, and
:func:`refuse_missing_data` before its pixels are decoded.  No TIFF library is needed: a page is any object
with the attributes of tifffile's.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from jitterkit.errors import ErrorCode, FrameError
from jitterkit.frames.files import GZIP, damaged, in_colour, refuse_giant, truncated, unpacks_believably
from jitterkit.frames.framefile import one_line

#: How stored rows and columns become rows upwards and columns rightwards, by the Orientation tag.
ORIENTATIONS: dict[int, Callable[[np.ndarray], np.ndarray]] = {
    1: lambda a: a[::-1],
    2: lambda a: a[::-1, ::-1],
    3: lambda a: a[:, ::-1],
    4: lambda a: a,
    5: lambda a: a.T[::-1],
    6: lambda a: a.T[::-1, ::-1],
    7: lambda a: a.T[:, ::-1],
    8: lambda a: a.T,
}

CHANNELS = {"RGB": "red, green, blue", "CMYK": "cyan, magenta, yellow, black", "YCBCR": "luma and two chroma"}
#: Tiles of less than this, in bytes, may be larger than their image.
SMALL_TILE = 1 << 24

NEW_SUBFILE_TYPE = 254
#: Bits of NewSubfileType: a thumbnail, and a transparency mask.
NOT_A_FRAME = 0b101


def full_pages(path: Path) -> list[int]:
    """Return the indices, in the chain, of the pages that are full-size images.

    Raises
    ------
    FrameError
        If the chain loops, overlaps itself, leaves the file, or has no such page.
    """
    pages = [page for page, subfile in enumerate(_subfiles(path)) if not subfile & NOT_A_FRAME]
    if not pages:
        raise FrameError(ErrorCode.NO_IMAGE, path, "holds no full-size page", "give a TIFF with an image")
    return pages


def _subfiles(path: Path) -> Iterator[int]:
    """Yield the NewSubfileType of each directory of the chain."""
    size, read = path.stat().st_size, 0
    seen: set[int] = set()
    with path.open("rb") as handle:
        head = handle.read(16)
        if head.startswith(GZIP):
            problem, remedy = "is a gzipped TIFF, which is not read", "unpack it with gunzip"
            raise FrameError(ErrorCode.UNSUPPORTED_ENCODING, path, problem, remedy)
        number = partial(int.from_bytes, byteorder="little" if head.startswith(b"II") else "big")
        big = number(head[2:4]) == 43
        width, entry, link = (8, 20, 8) if big else (2, 12, 4)
        if size < 2 * link:
            raise truncated(path, f"ends after {size} bytes, within its header")
        offset = number(head[8:16] if big else head[4:8])
        while offset:
            page = f"page {len(seen)}"
            if offset in seen:
                raise damaged(path, f"{page} points back to an earlier page")
            if offset >= size:
                raise truncated(path, f"{page} lies beyond the end of the file")
            seen.add(offset)
            handle.seek(offset)
            count = handle.read(width)
            entries = number(count) if len(count) == width else 0
            if not 0 < entries <= 65535:
                refuse = damaged if len(count) == width else truncated
                raise refuse(path, f"{page} has a directory of {entries} entries")
            data, length = handle.read(entries * entry + link), entries * entry
            if len(data) < length:
                raise truncated(path, f"{page} has a directory cut short")
            read += width + length
            if read > size:
                raise damaged(path, f"{page} has a directory that overlaps others")
            # tags are sorted and 254 is the lowest in use, so it is the first where it is present
            yield number(data[entry - link :][:4]) if number(data[:2]) == NEW_SUBFILE_TYPE else 0
            offset = number(data[length:]) if len(data) == length + link else 0


def orientation_of(page: Any) -> int:
    """The Orientation tag, whatever stands in it; 1 where there is none."""
    return page.tags.valueof("Orientation", 1)


_NO_DATA = 42113
"""Tag of GDAL_NODATA, a number in ASCII."""


def no_data(page: Any) -> float | None:
    """Return the number that stands for a pixel without a value (GDAL_NODATA), None where there is none."""
    try:
        return float(np.dtype(page.dtype).type(float(page.tags.valueof(_NO_DATA, ""))))
    except (TypeError, ValueError, OverflowError):
        return None


_MICRO_MANAGER = 51123
"""Tag of what Micro-Manager says of a page."""

_EXPOSURE = re.compile(
    r"\b(exposure|integration)[ _-]?\w*( ?[([]\w+[)\]])?[\"']?\s*[:=]\s*[\d.]+( ?[a-zµμ]+\b)?", re.I
)


def exposure_in_words(page: Any, imagej: Mapping[str, Any]) -> str:
    """Return what the texts of a page say of its exposure, which no standard defines; empty if nothing."""
    texts = (
        page.tags.valueof("ImageDescription", ""),
        page.tags.valueof(_MICRO_MANAGER, ""),
        imagej.get("Info", ""),
    )
    found = (_EXPOSURE.search(str(text)) for text in texts)
    return next((one_line(one[0]) for one in found if one), "")


CURVES = {
    291: "GrayResponseCurve", 301: "TransferFunction", 34675: "an ICC profile", 50712: "LinearizationTable",
    50714: "BlackLevel",
}  # fmt: skip
"""Tags (TIFF 6.0, DNG) of numbers that are not proportional to the light, or may be not."""


def curve_warnings(page: Any) -> list[str]:
    """Warn of tags that give stored numbers another meaning, and are not read."""
    found = [name for code, name in CURVES.items() if page.tags.get(code) is not None]
    return [
        f"the TIFF has {name}: its numbers, taken as stored, may not be linear from zero" for name in found
    ]


_STRAIGHT, _NO_FUNCTION = 0, 20
"""Functions of ImageJ's calibration of values (ij.measure.Calibration)."""


def calibration_line(imagej: Mapping[str, Any]) -> tuple[tuple[float, float] | None, list[str]]:
    """Find how ImageJ turns the stored numbers into those that it shows.

    Parameters
    ----------
    imagej : mapping
        Its description of the image: the function ``cf``, and the coefficients ``c0`` and ``c1``.

    Returns
    -------
    line : (float, float) or None
        Offset and slope; None without a calibration.  ImageJ gives signed integers of 16 bits -32768 and 1.
    warnings : list of str
        Of a calibration by a curve, which is not applied, and of a slope, which changes gain and read noise.
    """
    function, offset, slope = imagej.get("cf", _NO_FUNCTION), imagej.get("c0", 0.0), imagej.get("c1", 1.0)
    if function == _NO_FUNCTION:
        return None, []
    numbers = isinstance(offset, int | float) and isinstance(slope, int | float) and slope != 0
    if function != _STRAIGHT or not numbers:
        return None, [f"ImageJ's calibration by a curve (cf = {function}) is not applied to the numbers"]
    said = f"ImageJ's calibration ({offset:g} + {slope:g} x the stored numbers) is applied"
    return (offset, slope), [f"{said}: gain and saturation are those of its results"] * (slope != 1)


def is_smaller_copy(sides: tuple[int, int], full: tuple[int, int]) -> bool:
    """Return whether a page of such sides may be a thumbnail of another: of its shape, and smaller."""
    if 0 in sides or sides[0] * _THUMBNAIL > full[0]:
        return False
    step = full[0] / sides[0]
    return abs(sides[1] * step - full[1]) <= step


_THUMBNAIL = 1.5
"""Ratio of sides from which a page may be a thumbnail; overscan changes them by less."""


def refuse_unusable(path: Path, page: Any) -> None:
    """Raise FrameError for a page that is no frame: in colour, without pixels, or with senseless tags.

    Parameters
    ----------
    path : Path
        The file.
    page : tifffile.TiffPage
    """
    photometric = getattr(page.photometric, "name", str(page.photometric))
    for name in ("imagewidth", "imagelength", "imagedepth", "samplesperpixel"):
        if not isinstance(getattr(page, name), int | np.integer):
            raise damaged(path, f"has {name} = {_brief(getattr(page, name))}, which is not a whole number")
    if page.imagelength < 1 or page.imagewidth < 1:
        raise damaged(path, f"has a page of {page.imagewidth} x {page.imagelength} pixels")
    if page.samplesperpixel > 1:
        names = CHANNELS.get(photometric, "grey") + (", alpha" if page.extrasamples else "")
        raise in_colour(path, page.samplesperpixel, names)
    if photometric == "PALETTE":
        raise FrameError(ErrorCode.COLOUR, path, "has palette colours", "convert it to one channel of grey")
    problem = ""
    if page.dtype is None or np.dtype(page.dtype).kind not in "uif":
        problem = f"has {_brief(page.bitspersample)} bits per sample of format {_brief(page.sampleformat)}"
        remedy = "convert it to 8, 16 or 32 bits or to floating point"
    elif orientation_of(page) not in ORIENTATIONS:
        problem = f"has the unknown Orientation {_brief(orientation_of(page))}"
        remedy = "save it top row first"
    elif page.imagedepth > 1:
        problem, remedy = f"has {page.imagedepth} layers in a page", "save one layer in each page"
    if problem:
        raise FrameError(ErrorCode.UNSUPPORTED_ENCODING, path, problem, remedy)


def refuse_missing_data(path: Path, page: Any, size: int) -> None:
    """Raise FrameError where the pixels a page declares cannot all be there, before anything is allocated.

    Parameters
    ----------
    path : Path
        The file.
    page : tifffile.TiffPage
        One that is usable.
    size : int
        Of the file [bytes].
    """
    ends = [o + n for o, n in zip(page.dataoffsets, page.databytecounts, strict=False) if n]
    stored, pixels = sum(page.databytecounts), page.imagelength * page.imagewidth
    plain = page.compression == 1 and page.bitspersample in (8, 16, 32, 64)
    beyond = not ends or max(ends) > size
    if beyond or (page.nbytes > stored if plain else not unpacks_believably(page.nbytes, pixels, stored)):
        # a writer that was interrupted leaves counts of zero
        refuse = truncated if beyond or 0 in page.databytecounts else damaged
        raise refuse(
            path, f"page {page.index} declares {page.nbytes} bytes and the file of {size} bytes lacks them"
        )
    refuse_giant(path, f"page {page.index}", page.imagewidth, page.imagelength)
    tile = math.prod(page.chunks) * np.dtype(page.dtype).itemsize
    if tile > max(SMALL_TILE, 4 * page.nbytes):
        shown = f"tiles of {' x '.join(map(str, page.chunks[::-1]))}"
        image = f"{page.imagewidth} x {page.imagelength} pixels"
        raise damaged(path, f"page {page.index} declares {shown} in {image}")


def _brief(value: object) -> str:
    """The beginning of what a damaged tag holds: it may be thousands of numbers."""
    return one_line(repr(value))[:40]
