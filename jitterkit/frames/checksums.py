"""Checksums of a FITS file: DATASUM and CHECKSUM of an HDU, and the CRC at the end of a gzip."""

from __future__ import annotations

import gzip
from collections.abc import Mapping
from typing import Any, BinaryIO

import numpy as np

from jitterkit.frames.hdu import Unit

__all__ = ["checksum_warnings", "read_to_end"]

_CHUNK = 100 * 2880
_ONES = 0xFFFFFFFF


def checksum_warnings(handle: BinaryIO, unit: Unit, header: Mapping[str, Any]) -> list[str]:
    """Compare an HDU with the checksums in its header.

    Parameters
    ----------
    handle : file object
        The unpacked bytes of the file.
    unit : Unit
        The HDU.
    header : mapping
        Of the same HDU.

    Returns
    -------
    warnings : list of str
        One for each checksum that is wrong; none where there are none.

    Notes
    -----
    Sums of 32-bit words in ones' complement, FITS 4.0, appendix J.  The whole HDU, the card CHECKSUM
    included, sums to zero (all bits set).
    """
    if "DATASUM" not in header and "CHECKSUM" not in header:
        return []
    data = _sum(handle, unit.data, unit.span)
    text, found = str(header.get("DATASUM", "")).strip(), []
    if text.isdecimal() and int(text) != data:
        found.append(
            f"the pixels do not have the checksum of the header (DATASUM = {text}): "
            "the file was damaged or its pixels were changed"
        )
    whole = _folded(_sum(handle, unit.start, unit.data - unit.start) + data)
    if not found and str(header.get("CHECKSUM", "")).strip("0 ") and whole not in (0, _ONES):
        found.append("the header was changed after its CHECKSUM was written")
    return found


def read_to_end(handle: BinaryIO) -> None:
    """Read the rest of a gzip, at whose end its CRC stands; a wrong one raises, as gzip does."""
    if isinstance(handle, gzip.GzipFile):
        while handle.read(_CHUNK):
            pass


def _sum(handle: BinaryIO, start: int, length: int) -> int:
    handle.seek(start)
    total = 0
    while length > 0 and (content := handle.read(min(length, _CHUNK))):
        words = np.frombuffer(content.ljust(-(-len(content) // 4) * 4, b"\0"), ">u4")
        total += int(words.sum(dtype=np.uint64))
        length -= len(content)
    return _folded(total)


def _folded(total: int) -> int:
    while total > _ONES:
        total = (total & _ONES) + (total >> 32)
    return total
