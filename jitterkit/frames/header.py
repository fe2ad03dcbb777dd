"""From a FITS-like header to :class:`Metadata`: keywords, precedence, and disbelief.

Reach for :func:`resolve_header`.  It never raises for what a header says: a value that is
malformed, negative or absurd is ignored with a warning that quotes it.  Keywords mean what the
observatories and the amateur capture programs write (:mod:`~jitterkit.frames.dialects`):

* ``XPIXSZ`` is the pixel *after* binning (SBFITSEXT and every program that follows it), ``PIXSIZE1``
  before.
* ``DATAMAX`` should be the highest trustworthy value, but many programs write the highest present.
* ``EGAIN``, ``EPERADU``, Siril's ``CVF`` and ESO's ``CONAD`` are e-/ADU.  ``GAIN`` is e-/ADU at observatories
  and a setting of the camera in amateur capture programs, so that it needs a witness.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

from jitterkit.frames.cards import Cards, Number
from jitterkit.frames.dialects import ALIASES, CAPTURE_SOFTWARE, OBSERVATORIES, SOFTWARE_KEYS
from jitterkit.frames.metadata import QUANTITIES, Known, Metadata
from jitterkit.frames.sky import plate_scale
from jitterkit.frames.times import resolve_time
from jitterkit.frames.units import RATES, resolve_unit

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
    """Return whether an observatory wrote the header: by its name, or by the read noise beside the gain."""
    names = map(cards.text, ("OBSERVAT", "OBSERVATORY", "TELESCOP", "INSTRUME", "ORIGIN"))
    measured = any(isinstance(key, str) and cards.find(key) for key in ALIASES["read_noise"])
    return measured or any(map(OBSERVATORIES.search, names))


def _captures(software: str) -> bool:
    # whole words, so that "India" is not INDI
    names = "|".join(map(re.escape, CAPTURE_SOFTWARE))
    return re.search(rf"(?<![a-z])({names})(?![a-z])", software.lower()) is not None


ARCSEC_PER_RADIAN = 206264.80624709636

VA_INCLUDED = ", velocity aberration included"
"""How the source of a scale ends that a pipeline has multiplied by the factor of velocity aberration."""

_UNSAID = ("none", "na", "n/a", "unknown", "undefined", "null", "raw", "unitless", "unspecified")
"""Texts of ``BUNIT`` that say nothing, in lower case."""

_CONVERSIONS = ("PHOTMJSR", "FLUXCONV")
"""Keywords of JWST and Spitzer: MJy/sr that one count per second stands for."""


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


def resolve(cards: Cards, wcs: Any = None) -> Metadata:
    """Return what cards say about a frame, as :func:`resolve_header` does."""
    gain, unit = resolve_gain(cards), _unit(cards)
    number = next(cards.believed("bias"), None)
    bias = None if number is None else _in(number, "adu", gain, None, cards)
    noises = (_in(noise, "electron", gain, None, cards) for noise in cards.believed("read_noise"))
    return Metadata(
        exposure=cards.first("exposure"),
        gain=gain,
        read_noise=next(filter(None, noises), None),
        saturation=_saturation(cards, gain, bias, "adu" if unit is None else unit.value),
        bias=bias,
        plate_scale=_plate_scale(cards, wcs),
        va_factor=cards.first("va_factor"),
        line_time=_line_time(cards),
        time=resolve_time(cards),
        unit=unit,
        wcs=wcs,
    ).warn(*cards.warnings)


def _in(number: Number, unit: str, gain: Known | None, bias: Known | None, cards: Cards) -> Known | None:
    """Convert a level between electrons and ADU; None with a warning where that cannot be done."""
    stated, word = number.counted or unit, {"adu": "ADU", "electron": "e-"}
    if stated == unit:
        return Known(number.value, word[unit], number.source)
    if stated in RATES or gain is None:
        said = f"{number.key} = {number.value:g} is in {word.get(stated, stated)}"
        why = "which is not converted" if stated in RATES else "and the gain is unknown"
        cards.warnings.append(f"{said}, {why}; it is ignored")
        return None
    zero = 0.0 if bias is None else bias.value
    if unit == "adu":
        value = number.value / gain.value + zero
        return Known(value, "ADU", f"{number.source} in e- over {gain.source}")
    return Known((number.value - zero) * gain.value, "e-", f"{number.source} in ADU times {gain.source}")


def _saturation(cards: Cards, gain: Known | None, bias: Known | None, unit: str) -> Known | None:
    """The level in the unit of the pixels, ADU or electrons, once the exposure has made counts of rates."""
    number = next(cards.believed("saturation"), None)
    if number is None:
        return None
    if unit not in ("adu", "electron") and not number.counted:
        cards.warnings.append(
            f"{number.key} = {number.value:g} has no unit beside pixels in {unit} and is ignored"
        )
        return None
    known = _in(number, unit.removesuffix("/s") if unit in RATES else unit, gain, bias, cards)
    if known is None or "DATAMAX" not in known.source:
        return known
    if number.value != round(number.value):
        cards.warnings.append(f"DATAMAX = {number.value:g} is the data's maximum and is ignored")
        return None
    cards.warnings.append(f"saturation is DATAMAX = {number.value:g}, which may be the data's maximum")
    return known


def _plate_scale(cards: Cards, wcs: Any) -> Known | None:
    said = cards.first("plate_scale") or _scale_from_area(cards)
    if wcs is None:
        return _scale_without_sky(cards, said)
    scale, warning = plate_scale(wcs)
    cards.warnings += [] if warning is None else [warning]
    problem = QUANTITIES["plate_scale"].problem(scale)
    if problem is not None:
        cards.warnings.append(f"the WCS's scale = {scale:g} {problem} and is ignored")
        return _scale_without_sky(cards, said)
    if said is not None and abs(said.value / scale - 1) > 0.01:
        cards.warnings.append(f"{said.source} = {said.value:g} differs from the WCS's {scale:g} arcsec/pixel")
    # updatewcs (HST) multiplies the scale by VAFACTOR, assign_wcs (JWST) that of its SIP or resampled image
    fitted = cards.text("CTYPE1").endswith("-SIP") or cards.text("S_RESAMP") == "COMPLETE"
    corrected = bool(cards.text("UPWCSVER")) or (cards.text("S_WCS") == "COMPLETE" and fitted)
    source = f"header WCS (HDU {cards.layers[0][1]})"
    return Known(scale, "arcsec/pixel", source + VA_INCLUDED if corrected else source)


def _scale_without_sky(cards: Cards, said: Known | None) -> Known | None:
    optics = _scale_from_optics(cards)
    if said is not None and optics is not None and abs(said.value / optics.value - 1) > 0.01:
        told = f"{optics.source} = {optics.value:g}"
        cards.warnings.append(f"{said.source} = {said.value:g} differs from {told} arcsec/pixel")
    elif said is not None and optics is None and _binning(cards) > 1:
        told = f"the binning of {_binning(cards):g}"
        cards.warnings.append(f"{said.source} = {said.value:g} is taken to include {told}")
    return said or optics


def _scale_from_area(cards: Cards) -> Known | None:
    """The side of a pixel whose area on the sky JWST writes, in arcsec²."""
    area = cards.number("PIXAR_A2")
    if area is None or not area.positive:
        return None
    return Known(math.sqrt(area.value), "arcsec/pixel", area.source)


def _scale_from_optics(cards: Cards) -> Known | None:
    focal = cards.quantity("focal_length", "FOCALLEN")
    pixel, unbinned = (cards.quantity("pixel_size", key) for key in ("XPIXSZ", "PIXSIZE1"))
    if focal is None or focal.value <= 0 or (pixel is None and unbinned is None):
        return None
    factor = _binning(cards)
    if pixel is not None:
        size, key = pixel.value, "XPIXSZ"
        if factor > 1:
            cards.warnings.append(f"XPIXSZ = {size:g} is taken to include the binning of {factor:g}")
    else:
        size, key = unbinned.value * factor, "PIXSIZE1*XBINNING"  # type: ignore[union-attr]
    scale = ARCSEC_PER_RADIAN * size * 1e-3 / focal.value
    problem = QUANTITIES["plate_scale"].problem(scale)
    if problem is not None:
        cards.warnings.append(f"{key}/FOCALLEN = {scale:g} {problem} and is ignored")
        return None
    return Known(scale, "arcsec/pixel", focal.source.replace("FOCALLEN", f"{key}/FOCALLEN"))


def _binning(cards: Cards) -> float:
    bins = cards.number("XBINNING")
    return 1.0 if bins is None else max(bins.value, 1.0)


def _line_time(cards: Cards) -> Known | None:
    known = cards.first("line_time")
    rolling = next((k for k in ("SHUTTER", "SHUTMODE") if "rolling" in cards.text(k).lower()), None)
    if known is None and rolling is not None:
        said = f"{rolling} = {cards.text(rolling)!r}"
        cards.warnings.append(
            f"{said} and no LINETIME says how long a row takes: a drift shifts rows against each other; "
            "give line_time in the instrument file"
        )
    return known


def _unit(cards: Cards) -> Known | None:
    card = cards.find("BUNIT")
    if card is None:
        return None
    text = str(card[0]).strip()
    unit = resolve_unit(text)
    if unit is None and text.lower() in _UNSAID:
        cards.warnings.append(f"BUNIT = {text!r} says no unit and is taken as ADU")
        unit = "adu"
    as_written = unit in RATES and text.lower() != unit
    return Known(unit or text, "", f"{card[2]}, {text!r}" if as_written else card[2])


def rate_of_brightness(cards: Cards, unit: Known | None) -> tuple[float, Known] | None:
    """Find how a header converts surface brightness to counts.

    Parameters
    ----------
    cards : Cards
    unit : Known or None
        What :func:`resolve` says of the pixels.

    Returns
    -------
    factor, unit : (float, Known) or None
        By what pixels in MJy/sr are multiplied, and the unit that they have then: ``"adu/s"``.  None for
        other pixels, and where the header has neither of :data:`_CONVERSIONS`.
    """
    if unit is None or "".join(str(unit.value).lower().split()) not in ("mjy/sr", "mjysr-1", "mjy.sr-1"):
        return None
    for card in filter(None, map(cards.number, _CONVERSIONS)):
        if card.positive:
            return 1 / card.value, Known("adu/s", "", f"{unit.source} in MJy/sr over {card.key}")
    return None
