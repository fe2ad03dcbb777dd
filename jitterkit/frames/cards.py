"""Looking a number up in a header: its keywords, its unit, and whether to believe it.

:class:`Cards` asks several headers one behind the other and collects what was odd as warnings; the
rules that need more than one keyword are in :mod:`jitterkit.frames.header`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from jitterkit.frames.dialects import ALIASES, DIALECTS, Dialect, Keyword
from jitterkit.frames.metadata import QUANTITIES, Known
from jitterkit.frames.numbers import parse_number
from jitterkit.frames.units import factor, stated_unit

__all__ = ["Cards", "Number"]

_DEFAULTS: Mapping[str, str] = {"read_noise": "electron", "saturation": "adu", "bias": "adu"}
"""What is counted, and the unit that is meant where none is stated."""

_NO_TIME = re.compile(r"\b(number(?! of \w*sec)|no\.|index|identifier|id)", re.I)
"""Comment of a keyword that numbers exposures."""


@dataclass(frozen=True)
class Number:
    """A number of a header.

    Parameters
    ----------
    value : float
        In the unit of its quantity, or in ``counted``.
    words : str
        What stands behind the number, and the comment.
    source : str
    key : str
    counted : str
        ``"adu"`` or ``"electron"`` or a rate of them, where a quantity may be in either; empty where the
        header does not say it.
    """

    value: float
    words: str
    source: str
    key: str
    counted: str = ""


class Cards:
    """Headers to look in, one behind the other, that note what was odd.

    Parameters
    ----------
    layers : list of (mapping, int)
        Header and the number of its HDU; the first that has a keyword answers.
    """

    def __init__(self, layers: list[tuple[Mapping[str, Any], int]]) -> None:
        self.layers = layers
        self.warnings: list[str] = []

    def find(self, key: str) -> tuple[Any, str, str] | None:
        """Return ``(value, comment, source)`` of a keyword, or None."""
        for header, hdu in self.layers:
            value = header.get(key)
            if not _undefined(value):
                return value, _comment(header, key), f"header {key} (HDU {hdu})"
        return None

    def text(self, key: str) -> str:
        """Return the value as text without outer blanks, empty where there is none."""
        card = self.find(key)
        return "" if card is None else str(card[0]).strip()

    @cached_property
    def dialect(self) -> Dialect | None:
        """The observatory whose keywords these are, where it has its own."""
        return next((d for d in DIALECTS if d.spoken(self.text(d.key))), None)

    def keywords(self, name: str) -> list[Keyword]:
        """Return the keywords of a quantity, the first believed first."""
        dialect = self.dialect
        own = () if dialect is None else dialect.keywords.get(name, ())
        if dialect is not None and any((self.number(key) or (1,))[0] > 1 for key in ("NAXIS3", "ZNAXIS3")):
            own = dialect.of_cubes.get(name, ()) + own
        others = frozenset() if dialect is None else dialect.others
        return [*own, *(key for key in ALIASES[name] if key not in others and key not in own)]

    def number(self, key: str) -> tuple[float, str, str] | None:
        """Return ``(number, unit behind it, source)``, or None with a warning if it is none."""
        card = self.find(key)
        if card is None:
            return None
        number = parse_number(card[0])
        if number is None:
            self.warnings.append(f"{key} = {card[0]!r} is not a number and is ignored")
            return None
        return *number, card[2]

    def quantity(self, name: str, key: str) -> Number | None:
        """Return a number in the unit of a quantity, or None with a warning if its unit is not read."""
        card = self.number(key)
        if card is None:
            return None
        (value, behind, source), comment = card, self.find(key)[1]  # type: ignore[index]
        words = f"{behind} {comment}".strip()
        if name == "exposure" and _NO_TIME.search(comment):
            self.warnings.append(f"{key} = {value:g} is no time by its comment {comment!r} and is ignored")
            return None
        meaning = self._meaning(name, key, behind, comment)
        if meaning is None:
            self.warnings.append(f"{key} = {value:g} has a unit that is not read ({words}) and is ignored")
            return None
        if isinstance(meaning, str):
            return Number(value, words, source, key, meaning)
        return Number(value * meaning, words, source, key)

    def believable(self, name: str, key: Keyword) -> Number | None:
        """Return :meth:`quantity`, or None with a warning if its value is absurd."""
        if not isinstance(key, str):
            return self._mean(name, key)
        number = self.quantity(name, key)
        problem = None if number is None else QUANTITIES[name].problem(number.value)
        if number is None or problem is None:
            return number
        self.warnings.append(f"{key} = {number.value:g} {problem} and is ignored")
        return None

    def _meaning(self, name: str, key: str, behind: str, comment: str) -> float | str | None:
        """What :func:`factor` says of the unit of a card; the empty text where it has none."""
        if name == "gain":  # has rules of its own
            return ""
        unit = behind or stated_unit(name, comment, _DEFAULTS.get(name, 1.0))
        if unit is None and key == "XPOSURE":
            unit = self.text("TIMEUNIT")  # of the times that FITS 4.0 defines
        return factor(name, unit) if unit else ""

    def _mean(self, name: str, keys: tuple[str, ...]) -> Number | None:
        """Mean over the amplifiers that read the image."""
        used = self.text("CCDAMP").upper()
        keys = tuple(key for key in keys if key[-1] in used) or keys
        numbers = [number for number in (self.believable(name, key) for key in keys) if number is not None]
        if not numbers:
            return None
        low, high = min(n.value for n in numbers), max(n.value for n in numbers)
        mean = sum(n.value for n in numbers) / len(numbers)
        if high - low > 0.01 * abs(mean):
            shown = f"{keys[0]} to {keys[-1]} = {low:g} to {high:g}"
            self.warnings.append(f"the amplifiers differ ({shown}); their mean is taken")
        first = numbers[0]
        return replace(first, value=mean, source=first.source.replace(first.key, " and ".join(keys)))

    def first(self, name: str) -> Known | None:
        """Return the first believable number of a quantity."""
        for key in self.keywords(name):
            number = self.believable(name, key)
            if number is not None:
                return Known(number.value, QUANTITIES[name].unit, number.source)
        return None


def _undefined(value: Any) -> bool:
    return value is None or type(value).__name__ == "Undefined"


def _comment(header: Mapping[str, Any], key: str) -> str:
    comments = getattr(header, "comments", None)
    return "" if comments is None else str(comments[key])
