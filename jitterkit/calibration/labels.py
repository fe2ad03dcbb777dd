"""Say what headers call calibration frames, and how their camera was set.

Reach for :func:`check_kind` and for :func:`settings_of`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping

from jitterkit.errors import ErrorCode, FrameError
from jitterkit.frames import RawFrame

_KIND_CARDS = (
    "IMAGETYP", "OBSTYPE", "FRAME", "FRAMETYP", "IMTYPE", "EXP_TYPE", "VIMTYPE", "ESO DPR TYPE",
)  # fmt: skip

_KINDS: Mapping[str, str] = {
    "dark": r"flat[ _-]?dark|dark[ _-]?flat|dark",
    "bias": r"bias|zero|offset",
    "flat": r"flat|twilight",
    "light": r"light|object|science|target",
}
"""What the text of such a card says of a kind; the first that matches counts."""

_UNEXPOSED = 1.0
"""Seconds below which a dark may stand for a bias frame: many cameras take none of zero."""

SETTINGS = (
    "INSTRUME", "DETNAM", "XBINNING", "YBINNING", "CCDSUM", "BINNING", "GAIN", "OFFSET", "BLKLEVEL",
    "READOUTM", "READMODE", "RDMODE",
)  # fmt: skip
"""Cards that are alike in frames of one camera at one setting."""

TEMPERATURE, FILTER = "CCD-TEMP", "FILTER"


def check_kind(raw: RawFrame, kind: str, text: Callable[[str], str]) -> tuple[str, ...]:
    """Refuse a frame that its header calls a calibration frame of another kind.

    Parameters
    ----------
    raw : RawFrame
    kind : {"bias", "dark", "flat"}
        What it is given as.
    text : callable
        Returns the text of a card, empty where there is none.

    Returns
    -------
    warnings : tuple of str
        One if the header calls it a light frame, as programs call any frame.

    Raises
    ------
    FrameError
    """
    card, said = next(((card, text(card)) for card in _KIND_CARDS if text(card)), ("", ""))
    other = next((name for name, pattern in _KINDS.items() if re.search(pattern, said, re.I)), kind)
    unexposed = (raw.metadata.value("exposure") or 0.0) < _UNEXPOSED
    if other == kind or (kind == "bias" and other == "dark" and unexposed):
        return ()
    name = f"{card} = {said!r}"
    if other == "light":
        return (f"{name} says that they are not {kind} frames",)
    problem = f"is given as a {kind} frame, and is none by {name}"
    remedy = f"leave it out of the {kind} frames, or correct {card}"
    raise FrameError(ErrorCode.WRONG_INSTRUMENT, raw.path or raw.name, problem, remedy)


def settings_of(text: Callable[[str], str]) -> dict[str, str]:
    """Return what a header says of the camera: its settings, temperature and filter, those that it has."""
    return {card: said for card in (*SETTINGS, TEMPERATURE, FILTER) if (said := text(card))}


def differ(one: str, other: str) -> bool:
    """Return whether two texts of a card differ, and not only in how a number or a case is written.

    >>> differ("1", "1.0"), differ("1 1", "1x1"), differ("High Gain", "Low Gain")
    (False, False, True)
    """
    a, b = (re.split(r"[\s,x]+", text.strip().lower()) for text in (one, other))
    return len(a) != len(b) or any(_unlike(*pair) for pair in zip(a, b, strict=True))


def _unlike(one: str, other: str) -> bool:
    try:
        a, b = float(one), float(other)
    except ValueError:
        return one != other
    return abs(a - b) > 1e-3 * max(abs(a), abs(b))
