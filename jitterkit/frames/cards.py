"""Looking a number up in a header: its aliases, its unit, and whether to believe it.

:class:`Cards` asks several headers one behind the other and collects what was odd as warnings; the
rules that need more than one keyword are in :mod:`jitterkit.frames.header`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from jitterkit.frames.metadata import QUANTITIES, Known

__all__ = ["ALIASES", "Cards"]

#: Keywords of each number, the first believed first.
ALIASES: Mapping[str, tuple[str, ...]] = {
    "exposure": ("EXPTIME", "EXPOSURE", "EXP_TIME"),
    "gain": ("EGAIN", "EPERADU", "GAIN"),
    "read_noise": ("RDNOISE", "READNOIS", "READNOISE", "RON", "ENOISE"),
    "saturation": ("SATURATE", "SATLEVEL", "MAXLIN", "DATAMAX"),
    "bias": ("BIASLVL", "BIASLEV"),
    "plate_scale": ("PIXSCALE", "PIXSCAL1", "SCALE", "SECPIX", "SECPIX1", "PIXELSCL"),
}

NUMBER = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][-+]?\d+)?)\s*(.*?)\s*$")
#: Factors to our unit, by a word of the value or the comment.
FACTORS: Mapping[str, Mapping[str, float]] = {
    "exposure": {
        "ms": 1e-3, "msec": 1e-3, "millisec": 1e-3, "millisecond": 1e-3, "milliseconds": 1e-3,
        "us": 1e-6, "usec": 1e-6, "microseconds": 1e-6, "minutes": 60.0, "hours": 3600.0,
    },
    "plate_scale": {
        "mas": 1e-3, "mas/pix": 1e-3, "mas/pixel": 1e-3, "milliarcsec": 1e-3, "milliarcsec/pixel": 1e-3,
        "arcmin": 60.0, "arcmin/pixel": 60.0, "deg": 3600.0, "deg/pixel": 3600.0, "deg/pix": 3600.0,
        "degrees": 3600.0, "degree": 3600.0,
    },
}  # fmt: skip


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

    def number(self, key: str) -> tuple[float, str, str] | None:
        """Return ``(number, words that may hold a unit, source)``, or None with a warning if it is none."""
        card = self.find(key)
        if card is None:
            return None
        value, comment, source = card
        match = None if isinstance(value, bool) else NUMBER.match(str(value))
        if match is None:
            self.warnings.append(f"{key} = {value!r} is not a number and is ignored")
            return None
        return float(match[1].replace("D", "e").replace("d", "e")), f"{match[2]} {comment}".strip(), source

    def believable(self, name: str, key: str) -> tuple[float, str, str] | None:
        """Return :meth:`number` in the unit of the named quantity, or None with a warning if absurd."""
        card = self.number(key)
        if card is None:
            return None
        value, words, source = card
        value *= _factor(name, words)
        problem = QUANTITIES[name].problem(value)
        if problem is not None:
            self.warnings.append(f"{key} = {value:g} {problem} and is ignored")
            return None
        return value, words, source

    def first(self, name: str) -> Known | None:
        """Return the first believable alias of a quantity."""
        for key in ALIASES[name]:
            card = self.believable(name, key)
            if card is not None:
                return Known(card[0], QUANTITIES[name].unit, card[2])
        return None


def _undefined(value: Any) -> bool:
    return value is None or type(value).__name__ == "Undefined"


def _comment(header: Mapping[str, Any], key: str) -> str:
    comments = getattr(header, "comments", None)
    return "" if comments is None else str(comments[key])


def _factor(name: str, words: str) -> float:
    factors = FACTORS.get(name, {})
    found = (factors.get(word.strip("[]().,;:").lower()) for word in words.split())
    return next((factor for factor in found if factor is not None), 1.0)
