"""Where on its detector an image begins, as its header says: windows, sub-arrays, sections.

Cameras that read a part of the detector, and programs that cut an image, say so in keywords of their own.
:func:`window_of` reads them; they are compared with those of another image, and never added up, as a
section of a mosaic and a shift of IRAF count from different corners.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from jitterkit.frames.cards import Cards, parse_number

Window = Mapping[str, tuple[float, ...]]
"""Numbers by the keywords that hold them: ``{"XORGSUBF, YORGSUBF": (100.0, 60.0)}``."""

_CORNERS: Mapping[tuple[str, str], float] = {
    ("LTV1", "LTV2"): 0.0,
    ("XORGSUBF", "YORGSUBF"): 0.0,
    ("SUBSTRT1", "SUBSTRT2"): 1.0,
    ("CCDWXOFF", "CCDWYOFF"): 0.0,
    ("ESO DET WIN1 STRX", "ESO DET WIN1 STRY"): 1.0,
    ("ESO DET WIN STARTX", "ESO DET WIN STARTY"): 1.0,
}
"""Keywords of the first column and row, and what they are where an image begins with its detector: IRAF and
HST; amateur programs (SBFITSEXT); JWST; the Liverpool Telescope; ESO."""

_SECTIONS = ("CCDSEC", "DETSEC", "SUBRECT", "ROI", "WINDOW")
"""Keywords that list the corners: IRAF, of the chip and of the mosaic; Andor; others."""

WINDOW_CARDS = (*(key for pair in _CORNERS for key in pair), *_SECTIONS)
"""All of them."""


def window_of(cards: Cards) -> Window:
    """Return what a header says of the part of the detector that its image is; empty where it says nothing.

    >>> window_of(Cards({"XORGSUBF": 100, "YORGSUBF": 60, "CCDSEC": "[101:300,61:260]"}))
    {'XORGSUBF, YORGSUBF': (100.0, 60.0), 'CCDSEC': (101.0, 300.0, 61.0, 260.0)}
    """
    found: dict[str, tuple[float, ...]] = {}
    for pair in _CORNERS:
        numbers = [parse_number(cards.text(key)) for key in pair]
        if all(numbers):
            found[", ".join(pair)] = tuple(number[0] for number in numbers if number)
    for key in _SECTIONS:
        numbers_of = tuple(map(float, re.findall(r"\d+", cards.text(key))))
        found |= {key: numbers_of} if len(numbers_of) >= 4 else {}
    return found


def contradiction(one: Window, other: Window) -> str:
    """Return the keywords by which two images are different parts of a detector; empty where none says it."""
    return next((key for key in one if key in other and _apart(one[key], other[key])), "")


def beginning(window: Window) -> str:
    """Return the keywords by which an image does not begin with its detector; empty where none says it.

    A section of a mosaic does not say where its chip begins.
    """
    first = {**{", ".join(pair): number for pair, number in _CORNERS.items()}, "CCDSEC": 1.0}
    corners = {key: (min(n[: len(n) // 2]), min(n[len(n) // 2 :])) for key, n in window.items()}
    return next((key for key in first if key in window and _apart(corners[key], (first[key],) * 2)), "")


def said(window: Window, key: str) -> str:
    """Return in words what some keywords say: ``"XORGSUBF, YORGSUBF = 100, 60"``."""
    return f"{key} = {', '.join(f'{number:g}' for number in window[key])}"


def _apart(one: tuple[float, ...], other: tuple[float, ...]) -> bool:
    """Return whether numbers differ by a pixel or more; the LTV of a binned image is a part of one."""
    return len(one) != len(other) or any(abs(a - b) >= 1 for a, b in zip(one, other, strict=True))
