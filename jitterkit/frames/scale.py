"""The plate scale that a header states: its WCS, its keywords, or its optics.

Reach for :func:`resolve_scale`.  ``XPIXSZ`` is the pixel *after* binning (SBFITSEXT and every program that
follows it), ``PIXSIZE1`` before.
"""

from __future__ import annotations

import math
import re
from typing import Any

from jitterkit.frames.cards import Cards
from jitterkit.frames.metadata import QUANTITIES, Sourced
from jitterkit.frames.sky import plate_scale

ARCSEC_PER_RADIAN = 206264.80624709636

VA_INCLUDED = ", velocity aberration included"
"""How the source of a scale ends that a pipeline has multiplied by the factor of velocity aberration."""

_USUAL = (0.001, 100.0)
"""Arcsec/pixel from interferometers to lenses of 10 mm; beyond, a number in mas is likelier."""

_SKY = 180 * 3600
"""Arcsec that an image can be wide."""

_PIXEL, _LEAST_RATIO = (0.3, 300.0), 0.3
"""Sides of pixels [um] that detectors have, and a focal ratio that no optics have."""

_USUAL_PIXEL = 30.0
"""Side [um] of pixels, binned, that few detectors exceed."""

_REDUCERS = ("REDUCER", "FOCREDUC", "FOCALRED", "BARLOW", "EXTENDER", "TELECONV")
_NO_REDUCER = ("", "0", "0.0", "1", "1.0", "1.00", "None", "NONE", "none", "False")
"""Keywords of a focal reducer or extender, and their values where there is none."""

_NATIVE = re.compile(r"\bnative\b|\b1 ?x ?1\b|\bbefore binning\b", re.I)
"""Comment of the scale of pixels that are not binned."""

_BINNINGS = {
    "XBINNING": "YBINNING", "CCDXBIN": "CCDYBIN", "XBIN": "YBIN", "BINX": "BINY", "CCDSUM": "CCDSUM",
    "BINNING": "BINNING", "ESO DET WIN1 BINX": "ESO DET WIN1 BINY", "CCDBIN1": "CCDBIN2",
    "BIN-FCT1": "BIN-FCT2", "DETXBIN": "DETYBIN", "HBIN": "VBIN", "BIN1": "BIN2",
}  # fmt: skip
"""Keywords of the binning along x and y, which may stand in one text: SBFITSEXT, IRAF, ESO; CFHT, Subaru,
NOT, Andor, AudeLA."""


def resolve_scale(cards: Cards, wcs: Any) -> Sourced | None:
    """Find the plate scale; a contradiction, or a number that is not used, adds a warning to the cards.

    Parameters
    ----------
    cards : Cards
    wcs : astropy.wcs.WCS or None

    Returns
    -------
    scale : Sourced or None
        Arcsec/pixel: of the WCS in the middle of the frame, else of ``PIXSCALE`` and its like, else of
        ``FOCALLEN`` with ``XPIXSZ``.
    """
    shape = None
    for stem in ("NAXIS", "ZNAXIS"):  # the latter are of the pixels of a tile-compressed image
        sides = [card[0] for card in map(cards.find, (f"{stem}2", f"{stem}1")) if card is not None]
        if len(sides) == 2 and all(isinstance(side, int) and side > 0 for side in sides):
            shape = sides[0], sides[1]
    known, why = _of_sky(cards, wcs, shape), ""
    if known is None:
        return None
    scale, aside = known.value, cards.aside
    aperture = aside.quantity("focal_length", "APTDIA")
    side = aside.quantity("pixel_size", "XPIXSZ") or aside.quantity("pixel_size", "PIXSIZE1")
    focal = ARCSEC_PER_RADIAN * 1e-3 * (side.value if side and side.positive else _USUAL_PIXEL) / scale
    if shape is not None and scale * max(shape) > _SKY:
        why = f"makes the image {scale * max(shape) / 3600:.4g} degrees wide"
    elif aperture is not None and focal < _LEAST_RATIO * aperture.value:
        why = f"would need a focal length of {focal:.3g} mm behind an aperture of {aperture.value:g} mm"
    elif not _USUAL[0] <= scale <= _USUAL[1]:
        why = "is unusual"
    if why:
        cards.warn(f"{known.source} = {scale:.4g} arcsec/pixel {why}: check its unit")
    return known


