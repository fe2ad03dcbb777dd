"""Damage to FITS and TIFF files, from a seed: the food of ``scripts/fuzz_frames`` and of the readers' tests.

Reach for :func:`mutated`.  Some of the damage is blind (bytes changed, cut out, doubled, cut off), some knows
the format and aims: a card of a FITS header or an entry of a TIFF directory gets a value no writer gives.
"""

from __future__ import annotations

import gzip
import struct
import zlib

import numpy as np
from fuzz_blind import BLIND
from fuzz_fits import AIMED_AT_FITS, BLOCK, CARD
from fuzz_tiff import AIMED_AT_TIFF

__all__ = ["bomb", "mutated"]

GZIP = b"\x1f\x8b"


def mutated(content: bytes, rng: np.random.Generator) -> bytes:
    """Damage a file.

    Parameters
    ----------
    content : bytes
        Of a FITS (plain, gzipped or tile-compressed) or a TIFF.
    rng : numpy.random.Generator
        From which everything is drawn.

    Returns
    -------
    damaged : bytes
        One to four injuries later.
    """
    if content.startswith(GZIP) and rng.random() < 0.7:
        try:
            return gzip.compress(mutated(gzip.decompress(content), rng), 1, mtime=0)
        except (OSError, EOFError, zlib.error):  # damaged before
            pass
    aimed = AIMED_AT_TIFF if content[:2] in (b"II", b"MM") else AIMED_AT_FITS
    data = bytearray(content)
    for _ in range(min(int(rng.geometric(0.6)), 4)):
        kinds = aimed if rng.random() < 0.6 else BLIND
        kinds[rng.integers(len(kinds))](data, rng)
    return bytes(data)


def bomb(kind: str, rng: np.random.Generator) -> bytes:
    """Make a small file that unpacks to, or declares, far more than it is.

    Parameters
    ----------
    kind : {"fits", "tiff"}
    rng : numpy.random.Generator

    Returns
    -------
    content : bytes
        A gzipped FITS of zeros, or a TIFF whose one strip is deflated zeros.
    """
    unpacked = 1 << int(rng.integers(16, 27))
    declared = 1 << int(rng.integers(16, 44))
    rows = 1 << int(rng.integers(0, 20))
    if kind == "tiff":
        return _tiff_bomb(declared // rows, rows, zlib.compress(bytes(unpacked), 1))
    cards = {"SIMPLE": "T", "BITPIX": 8, "NAXIS": 3, "NAXIS1": declared // rows, "NAXIS2": rows, "NAXIS3": 1}
    if rng.random() < 0.5:
        cards |= {"NAXIS1": 1, "NAXIS2": 1, "NAXIS3": declared}
    text = "".join(f"{key:8}= {value!s:>20}".ljust(CARD) for key, value in cards.items()) + "END".ljust(CARD)
    return gzip.compress(text.ljust(BLOCK).encode() + bytes(unpacked), 1, mtime=0)


def _tiff_bomb(width: int, height: int, strip: bytes) -> bytes:
    entries = {
        256: width,
        257: height,
        258: 8,
        259: 8,
        262: 1,
        273: 200,
        277: 1,
        278: height,
        279: len(strip),
    }
    directory = b"".join(struct.pack("<HHII", tag, 4, 1, v & 0xFFFFFFFF) for tag, v in entries.items())
    head = b"II*\0" + struct.pack("<IH", 8, len(entries)) + directory + bytes(4)
    return head.ljust(200, b"\0") + strip
