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


class PlainHeader(Mapping[str, Any]):
    """The readable cards of a header, with their comments; of two of one keyword the last counts.

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
        One for each card that was asked for and could not be read, which counts as absent, and one if the
        header holds bytes that are no text.
    unreadable : set of str
        The keywords of the former.
    """

    def __init__(self, text: bytes, card: Callable[[bytes], Any]) -> None:
        self._text, self._card = text.translate(_READABLE), card
        self.comments: dict[str, str] = {}
        self.warnings = [] if self._text == text else ["the header holds bytes that are no text; read as '?'"]
        self.unreadable: set[str] = set()
        self._places = _places(self._text)
        self._values: dict[str, Any] = {key: self._remarks(key) for key in _REMARKS if key in self._places}

    def __getitem__(self, key: str) -> Any:
        if key not in self._values:
            image = self._image(*self._places[key])
            try:
                card = self._card(image)
                self._values[key], self.comments[key] = card.value, card.comment
            except Exception:  # VerifyError and others
                del self._places[key]
                self.unreadable.add(key)
                self.warnings.append(f"the header card {image[:60].decode().strip()!r} cannot be read")
                raise KeyError(key) from None
        return self._values[key]

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
        """Return the cards with such keywords as they stand, one behind the other."""
        chosen = [place for key, place in self._places.items() if keywords.match(key)]
        return b"".join(self._image(*place) for place in chosen).decode()

    def _remarks(self, key: str) -> str:
        """All cards of a keyword that may stand many times, a line each."""
        cards = (self._text[at : at + CARD].decode() for at in range(0, len(self._text), CARD))
        return "\n".join(card[8:].rstrip() for card in cards if card[:8].rstrip() == key)

    def _image(self, start: int, end: int) -> bytes:
        return self._text[start:end].ljust(CARD)


def _places(text: bytes) -> dict[str, tuple[int, int]]:
    """Where the card of each keyword begins and ends, with the cards that continue it."""
    places: dict[str, tuple[int, int]] = {}
    last = ""
    for at in range(0, len(text), CARD):
        key = text[at : at + 8].decode().rstrip().upper()
        if key == "CONTINUE" and last:
            places[last] = (places[last][0], at + CARD)
            continue
        if key == "HIERARCH":
            key = text[at + 9 : at + CARD].split(b"=")[0].decode().strip().upper()
        if key:
            places[key] = (at, at + CARD)
        last = "" if key in _REMARKS else key
    return places
