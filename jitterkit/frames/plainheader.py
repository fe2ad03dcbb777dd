"""A FITS header as the resolver wants it: cards that can be read, and one word about each that cannot."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

CARD = 80
"""Bytes of a card."""

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
    images : list of str
        The cards as they stand in the file.
    comments : dict of str to str
        Of the cards read so far.
    warnings : list of str
        One for each card that was asked for and could not be read, which counts as absent, or is followed by
        another that says otherwise.
    faults : dict of str to str
        What is wrong with cards that were asked for and count as absent: they ``"cannot be read"`` or
        have ``"no value"``.
    """

    def __init__(self, cards: Any, text: str) -> None:
        self.images = [text[at : at + CARD] for at in range(0, len(text), CARD)]
        self._cards: dict[str, list[Any]] = {}
        for card in cards.cards:
            self._cards.setdefault(card.keyword, []).append(card)
        self._values: dict[str, Any] = {}
        self.comments: dict[str, str] = {}
        self.warnings: list[str] = []
        self.faults: dict[str, str] = {}

    def __getitem__(self, key: str) -> Any:
        if key not in self._values:
            self._values[key] = self._read(key, *self._cards[key])
        if key in self.faults:
            raise KeyError(key)
        return self._values[key]

    def _read(self, key: str, card: Any, *later: Any) -> Any:
        if key in _REMARKS:
            return "\n".join(one.value for one in (card, *later))
        value = _value(card)
        if value is None:
            self.faults[key] = "cannot be read"
            image = self.lines(re.compile(re.escape(key), re.I)) or key  # of a HIERARCH
            self.warnings.append(f"the header card {image[:60].strip()!r} cannot be read")
        elif type(value).__name__ == "Undefined":
            self.faults[key] = "has no value"
        else:
            self.comments[key] = card.comment
            if any(_value(other) != value for other in later):
                self.warnings.append(f"the header says {key} more than once; the first counts")
        return value

    def __contains__(self, key: object) -> bool:
        return self.get(key, self) is not self  # type: ignore[call-overload]

    def __iter__(self) -> Iterator[str]:
        return iter([key for key in self._cards if key in self])

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
