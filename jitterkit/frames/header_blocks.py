"""The chain of HDUs of a FITS file, walked with suspicion.

Of a damaged header a reader would look for the end through gigabytes, count to a NAXIS of billions, or
allocate terabytes.  :func:`walk` follows the chain by the few keywords that FITS lays down for it, and gives
one :class:`~jitterkit.frames.hdu.Unit` after the other; :func:`refuse_missing_data` is for the one whose
pixels are wanted.  No FITS library is needed here: bytes and sizes are enough.
"""

from __future__ import annotations

import gzip
import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from jitterkit.errors import ErrorCode, FrameError
from jitterkit.frames.files import GZIP
from jitterkit.frames.hdu import CARD, DAMAGED, MOST_AXES, Unit, product_of
from jitterkit.frames.sizes import refuse_giant, unpacks_believably

__all__ = ["ends_early", "open_bytes", "refuse_missing_data", "walk"]

BLOCK = 2880
#: Headers of more blocks than this (36,000 cards, read in 0.3 s), or all HDUs together, have no END.
MOST_HEADER_BLOCKS, MOST_BLOCKS = 1000, 20000
#: So many HDUs are searched.
MOST_HDUS = 1000
#: A tile may be larger than its image, up to this side [pixel].
MOST_TILE = 1 << 16
#: Deflate packs at most 1032 to 1.
MOST_PACKING = 1100

_NO_TEXT = re.compile(rb"[^ -~]")


def open_bytes(path: Path) -> BinaryIO:
    """Open a file for its bytes, unzipped where it is gzipped."""
    handle = path.open("rb")
    if not handle.peek(len(GZIP)).startswith(GZIP):
        return handle
    handle.close()
    return gzip.open(path)  # type: ignore[return-value]


def walk(path: Path, handle: BinaryIO) -> Iterator[Unit]:
    """Follow the chain of HDUs.

    Parameters
    ----------
    path : Path
        The file.
    handle : file object
        Its bytes, unzipped; may be moved while the walk rests.

    Yields
    ------
    unit : Unit
        Up to 1000.

    Raises
    ------
    FrameError
        If the primary header is none or has no END, or a header contradicts FITS.
    """
    start, blocks = 0, MOST_BLOCKS
    for number in range(MOST_HDUS):
        handle.seek(start)
        text, read = _header(handle, min(blocks, MOST_HEADER_BLOCKS), b"XTENSION" if number else b"SIMPLE")
        if text is ErrorCode.UNKNOWN_FORMAT and number == 0:
            raise FrameError(text, path, "does not begin as a FITS file does", "give a FITS file")
        if isinstance(text, ErrorCode) and number == 0:
            raise FrameError(text, path, "has a FITS header without an END card", DAMAGED)
        if isinstance(text, ErrorCode):
            return
        blocks -= read
        unit = Unit(path, number, start, start + read * BLOCK, text)
        if number == 0 and unit.structure.get("SIMPLE") != b"T":
            problem = "has a damaged primary header (SIMPLE is not T)"
            raise FrameError(ErrorCode.DAMAGED, path, problem, DAMAGED)
        if not 0 <= unit.whole("TFIELDS", 0) <= MOST_AXES:
            problem = f"HDU {number} declares TFIELDS = {unit.whole('TFIELDS')} columns"
            raise FrameError(ErrorCode.DAMAGED, path, problem, DAMAGED)
        yield unit
        start = _next(unit)
        # nothing lies beyond, and to seek there through a gzip may take an hour
        if not unpacks_believably(start, 0, path.stat().st_size):
            return


def _next(unit: Unit) -> int:
    """Return the position of the next HDU."""
    return unit.data + -(-unit.span // BLOCK) * BLOCK


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
        at = block.find(b"END")
        while at >= 0:
            if at % CARD == 0 and block[at : at + 8].rstrip() == b"END":
                return bytes(text + block[:at]), number
            at = block.find(b"END", at + 1)
        text += block
    return ErrorCode.DAMAGED, 0


def ends_early(last: Unit, handle: BinaryIO) -> bool:
    """Return whether a file ends within its last HDU, or within the header of a further one.

    Parameters
    ----------
    last : Unit
        The last HDU that :func:`walk` yielded.
    handle : file object
        From :func:`open_bytes`.
    """
    end = last.data + last.span
    if not unpacks_believably(end, 0, last.path.stat().st_size) or not _reaches(handle, end):
        return True
    handle.seek(_next(last))
    return _header(handle, MOST_HEADER_BLOCKS, b"XTENSION")[0] is ErrorCode.TRUNCATED


def refuse_missing_data(unit: Unit, handle: BinaryIO) -> None:
    """Compare what an image declares with what the file can hold, before anything is allocated.

    Parameters
    ----------
    unit : Unit
        An image.
    handle : file object
        From :func:`open_bytes`.

    Raises
    ------
    FrameError
        If the pixels cannot all be there, or a frame is larger than any detector's.

    Notes
    -----
    *Fails when* a compressed file is damaged within the reason of
    :func:`~jitterkit.frames.sizes.unpacks_believably`; then reading it fails.
    """
    nx, ny, *planes = (*unit.shape[::-1], 1, 1)
    size, zipped = unit.path.stat().st_size, isinstance(handle, gzip.GzipFile)
    declared = abs(unit.bitpix) // 8 * math.prod(unit.shape)
    held = unit.data + (unit.span if unit.packed else declared) <= size
    if unit.packed or zipped:  # of what is packed a frame still takes a byte
        short = not unpacks_believably(declared, ny * nx, size) or math.prod(planes) > size
    else:
        short = not held
    if unit.packed:
        short = short or _tiles(unit) > unit.whole("NAXIS2") or not (held or zipped)
    elif zipped:
        short = short or declared > MOST_PACKING * size
        short = short or (math.prod(planes) > 1 and not _reaches(handle, unit.data + declared))
    if short:
        has = f"the file of {size} bytes lacks them"
        problem = f"HDU {unit.number} declares {_amount(declared)} bytes of pixels and {has}"
        if held and not zipped:  # the table is complete but too short for the declared pixels
            raise FrameError(ErrorCode.DAMAGED, unit.path, problem, DAMAGED)
        raise FrameError(ErrorCode.TRUNCATED, unit.path, problem, "it is truncated: copy it again")
    refuse_giant(unit.path, f"HDU {unit.number}", nx, ny)


def _tiles(unit: Unit) -> int:
    """How many tiles the image has; each is a row of the table."""
    sides = unit.shape[::-1]
    tile = [unit.whole(f"ZTILE{n}", side if n == 1 else 1) for n, side in enumerate(sides, 1)]
    if any(not 0 < length <= max(side, MOST_TILE) for length, side in zip(tile, sides, strict=True)):
        problem = f"HDU {unit.number} declares tiles of {product_of(tuple(tile[::-1]))} pixels"
        raise FrameError(ErrorCode.DAMAGED, unit.path, problem, DAMAGED)
    return math.prod(-(-side // length) for side, length in zip(sides, tile, strict=True))


def _reaches(handle: BinaryIO, end: int) -> bool:
    handle.seek(end - 1)
    return len(handle.read(1)) == 1


def _amount(count: int) -> str:
    return str(count) if count < 10**18 else "more than 10^18"
