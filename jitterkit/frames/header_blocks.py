"""What a FITS header claims, held against the file that has it before anything acts on it.

Of a damaged header a reader would look for the end through gigabytes, or allocate terabytes.  Reach for
:func:`refuse_endless_header` before a file is opened, and for :func:`refuse_missing_data` once it is, before
pixels are asked for.  No FITS library is needed here: bytes and sizes are enough.
"""

from __future__ import annotations

import gzip
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from jitterkit.errors import FrameError
from jitterkit.frames.files import is_gzip
from jitterkit.frames.framefile import translated

__all__ = ["refuse_endless_header", "refuse_missing_data"]

BLOCK = 2880
#: A header longer than this many blocks (72,000 cards) is taken to have no END.
MOST_HEADER_BLOCKS = 2000
#: No compression in use packs more than about 1000 to 1, blank frames included, beyond this size.
MOST_PACKING, SMALL = 1100, 1 << 28


def refuse_endless_header(path: Path) -> None:
    """Look for the END of the first header ourselves: astropy would read a large file to its end for it.

    Parameters
    ----------
    path : Path
        Plain or gzipped.

    Raises
    ------
    FrameError
        If the first 2000 blocks of 2880 bytes have no END card, or the file cannot be read.
    """
    with translated(path):
        for block in _header_blocks(path):
            if any(block[at : at + 8].rstrip() == b"END" for at in range(0, len(block), 80)):
                return
    raise FrameError(path, "has a FITS header without an END card", "the file is damaged: copy it again")


def _header_blocks(path: Path) -> Iterator[bytes]:
    with gzip.open(path) if is_gzip(path) else path.open("rb") as handle:
        for _ in range(MOST_HEADER_BLOCKS):
            block = handle.read(BLOCK)
            if not block:
                return
            yield block


def refuse_missing_data(path: Path, number: int, hdu: Any, packed: bool) -> None:
    """Compare what a header declares with what the file can hold, before anything is allocated.

    Parameters
    ----------
    path : Path
        Plain or gzipped.
    number : int
        Of the HDU, for the sentence.
    hdu : astropy.io.fits HDU
        With an image of known shape.
    packed : bool
        Whether its tiles are compressed.

    Raises
    ------
    FrameError
        If the pixels cannot all be there.

    Notes
    -----
    *Fails when* a compressed file is damaged within reason: of one, 268 MB or 1100 times its size, whichever
    is more, are believed.
    """
    info, size = hdu.fileinfo(), path.stat().st_size
    declared = abs(hdu.header["BITPIX"]) // 8 * math.prod(hdu.shape)
    if packed or is_gzip(path):
        short = declared > max(SMALL, MOST_PACKING * size)
    else:
        short = info["datLoc"] + declared > size
    if packed and not is_gzip(path):
        short = short or info["datLoc"] + info["datSpan"] - BLOCK >= size
    if short:
        problem = f"HDU {number} declares {declared} bytes of pixels and the file of {size} bytes lacks them"
        raise FrameError(path, problem, "it is truncated: copy it again")
