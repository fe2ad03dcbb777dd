"""From a FITS-like header to :class:`Metadata`: keywords, precedence, and disbelief.

Reach for :func:`resolve_header`.  It never raises for what a header says: a value that is
malformed, negative or absurd is ignored with a warning that quotes it.  Keywords mean what the
observatories and the amateur capture programs write (:mod:`~jitterkit.frames.dialects`):

* ``DATAMAX`` should be the highest trustworthy value, but many programs write the highest present.
* ``EGAIN``, ``EPERADU``, Siril's ``CVF`` and ESO's ``CONAD`` are e-/ADU.  ``GAIN`` is e-/ADU at observatories
  and a setting of the camera in amateur capture programs, so that it needs a witness.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from jitterkit.frames.cards import Cards, Number
from jitterkit.frames.dialects import ALIASES, CAPTURE_PROGRAM, OBSERVATORIES, SOFTWARE_KEYS
from jitterkit.frames.doubts import doubts, reduced_by
from jitterkit.frames.metadata import Metadata, Sourced
from jitterkit.frames.scale import resolve_scale
from jitterkit.frames.times import resolve_time
from jitterkit.frames.units import COUNTS, RATES, resolve_unit
from jitterkit.frames.window import window_of

#: Beyond these a GAIN without a unit is a setting: detectors have 0.01 to 30 e-/ADU.
PLAUSIBLE_GAIN = (0.01, 30.0)

_ADU = r"(?:adus?|dn|d\.n|counts?|cn?ts?|lsb|a/d(?: units?)?|data ?numbers?)\b"
ELECTRONS_PER_ADU = re.compile(rf"(?:\be-?|\bel(?:ec)?|electrons?|photons?)\s*(?:/|per\b)\s*{_ADU}", re.I)
ADU_PER_ELECTRON = re.compile(rf"\b{_ADU}\s*(?:/|per\b)\s*(?:e\b|e-|el(?:ec)?\b|(?:photo-?)?electron)", re.I)
_INVERSE_POWER = re.compile(r"[ .*](adus?|dn|counts?|electrons?|e-?) ?(?:\*\*|\^)?\(?-1\b\)?", re.I)
_WRAPPED = re.compile(r"[(\[](e-?|adu|dn)[)\]](?= ?/)|(?<=/)[(\[](e-?|adu|dn)[)\]]", re.I)
"""A unit in brackets of its own: "(e-)/ADU"."""

_SETTING = re.compile(
    r"\banalog(ue)?\b|\bdigital gain|\bratio\b|\bsetting|\bpre-?amp"
    r"|\b(iso|mode|code|level|step|register|switch|PGA|high|low|user|multiplier|(sensor|camera) gain)\b"
    r"|%|\bx\d|\dx\b",
    re.I,
)
"""What a gain is where its comment does not say that it is in e-/ADU."""
_SOME_UNIT = re.compile(rf"\[[^]]*\w[^]]*\]|\b{_ADU}\s*(/|per\b)|(/|\bper)\s*{_ADU}", re.I)


def resolve_gain(cards: Cards) -> Sourced | None:
    """Find the gain that a header states.

    Parameters
    ----------
    cards : Cards
        The headers; a gain that is not used adds a warning to them.

    Returns
    -------
    gain : Sourced or None
        e-/ADU.
    """
    for card in cards.believed("gain"):
        if (objection := _objection(cards, card)) is not None:
            cards.warn(f"{card.said} {objection} and is ignored")
            continue
        for key in ("EGAIN", "EPERADU", "CVF"):  # always in e-/ADU
            other = cards.aside.believable("gain", key)
            if other is not None and abs(other.value / card.value - 1) > 0.1:
                cards.warn(f"{card.said} e-/ADU is used, and {other.said} contradicts it")
        return Sourced(card.value, "e-/ADU", card.source)
    return None


def _objection(cards: Cards, card: Number) -> str | None:
    """Say why a gain is not to be taken as e-/ADU, or None."""
    plain = _WRAPPED.sub(lambda found: found[0][1:-1], card.words.replace("^-", "-"))
    words = _INVERSE_POWER.sub(r"/\1", plain)
    said, inverse = ELECTRONS_PER_ADU.search(words), ADU_PER_ELECTRON.search(words)
    if inverse and not (said and said.start() < inverse.start()):
        return f"is in ADU per electron by its comment {card.words!r}"
    if said:
        return None
    if (setting := _SETTING.search(words)) is not None:
        return f"is a camera setting by its comment ({setting[0]!r})"
    if _SOME_UNIT.search(words):
        return f"has a unit that is not read ({card.words})"
    if card.key != "GAIN":
        return None
    if cards.find("EGAIN") is not None:
        return "stands beside an EGAIN, so it is a camera setting"
    software = next(filter(CAPTURE_PROGRAM.search, map(cards.text, SOFTWARE_KEYS)), None)
    if software is not None:
        return f"was written by {software}, so it is a camera setting"
    low, high = PLAUSIBLE_GAIN
    if not low <= card.value <= high:
        return "is not plausible as e-/ADU, so it is a camera setting"
    if any(OBSERVATORIES.search(cards.text(key)) for key in _NAMES):
        return None
    noise = next((key for key in ALIASES["read_noise"] if isinstance(key, str) and cards.find(key)), None)
    if noise is None:
        return "may be a camera setting, as nothing says that it is e-/ADU,"
    cards.warn(f"{card.said} is taken as e-/ADU, as {noise} stands beside it")
    return None


_NAMES = ("OBSERVAT", "OBSERVATORY", "TELESCOP", "INSTRUME", "ORIGIN")
"""Keywords that name an observatory."""


_UNSAID = ("none", "na", "n/a", "unknown", "undefined", "null", "raw", "unitless", "unspecified")
"""Texts of ``BUNIT`` that say nothing, in lower case."""


def resolve_header(
    header: Mapping[str, Any], *, hdu: int = 0, inherit: Mapping[str, Any] | None = None, wcs: Any = None
) -> Metadata:
    """Find out what a header says about a frame.

    Parameters
    ----------
    header : mapping
        An ``astropy.io.fits.Header`` or a dict with upper-case keys; a ``comments`` attribute is
        used where there is one, as units stand in comments.
    hdu : int
        Named in the sources.
    inherit : mapping, optional
        The primary header, asked where an extension's is silent; not given of an extension that says
        ``INHERIT = F``.
    wcs : astropy.wcs.WCS, optional
        The celestial coordinates already made of the header.

    Returns
    -------
    metadata : Metadata
        Every source reads like ``"header EGAIN (HDU 0)"``.

    Notes
    -----
    Precedence: EGAIN > EPERADU > CVF > CONAD > GAIN; WCS > PIXSCALE and its like > FOCALLEN with XPIXSZ.
    A WCS and a PIXSCALE that differ by more than 1 % earn a warning.  A ``unit`` that is none of
    :data:`~jitterkit.frames.units.COUNTS` and :data:`~jitterkit.frames.units.RATES` is kept as written: a
    detector refuses it by name.
    """
    return resolve(Cards(header, hdu, inherit), wcs)


def resolve(cards: Cards, wcs: Any = None, unit: Sourced | None = None) -> Metadata:
    """Return what cards say about a frame, as :func:`resolve_header` does.

    A ``unit`` is that of the pixels in place of ``BUNIT``, which remains that of the header's numbers.
    """
    gain, stated = resolve_gain(cards), _unit(cards)
    unit = stated if unit is None else unit
    bias, exposure, noise = _bias(cards, gain), cards.first("exposure"), None
    for number in cards.believed("read_noise"):
        if not number.value and not _NOISELESS.search(number.comment):
            said = f"{number.key} = 0 is taken to be unknown and is ignored"
            cards.warn(f"{said}: of a detector that counts photons give --read-noise 0")
        elif noise := _in(number, "electron", gain, None, cards):
            break
    saturation = _saturation(cards, gain, bias, *("adu" if u is None else u.value for u in (unit, stated)))
    scale, va_factor = resolve_scale(cards, wcs), cards.first("va_factor")
    line_time = cards.first("line_time")
    rolling = next((key for key in _SHUTTERS if "rolling" in cards.text(key).lower()), None)
    if line_time is None and rolling is not None:
        cards.warn(
            f"{rolling} = {cards.text(rolling)!r} and no LINETIME says how long a row takes: a drift shifts "
            "rows against each other; give line_time in the instrument file"
        )
    known = Metadata(
        exposure=exposure,
        gain=gain,
        read_noise=noise,
        saturation=saturation,
        bias=bias,
        plate_scale=scale,
        va_factor=va_factor,
        line_time=line_time,
        time=resolve_time(cards),
        unit=unit,
        wcs=wcs,
        window=window_of(cards),
    )
    found = doubts(cards, known)  # which may add to the cards' warnings too
    return known.warn(*cards.warnings, *found)


def _bias(cards: Cards, gain: Sourced | None) -> Sourced | None:
    """Return the level of an unexposed pixel [ADU], zero where a card says that it was subtracted."""
    number = next(cards.believed("bias"), None)
    bias = None if number is None else _in(number, "adu", gain, None, cards)
    if number is not None and _SUBTRACTED.search(number.comment):
        bias = Sourced(0.0, "ADU", f"{number.source}, which was subtracted")
        cards.warn(f"{number.key} was subtracted by its comment {number.comment!r}: the bias is 0")
    pedestal = cards.number("PEDESTAL")
    if pedestal is not None and pedestal.value:
        cards.warn(f"{pedestal.said} is not read: give the level of no light as --bias")
    elif bias is None and (said := reduced_by(cards, "bias")):
        bias = Sourced(0.0, "ADU", f"header {said}, by which the bias was subtracted,")
    return bias


def _in(
    number: Number, unit: str, gain: Sourced | None, bias: Sourced | None, cards: Cards
) -> Sourced | None:
    """Convert a level between electrons and ADU; None with a warning where that cannot be done."""
    stated, word = number.counted or unit, {"adu": "ADU", "electron": "e-"}
    if stated == unit:
        return Sourced(number.value, word[unit], number.source)
    if stated in RATES or gain is None:
        said = f"{number.said} is in {word.get(stated, stated)}"
        why = "which is not converted" if stated in RATES else "and the gain is unknown"
        cards.warn(f"{said}, {why}; it is ignored")
        return None
    zero = 0.0 if bias is None else bias.value
    if unit == "adu":
        value = number.value / gain.value + zero
        return Sourced(value, "ADU", f"{number.source} in e- over {gain.source}")
    return Sourced((number.value - zero) * gain.value, "e-", f"{number.source} in ADU times {gain.source}")


def _saturation(
    cards: Cards, gain: Sourced | None, bias: Sourced | None, unit: str, stated: str
) -> Sourced | None:
    """The level in the unit of the pixels, ADU or electrons, once the exposure has made counts of rates."""
    number = next(cards.believed("saturation"), None)
    if number is None:
        return None
    for other in cards.aside.believed("saturation"):
        if other.counted == number.counted and other.value < 0.99 * number.value and other.key != "DATAMAX":
            found = f"{other.said} is lower: if it is the limit, give --saturation"
            cards.warn(f"{number.said} is used, and {found}")
    if not number.counted and stated in COUNTS and unit.removesuffix("/s") != stated:
        number = replace(number, counted=stated)
    if unit not in ("adu", "electron") and not number.counted:
        cards.warn(f"{number.said} has no unit beside pixels in {unit} and is ignored")
        return None
    known = _in(number, unit.removesuffix("/s") if unit in RATES else unit, gain, bias, cards)
    header, largest = cards.layers[0][0], math.inf  # these cards are of their own image only
    bits = header.get("ZBITPIX", header.get("BITPIX", -32))
    scale, zero = header.get("BSCALE", 1.0), header.get("BZERO", 0.0)
    numbers = all(isinstance(number, int | float) for number in (bits, scale, zero))
    if unit == "adu" and numbers and bits >= 8 and scale > 0:  # floats have no largest
        largest = zero + scale * (2.0 ** (bits if bits == 8 else bits - 1) - 1)
    if known is not None and known.value > largest:
        said = f"{number.key} = {known.value:g} ADU is above the largest number of the stored integers"
        cards.warn(f"{said}, {largest:g}, which is used")
        known = replace(known, value=largest)
    if known is None or "DATAMAX" not in known.source:
        return known
    if number.value != round(number.value):
        cards.warn(f"DATAMAX = {number.value:g} is the data's maximum and is ignored")
        return None
    cards.warn(f"saturation is DATAMAX = {number.value:g}, which may be the data's maximum")
    return known


_SUBTRACTED = re.compile(r"(?<!\bbe )(?<!\bnot )(?<!\byet )\b(subtracted|removed)\b", re.I)
"""Comment of a bias level that the pixels no longer have."""

_NOISELESS = re.compile(r"photon|noiseless|no noise|\bideal\b|subtracted", re.I)
"""Comment of a read noise that is zero indeed."""

_SHUTTERS = (
    "SHUTTER", "SHUTMODE", "SHUTTYPE", "SHTRTYPE", "ELECSHUT", "EXPMODE", "READMODE", "READOUTM", "READOUT",
    "ESO DET READ MODE", "ESO DET READ NAME",
)  # fmt: skip
"""Keywords in which a rolling shutter is named."""

_UNITS = ("BUNITS", "UNITS", "UNIT", "DATAUNIT", "IMUNITS")
"""What programs write in place of ``BUNIT``."""

_RATE = re.compile(r"\bper s(ec(ond)?)?\b|/ ?s(ec)?\b|\brates?\b|\bnormali[sz]ed\b", re.I)
"""Comment of pixels that are a rate, whatever BUNIT says."""


def _unit(cards: Cards) -> Sourced | None:
    card = cards.find("BUNIT")
    if all(map(cards.number, ("BSOFTEN", "BOFFSET"))):  # Pan-STARRS
        return Sourced("an inverse hyperbolic sine of counts", "", "header BSOFTEN")
    if card is None:
        for key in _UNITS:
            if cards.text(key) and resolve_unit(cards.text(key)) != "adu":
                said = f"{key} = {cards.text(key)!r} is not read, BUNIT is"
                cards.warn(f"{said}: the pixels are taken as ADU")
        return None
    text = str(card[0]).strip()
    unit = resolve_unit(text)
    if unit in COUNTS and (rate := _RATE.search(card[1])):
        cards.warn(f"BUNIT = {text!r} is used, and its comment has {rate[0]!r}: it may be a rate")
    if unit is None and text.lower() in _UNSAID:
        cards.warn(f"BUNIT = {text!r} says no unit and is taken as ADU")
        unit = "adu"
    as_written = unit in RATES and text.lower() != unit
    return Sourced(unit or text, "", f"{card[2]}, {text!r}" if as_written else card[2])
