"""From a FITS-like header to :class:`Metadata`: aliases, precedence, and disbelief.

Reach for :func:`resolve_header`.  It never raises for what a header says: a value that is
malformed, negative or absurd is ignored with a warning that quotes it.  Keywords mean what the
observatories and the amateur capture programs write:

* ``GAIN`` is e-/ADU at observatories, but a *camera setting* in amateur capture software, where
  ``EGAIN`` holds e-/ADU (and 0 when the program does not know it).
* ``XPIXSZ`` is the pixel *after* binning (SBFITSEXT and every program that follows it), ``PIXSIZE1``
  before.
* ``DATAMAX`` should be the highest trustworthy value, but many programs write the highest present.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from jitterkit.frames.cards import ALIASES, Cards
from jitterkit.frames.metadata import QUANTITIES, Known, Metadata, resolve_unit
from jitterkit.frames.sky import plate_scale
from jitterkit.frames.times import resolve_time

__all__ = ["CAPTURE_SOFTWARE", "resolve_header"]

#: Programs in whose files GAIN is a camera setting.
CAPTURE_SOFTWARE = (
    "n.i.n.a", "nina", "nighttime imaging", "sharpcap", "asiair", "asi air", "zwo", "asistudio", "asiimg",
    "firecapture", "astro photography tool", "kstars", "ekos", "indi", "sequence generator", "sgpro", "phd2",
    "astrodmx", "voyager", "maxim", "theskyx", "ezcap", "toupsky",
)  # fmt: skip
SOFTWARE_KEYS = ("SWCREATE", "SOFTWARE", "CREATOR", "PROGRAM", "ORIGIN")

#: Beyond these a GAIN without a unit is a setting: detectors have 0.01 to 30 e-/ADU.
PLAUSIBLE_GAIN = (0.01, 30.0)

ARCSEC_PER_RADIAN = 206264.80624709636

ELECTRONS_PER_ADU = re.compile(r"(?:\be-?|electrons?)\s*(?:/|per)\s*(?:adu|dn|count)", re.I)
ADU_PER_ELECTRON = re.compile(r"(?:adu|dn|counts?)\s*(?:/|per)\s*(?:e\b|e-|(?:photo-?)?electron)", re.I)


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
    Precedence: EGAIN > EPERADU > GAIN; WCS > PIXSCALE and its like > FOCALLEN with XPIXSZ.
    A WCS and a PIXSCALE that differ by more than 1 % earn a warning.
    """
    layers = [(header, hdu)] + ([] if inherit is None else [(inherit, 0)])
    cards = Cards(layers)
    gain = _gain(cards)
    return Metadata(
        exposure=cards.first("exposure"),
        gain=gain,
        read_noise=_read_noise(cards, gain),
        saturation=_saturation(cards),
        bias=cards.first("bias"),
        plate_scale=_plate_scale(cards, wcs, hdu),
        time=resolve_time(cards),
        unit=_unit(cards),
        wcs=wcs,
    ).warn(*cards.warnings)


def _gain(cards: Cards) -> Known | None:
    egain = cards.find("EGAIN")
    for key in ALIASES["gain"]:
        card = None if _is_unknown_egain(cards, key) else cards.believable("gain", key)
        if card is None:
            continue
        value, words, source = card
        objection = _not_electrons_per_adu(cards, key, value, words, egain is not None)
        if objection is None:
            return Known(value, "e-/ADU", source)
        cards.warnings.append(f"{key} = {value:g} {objection} and is ignored")
    return None


def _is_unknown_egain(cards: Cards, key: str) -> bool:
    card = cards.number(key) if key == "EGAIN" else None
    return card is not None and card[0] == 0


