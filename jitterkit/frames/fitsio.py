"""What astropy.io.fits does here: cards, tiles, tables and writing; the only module that touches it."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from astropy.io import fits

from jitterkit.frames.plainheader import PlainHeader

_READABLE = bytes(c if 32 <= c < 127 else ord(" " if c in b"\t\n\v\f\r" else "?") for c in range(256))
"""For ``bytes.translate``: FITS allows no other bytes in a header, not even a tab."""


def header_of(cards: bytes) -> PlainHeader:
    """Return the header whose cards, of 80 bytes each, are given without END."""
    text = cards.translate(_READABLE).decode()
    header = PlainHeader(fits.Header.fromstring(text), text)
    if text.encode() != cards:
        header.warnings.append("the header holds bytes that are no text; read as '?'")
    return header


def all_hdus(handle: BinaryIO, **options: Any) -> fits.HDUList:
    """Return the HDUs of an open file as astropy has them."""
    handle.seek(0)
    return fits.open(handle, memmap=False, **options)


def packed_image(handle: BinaryIO, number: int, *, blank: bool) -> fits.CompImageHDU:
    """Return what unpacks the tiles of an image, unscaled; ``blank`` tells whether its BLANK has a value."""
    table = all_hdus(handle, disable_image_compression=True)[number]
    if not blank:  # astropy would compare with one that has no value
        table.header.remove("BLANK", ignore_missing=True, remove_all=True)
    return fits.CompImageHDU(bintable=table, do_not_scale_image_data=True)


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
