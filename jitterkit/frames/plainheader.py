"""A FITS header as the resolver wants it: cards that can be read, and one word about each that cannot."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

from jitterkit.frames.hdu import CARD

__all__ = ["PlainHeader"]

_REMARKS = ("COMMENT", "HISTORY")
"""Keywords of text, which may stand many times."""

_VALUELESS = re.compile(r".{8}= *(/.*)?")
"""A card that names a keyword and gives it no value, which FITS calls undefined."""


class PlainHeader(Mapping[str, Any]):
    """The readable cards of a header, with their comments; of two of one keyword the first counts.

    One without a value is as good as none, and hides those of its keyword that follow.

    Parameters
    ----------
    cards : astropy.io.fits.Header
        Parses each card when it is first asked for.
    text : str
        Its cards as they stand in the file, 80 characters each, without END.

    Attributes
    ----------
    comments : dict of str to str
        Of the cards read so far.
    warnings : list of str
        One for each card that was asked for and could not be read, which counts as absent, or is followed by
        another that says otherwise.
    unreadable : set of str
        The keywords of the former.
    valueless : set of str
        Keywords that were asked for, and whose card has no value.
    """

    def __init__(self, cards: Any, text: str) -> None:
        self._text = text
        self._cards: dict[str, list[Any]] = {}
        for card in cards.cards:
            self._cards.setdefault(card.keyword, []).append(card)
        self._values: dict[str, Any] = {}
        self.comments: dict[str, str] = {}
        self.warnings: list[str] = []
        self.unreadable: set[str] = set()
        self.valueless: set[str] = set()

    def __getitem__(self, key: str) -> Any:
        if key in self.unreadable or key in self.valueless:
            raise KeyError(key)
        if key not in self._values:
            cards = self._cards[key]
            remarks = key in _REMARKS
            self._values[key] = "\n".join(c.value for c in cards) if remarks else self._read(key, *cards)
        return self._values[key]

    def _read(self, key: str, card: Any, *later: Any) -> Any:
        try:
            value, self.comments[key] = card.value, card.comment
        except Exception:  # VerifyError and others
            self.unreadable.add(key)
            image = self.lines(re.compile(re.escape(key), re.I)) or key  # of a HIERARCH
            self.warnings.append(f"the header card {image[:60].strip()!r} cannot be read")
            raise KeyError(key) from None
        if type(value).__name__ == "Undefined":
            self.valueless.add(key)
            raise KeyError(key)
        if any(_differs(other, value) for other in later):
            self.warnings.append(f"the header says {key} more than once; the first counts")
        return value

    def __contains__(self, key: object) -> bool:
        try:
            self[str(key)]
        except KeyError:
            return False
        return True

    def __iter__(self) -> Iterator[str]:
        return iter([key for key in self._cards if key in self])

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def lines(self, keywords: re.Pattern[str]) -> str:
        """Return all cards with such keywords and a value as they stand, one behind the other."""
        images = (self._text[at : at + CARD] for at in range(0, len(self._text), CARD))
        return "".join(i for i in images if keywords.match(i) and not _VALUELESS.fullmatch(i))


def _differs(card: Any, value: Any) -> bool:
    try:
        return bool(card.value != value)
    except Exception:  # it cannot be read
        return True