def _not_electrons_per_adu(cards: Cards, key: str, value: float, words: str, has_egain: bool) -> str | None:
    """Say why a gain is not to be taken as e-/ADU, or None."""
    if ELECTRONS_PER_ADU.search(words):
        return None
    if ADU_PER_ELECTRON.search(words):
        return f"is in ADU per electron by its comment {words!r}"
    if key != "GAIN":
        return None
    if has_egain:
        return "stands beside an EGAIN, so it is a camera setting"
    software = next((s for s in map(cards.text, SOFTWARE_KEYS) if _captures(s)), None)
    if software is not None:
        return f"was written by {software}, so it is a camera setting"
    low, high = PLAUSIBLE_GAIN
    return None if low <= value <= high else "is not plausible as e-/ADU, so it is a camera setting"


def _captures(software: str) -> bool:
    # whole words, so that "India" is not INDI
    names = "|".join(map(re.escape, CAPTURE_SOFTWARE))
    return re.search(rf"(?<![a-z])({names})(?![a-z])", software.lower()) is not None


def _read_noise(cards: Cards, gain: Known | None) -> Known | None:
    for key in ALIASES["read_noise"]:
        card = cards.believable("read_noise", key)
        if card is None:
            continue
        value, words, source = card
        if not re.search(r"\b(adu|dn)\b", words, re.I) or ELECTRONS_PER_ADU.search(words):
            return Known(value, "e-", source)
        if gain is not None:
            return Known(value * gain.value, "e-", f"{source} in ADU times {gain.source}")
        cards.warnings.append(f"{key} = {value:g} is in ADU and the gain is unknown; it is ignored")
    return None


def _saturation(cards: Cards) -> Known | None:
    known = cards.first("saturation")
    if known is None or "DATAMAX" not in known.source:
        return known
    if known.value != round(known.value):
        cards.warnings.append(f"DATAMAX = {known.value:g} is the data's maximum and is ignored")
        return None
    cards.warnings.append(f"saturation is DATAMAX = {known.value:g}, which may be the data's maximum")
    return known


def _plate_scale(cards: Cards, wcs: Any, hdu: int) -> Known | None:
    said = cards.first("plate_scale")
    if wcs is None:
        return said or _scale_from_optics(cards)
    scale, warning = plate_scale(wcs)
    cards.warnings += [] if warning is None else [warning]
    problem = QUANTITIES["plate_scale"].problem(scale)
    if problem is not None:
        cards.warnings.append(f"the WCS's scale = {scale:g} {problem} and is ignored")
        return said or _scale_from_optics(cards)
    if said is not None and abs(said.value / scale - 1) > 0.01:
        cards.warnings.append(f"{said.source} = {said.value:g} differs from the WCS's {scale:g} arcsec/pixel")
    return Known(scale, "arcsec/pixel", f"header WCS (HDU {hdu})")


def _scale_from_optics(cards: Cards) -> Known | None:
    focal, pixel, unbinned = cards.number("FOCALLEN"), cards.number("XPIXSZ"), cards.number("PIXSIZE1")
    if focal is None or focal[0] <= 0 or (pixel is None and unbinned is None):
        return None
    bins = cards.number("XBINNING")
    factor = 1.0 if bins is None else max(bins[0], 1.0)
    if pixel is not None and factor > 1:
        cards.warnings.append(f"XPIXSZ = {pixel[0]:g} is taken to include the binning of {factor:g}")
    size, key = (pixel[0], "XPIXSZ") if pixel else (unbinned[0] * factor, "PIXSIZE1*XBINNING")  # type: ignore[index]
    scale = ARCSEC_PER_RADIAN * size * 1e-3 / focal[0]
    problem = QUANTITIES["plate_scale"].problem(scale)
    if problem is not None:
        cards.warnings.append(f"{key}/FOCALLEN = {scale:g} {problem} and is ignored")
        return None
    return Known(scale, "arcsec/pixel", focal[2].replace("FOCALLEN", f"{key}/FOCALLEN"))


def _unit(cards: Cards) -> Known | None:
    card = cards.find("BUNIT")
    if card is None:
        return None
    unit = resolve_unit(str(card[0]))
    if unit is None:
        cards.warnings.append(f"BUNIT = {card[0]!r} is neither ADU nor electrons and is taken as ADU")
    return Known(unit or "adu", "", card[2])
