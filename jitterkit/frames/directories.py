"""The chain of directories of a TIFF, walked with suspicion.

A TIFF is a linked list, so a damaged one may loop or point anywhere.  :func:`full_pages` follows the
links without reading pixels and returns which directories are full-size images.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import BinaryIO, NamedTuple

from jitterkit.errors import ErrorCode, FrameError
from jitterkit.frames.damage import damaged, truncated
from jitterkit.frames.files import GZIP

__all__ = ["full_pages"]

NEW_SUBFILE_TYPE = 254
#: Bits of NewSubfileType: a thumbnail, and a transparency mask.
NOT_A_FRAME = 0b101


class Layout(NamedTuple):
    """Sizes of the fields of a directory, which differ between classic and BigTIFF."""

    order: str
    count_code: str
    entry: int
    link: str
    value: int

    def number(self, code: str, data: bytes) -> int:
        """Read one number in the file's byte order."""
        return struct.unpack(self.order + code, data)[0]


def full_pages(path: Path) -> list[int]:
    """Return the indices, in the chain, of the pages that are full-size images.

    Raises
    ------
    FrameError
        If the chain loops, overlaps itself, leaves the file, or has no such page.
    """
    size, read = path.stat().st_size, 0
    pages: list[int] = []
    seen: set[int] = set()
    with path.open("rb") as handle:
        if handle.peek(len(GZIP)).startswith(GZIP):
            problem, remedy = "is a gzipped TIFF, which is not read", "unpack it with gunzip"
            raise FrameError(ErrorCode.UNSUPPORTED_ENCODING, path, problem, remedy)
        layout, offset = _start(handle)
        if size < 2 * struct.calcsize(layout.link):
            raise truncated(path, f"ends after {size} bytes, within its header")
        while offset:
            page = len(seen)
            if offset in seen:
                raise damaged(path, f"page {page} points back to an earlier page")
            if offset >= size:
                raise truncated(path, f"page {page} lies beyond the end of the file")
            seen.add(offset)
            subfile, offset, length = _directory(handle, layout, offset, path, page)
            read += length
            if read > size:
                raise damaged(path, f"page {page} has a directory that overlaps others")
            if not subfile & NOT_A_FRAME:
                pages.append(page)
    if not pages:
        raise FrameError(ErrorCode.NO_IMAGE, path, "holds no full-size page", "give a TIFF with an image")
    return pages


def _start(handle: BinaryIO) -> tuple[Layout, int]:
    head = handle.read(16).ljust(16, b"\0")
    order = "<" if head[:2] == b"II" else ">"
    if struct.unpack(order + "H", head[2:4])[0] == 43:
        big = Layout(order, "Q", 20, "Q", 12)
        return big, big.number("Q", head[8:16])
    classic = Layout(order, "H", 12, "I", 8)
    return classic, classic.number("I", head[4:8])


def _directory(handle: BinaryIO, layout: Layout, offset: int, path: Path, page: int) -> tuple[int, int, int]:
    """Return the NewSubfileType of a directory, the offset of the next, and the bytes it takes."""
    handle.seek(offset)
    width = struct.calcsize(layout.count_code)
    head = handle.read(width)
    entries = layout.number(layout.count_code, head) if len(head) == width else 0
    if not 0 < entries <= 65535:
        refuse = damaged if len(head) == width else truncated
        raise refuse(path, f"page {page} has a directory of {entries} entries")
    data = handle.read(entries * layout.entry + struct.calcsize(layout.link))
    if len(data) < entries * layout.entry:
        raise truncated(path, f"page {page} has a directory cut short")
    link = data[entries * layout.entry :]
    following = layout.number(layout.link, link) if len(link) == struct.calcsize(layout.link) else 0
    return _subfile(layout, data), following, width + entries * layout.entry


def _subfile(layout: Layout, data: bytes) -> int:
    # tags are sorted and 254 is the lowest in use, so it is the first where it is present
    tag = layout.number("H", data[:2])
    return layout.number("I", data[layout.value : layout.value + 4]) if tag == NEW_SUBFILE_TYPE else 0