def _of_sky(cards: Cards, wcs: Any, shape: tuple[int, int] | None) -> Sourced | None:
    """Return the scale of the WCS; without one, that of a keyword or of the optics."""
    said = cards.first("plate_scale") or _of_area(cards)
    key = "" if said is None else said.source.removeprefix("header ").partition(" (")[0]
    along_y = cards.aside.believable("plate_scale", key[:-1] + "2") if key.endswith("1") else None
    if said is not None and along_y is not None and abs(along_y.value / said.value - 1) > 0.01:
        cards.warn(f"{key} = {said.value:g} is used, and {along_y.said} arcsec/pixel: pixels are not square")
    optics = _of_optics(cards)
    if wcs is None:
        return _without_sky(cards, said, key, optics)
    scale, warnings = plate_scale(wcs, shape)
    cards.warnings += warnings
    problem = QUANTITIES["plate_scale"].problem(scale)
    if problem is not None:
        cards.warn(f"the WCS's scale = {scale:g} {problem} and is ignored")
        return _without_sky(cards, said, key, optics)
    for other, agreement in ((said, 0.01), (optics, 0.1)):  # a focal length is a nominal one
        if other is not None and abs(other.value / scale - 1) > agreement:
            cards.warn(f"{other.source} = {other.value:g} differs from the WCS's {scale:g} arcsec/pixel")
    # updatewcs (HST) multiplies the scale by VAFACTOR, assign_wcs (JWST) that of its SIP or resampled image
    fitted = cards.text("CTYPE1").endswith("-SIP") or cards.text("S_RESAMP") == "COMPLETE"
    corrected = bool(cards.text("UPWCSVER")) or (cards.text("S_WCS") == "COMPLETE" and fitted)
    source = f"header WCS (HDU {cards.layers[0][1]})"
    return Sourced(scale, "arcsec/pixel", source + VA_INCLUDED if corrected else source)


def _without_sky(cards: Cards, said: Sourced | None, key: str, optics: Sourced | None) -> Sourced | None:
    """Return the scale of a keyword, or else of the optics, where no WCS gives one."""
    if said is not None and optics is not None and abs(said.value / optics.value - 1) > 0.01:
        found = f"{optics.source} = {optics.value:g}"
        cards.warn(f"{said.source} = {said.value:g} differs from {found} arcsec/pixel")
    nx, ny = _binning(cards)
    of_native = _NATIVE.search((cards.find(key) or ("", ""))[1])
    if said is not None and of_native and ((nx, ny) != (1, 1) or not any(map(cards.text, _BINNINGS))):
        found = f"{key} = {said.value:g} is that of unbinned pixels by its comment ({of_native[0]!r})"
        unsure = (nx, ny) == (1, 1)
        what = ", and no binning is known: check it" if unsure else ", and is ignored: give --plate-scale"
        cards.warn(f"{found}{what}")
        said = said if unsure else None
    known = said or optics
    if known is None:
        return None
    resampled = []  # by IRAF's step from a pixel of the detector to those of the image, unlike the binning
    for key, binning in (("LTM1_1", nx), ("LTM2_2", ny)):
        step = cards.number(key)
        if step is not None and not any(abs(abs(step.value) * n - 1) < 0.01 for n in (1, binning)):
            resampled.append(f"{key} = {step.value:g}")
    if said is not None and optics is None and (nx, ny) != (1, 1):
        found = f"the binning of {nx:g}" if nx == ny else f"the binning of {nx:g} x {ny:g}"
        cards.warn(f"{said.source} = {said.value:g} is taken to include {found}")
    elif resampled:
        found = f"{known.source} = {known.value:g} is taken to be of its pixels"
        cards.warn(f"{resampled[0]}: the image was binned or resampled, and {found}")
    if nx != ny and known is said:
        cards.warn(f"the binning is {nx} x {ny}: pixels are not square")
    return known


def _of_area(cards: Cards) -> Sourced | None:
    """The side of a pixel whose area on the sky JWST writes, in arcsec²."""
    area = cards.number("PIXAR_A2")
    if area is None or not area.positive:
        return None
    if re.search(r"\b(sr|ster\w*|deg\w*|rad\w*|arcmin\w*)(?![a-z])", area.words, re.I):
        cards.warn(f"{area.said} is not in arcsec² ({area.words}) and is ignored")
        return None
    return Sourced(math.sqrt(area.value), "arcsec/pixel", area.source)


