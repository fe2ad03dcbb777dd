"""What astropy.io.fits does here: cards, tiles, tables and writing; the only module that touches it.

A :class:`PlainHeader` is a header as the resolver wants it: cards that can be read, and one word about each
that cannot.
"""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from astropy.io import fits

CARD = 80
"""Bytes of a card."""

_REMARKS = ("COMMENT", "HISTORY")
"""Keywords of text, which may stand many times."""

_READABLE = bytes(c if 32 <= c < 127 else ord(" " if c in b"\t\n\v\f\r" else "?") for c in range(256))
"""For ``bytes.translate``: FITS allows no other bytes in a header, not even a tab."""

_VALUELESS = re.compile(r".{8}= *(/.*)?")
"""A card that names a keyword and gives it no value, which FITS calls undefined."""


class PlainHeader(Mapping[str, Any]):
    """The readable cards of a header, with their comments; of two of one keyword the first counts.

    One without a value is as good as none, and hides those of its keyword that follow.

    Parameters
    ----------
    cards : bytes
        As they stand in the file, 80 bytes each, without END; astropy parses each when it is first asked for.

    Attributes
    ----------
    images : list of str
        The cards as they stand in the file.
    names : list of str
        The keywords, also of cards that cannot be read; no value is looked at.
    comments : dict of str to str
        Of the cards read so far.
    warnings : list of str
        One for each card that was asked for and could not be read, which counts as absent, or is followed by
        another that says otherwise.
    faults : dict of str to str
        What is wrong with cards that were asked for and count as absent: they ``"cannot be read"`` or
        have ``"no value"``.
    """

    def __init__(self, cards: bytes) -> None:
        text = cards.translate(_READABLE).decode()
        self.images = [text[at : at + CARD] for at in range(0, len(text), CARD)]
        self._cards: dict[str, list[Any]] = {}
        for card in fits.Header.fromstring(text).cards:
            if card.keyword:  # a blank one is a remark, and may stand many times too
                self._cards.setdefault(card.keyword, []).append(card)
        self.names = list(self._cards)
        self._values: dict[str, Any] = {}
        self.comments: dict[str, str] = {}
        changed = text.encode() != cards
        self.warnings = ["the header holds bytes that are no text; read as '?'"] * changed
        self.faults: dict[str, str] = {}

    def __getitem__(self, key: str) -> Any:
        if key not in self._values:
            card, *later = self._cards[key]
            remark = key in _REMARKS
            value = "\n".join(one.value for one in (card, *later)) if remark else _value(card)
            self._values[key] = value
            if value is None:
                self.faults[key] = "cannot be read"
                image = self.lines(re.compile(re.escape(key), re.I)) or key  # of a HIERARCH
                self.warnings.append(f"the header card {image[:60].strip()!r} cannot be read")
            elif type(value).__name__ == "Undefined":
                self.faults[key] = "has no value"
            elif not remark:
                self.comments[key] = card.comment
                if any(_value(other) != value for other in later):
                    self.warnings.append(f"the header says {key} more than once; the first counts")
        if key in self.faults:
            raise KeyError(key)
        return self._values[key]

    def __iter__(self) -> Iterator[str]:
        return iter([key for key in self.names if key in self])

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def lines(self, keywords: re.Pattern[str]) -> str:
        """Return all cards with such keywords and a value as they stand, one behind the other."""
        return "".join(i for i in self.images if keywords.match(i) and not _VALUELESS.fullmatch(i))


def _value(card: Any) -> Any:
    """The value of a card, None where astropy cannot read it."""
    try:
        _ = card.comment
        return card.value
    except Exception:  # VerifyError and others
        return None


def all_hdus(handle: BinaryIO, **options: Any) -> fits.HDUList:
    """Return the HDUs of an open file as astropy has them."""
    handle.seek(0)
    return fits.open(handle, memmap=False, **options)


def packed_image(handle: BinaryIO, number: int, *, blank: bool) -> fits.CompImageHDU:
    """Return a function that unpacks tiles of an image, unscaled; ``blank``: whether BLANK has a value."""
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
