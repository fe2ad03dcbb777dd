"""What a page of a TIFF must be to be a frame, held against the file that has it.

Reach for :func:`refuse_unusable` first and for :func:`refuse_missing_data` before pixels are decoded.  No
TIFF library is needed here: a page is any object with the attributes of tifffile's.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from jitterkit.errors import ErrorCode, FrameError
from jitterkit.frames.damage import damaged, in_colour, refuse_giant, truncated, unpacks_believably
from jitterkit.frames.framefile import one_line

__all__ = ["ORIENTATIONS", "orientation_of", "refuse_missing_data", "refuse_unusable"]

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


def orientation_of(page: Any) -> int:
    """The Orientation tag, whatever stands in it; 1 where there is none."""
    tag = page.tags.get("Orientation")
    return 1 if tag is None else tag.value


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
