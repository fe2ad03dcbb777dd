"""The gain of a header: e-/ADU, or a camera setting that must not be taken for it.

``EGAIN``, ``EPERADU``, Siril's ``CVF`` and ESO's ``CONAD`` are e-/ADU.  ``GAIN`` is e-/ADU at observatories
and a setting of the camera in amateur capture programs, so that it needs a witness.
"""

from __future__ import annotations

import re

from jitterkit.frames.cards import Cards, Number
from jitterkit.frames.dialects import ALIASES, CAPTURE_SOFTWARE, OBSERVATORIES, SOFTWARE_KEYS
from jitterkit.frames.metadata import Known

#: Beyond these a GAIN without a unit is a setting: detectors have 0.01 to 30 e-/ADU.
PLAUSIBLE_GAIN = (0.01, 30.0)

_ADU = r"(?:adus?|dn|counts?|cts?|a/d(?: units?)?|data ?numbers?)\b"
ELECTRONS_PER_ADU = re.compile(rf"(?:\be-?|\bel(?:ec)?|electrons?)\s*(?:/|per\b)\s*{_ADU}", re.I)
ADU_PER_ELECTRON = re.compile(rf"\b{_ADU}\s*(?:/|per\b)\s*(?:e\b|e-|el(?:ec)?\b|(?:photo-?)?electron)", re.I)
_DECIBEL = re.compile(r"(?<![a-z])(d|deci)b(el)?s?\b", re.I)


def resolve_gain(cards: Cards) -> Known | None:
    """Find the gain that a header states.

    Parameters
    ----------
    cards : Cards
        The headers; a gain that is not used adds a warning to them.

    Returns
    -------
    gain : Known or None
        e-/ADU.
    """
    for card in cards.believed("gain"):
        objection = _objection(cards, card)
        if objection is None:
            return Known(card.value, "e-/ADU", card.source)
        cards.warnings.append(f"{card.key} = {card.value:g} {objection} and is ignored")
    return None


def _objection(cards: Cards, card: Number) -> str | None:
    """Say why a gain is not to be taken as e-/ADU, or None."""
    said, inverse = ELECTRONS_PER_ADU.search(card.words), ADU_PER_ELECTRON.search(card.words)
    if _DECIBEL.search(card.words):
        return "is in dB, a camera setting"
    if inverse and not (said and said.start() < inverse.start()):
        return f"is in ADU per electron by its comment {card.words!r}"
    if said or card.key != "GAIN":
        return None
    if cards.find("EGAIN") is not None:
        return "stands beside an EGAIN, so it is a camera setting"
    software = next((s for s in map(cards.text, SOFTWARE_KEYS) if _captures(s)), None)
    if software is not None:
        return f"was written by {software}, so it is a camera setting"
    low, high = PLAUSIBLE_GAIN
    if not low <= card.value <= high:
        return "is not plausible as e-/ADU, so it is a camera setting"
    return None if _has_witness(cards) else "may be a camera setting, as nothing says that it is e-/ADU,"


def _has_witness(cards: Cards) -> bool:
    """Whether an observatory wrote the header: by its name, or by the read noise beside the gain."""
    names = map(cards.text, ("OBSERVAT", "OBSERVATORY", "TELESCOP", "INSTRUME", "ORIGIN"))
    measured = any(isinstance(key, str) and cards.find(key) for key in ALIASES["read_noise"])
    return measured or any(map(OBSERVATORIES.search, names))


def _captures(software: str) -> bool:
    # whole words, so that "India" is not INDI
    names = "|".join(map(re.escape, CAPTURE_SOFTWARE))
    return re.search(rf"(?<![a-z])({names})(?![a-z])", software.lower()) is not None
