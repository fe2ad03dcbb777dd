"""The chain of HDUs of a FITS file, followed with suspicion.

Of a damaged header a reader would look for the end through gigabytes.  :func:`read_hdus` follows the chain by
what :class:`~jitterkit.frames.hdu.Hdu` believes, and :func:`find_images` chooses the images in it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from jitterkit.errors import ErrorCode, FrameError
from jitterkit.frames.damage import damaged, truncated, unpacks_believably
from jitterkit.frames.extensions import Group, frame_groups
from jitterkit.frames.fitsio import header_of
from jitterkit.frames.hdu import BLOCK, Hdu
from jitterkit.frames.plainheader import CARD

__all__ = ["find_images", "read_hdus", "walk"]

_MOST_HEADER_BLOCKS, _MOST_BLOCKS = 1000, 20000
"""Headers of more blocks than this (36,000 cards, read in 0.3 s), or all HDUs together, have no END."""

_MOST_HDUS = 1000
"""So many HDUs are searched."""

_NO_TEXT = re.compile(rb"[^ -~]")


def read_hdus(path: Path, handle: BinaryIO, wanted: int | None) -> tuple[list[Hdu], list[str]]:
    """Read the headers of a file.

    Parameters
    ----------
    path : Path
        The file.
    handle : file object
        Its bytes, unzipped.
    wanted : int, optional
        The HDU that must be readable; by default one with an image.

    Returns
    -------
    hdus : list of Hdu
        Up to 1000.
    warnings : list of str
        Why those behind the image cannot be read.

    Raises
    ------
    FrameError
        If the primary header is none or has no END, or a header up to the image contradicts FITS.
    """
    hdus: list[Hdu] = []
    try:
        for hdu in walk(path, handle):
            hdus.append(hdu)
    except FrameError as error:
        if not any(hdu.is_image and wanted in (None, hdu.number) for hdu in hdus):
            raise
        return hdus, [f"what follows HDU {hdus[-1].number} is not used: {error.problem}"]
    return hdus, []


def walk(path: Path, handle: BinaryIO) -> Iterator[Hdu]:
    """Yield the HDUs of a file one after the other, as :func:`read_hdus` does, with its errors."""
    start, blocks, size = 0, _MOST_BLOCKS, path.stat().st_size
    for number in range(_MOST_HDUS):
        handle.seek(start)
        text, read = _header(handle, min(blocks, _MOST_HEADER_BLOCKS), b"XTENSION" if number else b"SIMPLE")
        if isinstance(text, ErrorCode) and number:
            return
        if text is ErrorCode.UNKNOWN_FORMAT:
            raise FrameError(text, path, "does not begin as a FITS file does", "give a FITS file")
        if isinstance(text, ErrorCode):
            refuse = truncated if text is ErrorCode.TRUNCATED else damaged
            raise refuse(path, "has a FITS header without an END card")
        blocks -= read
        hdu = Hdu(path, handle, number, start, start + read * BLOCK, header_of(text))
        hdu.check()
        yield hdu
        start = hdu.next
        # nothing lies beyond, and to seek there through a gzip may take an hour
        if not unpacks_believably(start, 0, size):
            return


def _header(handle: BinaryIO, most: int, first: bytes) -> tuple[bytes | ErrorCode, int]:
    """Return the cards before END and the number of blocks read; without END, an error code and zero."""
    text = bytearray()
    for number in range(1, most + 1):
        block = handle.read(BLOCK)
        if number == 1 and not block.startswith(first):
            return ErrorCode.TRUNCATED if block and first.startswith(block) else ErrorCode.UNKNOWN_FORMAT, 0
        if not block:
            # a damaged END card is followed by pixels, which are not text
            return ErrorCode.DAMAGED if _NO_TEXT.search(text) else ErrorCode.TRUNCATED, 0
        for found in re.finditer(rb"END {0,5}", block):
            if found.start() % CARD == 0 and not block[found.end() : found.start() + 8]:
                return bytes(text + block[: found.start()]), number
        text += block
    return ErrorCode.DAMAGED, 0


def find_images(path: Path, handle: BinaryIO, wanted: int | None) -> tuple[list[Group], list[Hdu], list[str]]:
    """Find the images asked for, with what belongs to each.

    Parameters and errors are those of :func:`read_hdus`.

    Returns
    -------
    groups : list of Group
        At least one; FrameError is raised where there is none.
    hdus, warnings
        As :func:`read_hdus` returns them.
    """
    hdus, warnings = read_hdus(path, handle, wanted)
    groups, last = frame_groups(hdus, wanted), hdus[-1]
    if groups:
        return groups, hdus, warnings
    if wanted is not None and 0 <= wanted <= last.number:
        problem = f"HDU {wanted} is not a two- or three-dimensional image but {hdus[wanted].what}"
        raise FrameError(ErrorCode.NO_IMAGE, path, problem, "choose another HDU")
    if wanted is None:
        contents = [f"HDU {hdu.number}: {hdu.what}" for hdu in hdus[:6]] + ["..."] * (len(hdus) > 6)
        problem = f"holds no image ({', '.join(contents)})"
        remedy = "give a file with a two- or three-dimensional image"
    else:
        problem, remedy = f"has no HDU {wanted}", f"choose one from 0 to {last.number}"
    if _ends_early(last, handle):
        raise truncated(path, problem)
    raise FrameError(ErrorCode.NO_IMAGE, path, problem, remedy)


def _ends_early(last: Hdu, handle: BinaryIO) -> bool:
    """Return whether a file ends within its last HDU, or within the header of a further one."""
    end = last.data + last.span
    if not unpacks_believably(end, 0, last.path.stat().st_size):
        return True
    handle.seek(end - 1)
    if not handle.read(1):
        return True
    handle.seek(last.next)
    return _header(handle, _MOST_HEADER_BLOCKS, b"XTENSION")[0] is ErrorCode.TRUNCATED