def _of_optics(cards: Cards) -> Sourced | None:
    focal = cards.quantity("focal_length", "FOCALLEN")
    binned, unbinned = (
        _pixel_sides(cards, keys) for keys in (("XPIXSZ", "YPIXSZ"), ("PIXSIZE1", "PIXSIZE2"))
    )
    sides, key = binned or unbinned, "XPIXSZ" if binned else "PIXSIZE1*XBINNING"
    if focal is None or focal.value <= 0 or sides is None:
        return None
    nx, ny = _binning(cards)
    x, y = sides if binned else (sides[0] * nx, sides[1] * ny)
    if binned and unbinned and abs(x / (unbinned[0] * nx) - 1) > 0.01:
        found = f"PIXSIZE1 = {unbinned[0]:g} um with a binning of {nx} contradicts it"
        cards.warn(f"XPIXSZ = {x:g} um is used, and {found}")
    elif binned and not unbinned and nx > 1:
        cards.warn(f"XPIXSZ = {x:g} is taken to include the binning of {nx:g}")
    scale = ARCSEC_PER_RADIAN * math.sqrt(x * y) * 1e-3 / focal.value
    aperture = cards.quantity("focal_length", "APTDIA")
    problem = QUANTITIES["plate_scale"].problem(scale)
    if problem is None and aperture is not None and focal.value < _LEAST_RATIO * aperture.value:
        problem = f"has a focal length of {focal.value:g} mm behind an aperture of {aperture.value:g} mm"
    if problem is not None:
        cards.warn(f"{key}/FOCALLEN = {scale:g} {problem} and is ignored")
        return None
    for reducer in _REDUCERS:
        if cards.text(reducer).strip(" xX") not in _NO_REDUCER:
            said = f"{focal.said} mm is taken to include {reducer} = {cards.text(reducer)}"
            cards.warn(f"{said}: if it does not, give --plate-scale")
    ratio = cards.number("FOCRATIO")
    if aperture and ratio and ratio.positive and abs(focal.value / (ratio.value * aperture.value) - 1) > 0.1:
        cards.warn(f"{focal.said} mm is used, and {ratio.said} behind {aperture.said} mm contradicts it")
    if abs(y / x - 1) > 0.01:
        cards.warn(f"pixels are {x:g} x {y:g} um, not square; {scale:g} arcsec/pixel is used")
    return Sourced(scale, "arcsec/pixel", focal.source.replace("FOCALLEN", f"{key}/FOCALLEN"))


def _pixel_sides(cards: Cards, keys: tuple[str, str]) -> tuple[float, float] | None:
    """Sides of a pixel along x and y [um]."""
    x, y = (cards.quantity("pixel_size", key) for key in keys)
    for side in filter(None, (x, y)):
        if not _PIXEL[0] <= side.value <= _PIXEL[1]:
            cards.warn(f"{side.said} um is no pixel of a detector and is ignored")
            return None
    return None if x is None else (x.value, (y or x).value)


def _binning(cards: Cards) -> tuple[int, int]:
    """Pixels of the detector along x and y in one of the image; 1 where no keyword says it."""
    first: tuple[str, tuple[int, int]] | None = None
    for key, key_y in _BINNINGS.items():
        text = cards.text(key)
        found = re.fullmatch(r"0*([1-9]\d{0,2})(?:\.0*)?(?:\s*[xX ,:]\s*0*([1-9]\d{0,2}))?", text)
        if found:
            along_y = re.fullmatch(r"([1-9]\d{0,2})(\.0*)?", cards.text(key_y))
            binning = int(found[1]), int(found[2] or (along_y and along_y[1]) or found[1])
            first = first or (key, binning)
            if binning[0] != first[1][0]:
                used = f"{first[0]} = {cards.text(first[0])} is used"
                cards.warn(f"{used}, and {key} = {text} contradicts it")
        elif text:
            cards.warn(f"{key} = {text!r} is no binning and is ignored")
    return first[1] if first else (1, 1)
