"""A FITS header as the resolver wants it: the cards that can be read, each when it is first asked for."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from jitterkit.frames.hdu import CARD

__all__ = ["PlainHeader"]

_REMARKS = ("COMMENT", "HISTORY")
"""Keywords of text, which no card continues."""

_READABLE = bytes(c if 32 <= c < 127 else ord("?") for c in range(256))
"""For ``bytes.translate``: FITS allows no other bytes in a header."""

_VALUELESS = re.compile(rb"(HIERARCH [^=]*|.{8})= *(/.*)?")
"""A card that names a keyword and gives it no value, which FITS calls undefined."""


class PlainHeader(Mapping[str, Any]):
    """The readable cards of a header, with their comments; of two of one keyword the first counts.

    One without a value is as good as none, and hides those of its keyword that follow.

    Parameters
    ----------
    text : bytes
        The cards, 80 bytes each, without END.
    card : callable
        Makes of a card's bytes an object with a ``value`` and a ``comment``, as
        ``astropy.io.fits.Card.fromstring`` does.  It costs 10 microseconds, so that of 60 cards only those
        asked for are read.

    Attributes
    ----------
    comments : dict of str to str
        Of the cards read so far.
    warnings : list of str
        One for each card that was asked for and could not be read, which counts as absent, or is followed by
        another that says otherwise, and one if the header holds bytes that are no text.
    unreadable : set of str
        The keywords of the former.
    valueless : set of str
        Keywords that were asked for, and whose card has no value.
    """

    def __init__(self, text: bytes, card: Callable[[bytes], Any]) -> None:
        self._text, self._card = text.translate(_READABLE), card
        self.comments: dict[str, str] = {}
        self.warnings = [] if self._text == text else ["the header holds bytes that are no text; read as '?'"]
        self.unreadable: set[str] = set()
        self.valueless: set[str] = set()
        self._cards = _cards(self._text)
        self._places: dict[str, tuple[int, int]] = {}
        self._later: dict[str, list[tuple[int, int]]] = {}
        for key, place in self._cards:
            if self._places.setdefault(key, place) is not place:
                self._later.setdefault(key, []).append(place)
        self._values: dict[str, Any] = {key: self._remarks(key) for key in _REMARKS if key in self._places}

    def __getitem__(self, key: str) -> Any:
        if key not in self._values:
            image = self._image(*self._places[key])
            try:
                self._values[key], self.comments[key] = self._read(key, image)
            except KeyError:
                del self._places[key]
                raise
            if any(_said(self._image(*place)) != _said(image) for place in self._later.get(key, ())):
                self.warnings.append(f"the header says {key} more than once; the first counts")
        return self._values[key]

    def _read(self, key: str, image: bytes) -> tuple[Any, str]:
        if _VALUELESS.fullmatch(image):
            self.valueless.add(key)
            raise KeyError(key)
        try:
            card = self._card(image)
            return card.value, card.comment
        except Exception:  # VerifyError and others
            self.unreadable.add(key)
            self.warnings.append(f"the header card {image[:60].decode().strip()!r} cannot be read")
            raise KeyError(key) from None

    def __contains__(self, key: object) -> bool:
        if key not in self._places:
            return False
        try:
            self[str(key)]
        except KeyError:
            return False
        return True

    def __iter__(self) -> Iterator[str]:
        return iter([key for key in list(self._places) if key in self])

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def lines(self, keywords: re.Pattern[str]) -> str:
        """Return all cards with such keywords and a value as they stand, one behind the other."""
        images = (self._image(*place) for key, place in self._cards if keywords.match(key))
        return b"".join(image for image in images if not _VALUELESS.fullmatch(image)).decode()

    def _remarks(self, key: str) -> str:
        """All cards of a keyword that may stand many times, a line each."""
        cards = (self._text[at : at + CARD].decode() for at in range(0, len(self._text), CARD))
        return "\n".join(card[8:].rstrip() for card in cards if card[:8].rstrip() == key)

    def _image(self, start: int, end: int) -> bytes:
        return self._text[start:end].ljust(CARD)


def _said(image: bytes) -> list[bytes]:
    """The words of a card without its comment."""
    return image.split(b"/")[0].split()


def _cards(text: bytes) -> list[tuple[str, tuple[int, int]]]:
    """The keyword of each card, and where it begins and ends, with the cards that continue it."""
    cards: list[tuple[str, tuple[int, int]]] = []
    continued = False
    for at in range(0, len(text), CARD):
        key = text[at : at + 8].decode().rstrip().upper()
        if key == "CONTINUE" and continued:
            cards[-1] = (cards[-1][0], (cards[-1][1][0], at + CARD))
            continue
        if key == "HIERARCH":
            key = text[at + 9 : at + CARD].split(b"=")[0].decode().strip().upper()
        if key:
            cards.append((key, (at, at + CARD)))
        continued = bool(key) and key not in _REMARKS
    return cards
