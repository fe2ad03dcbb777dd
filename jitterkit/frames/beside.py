"""What stands beside pixels: unit and uncertainty in an ``astropy.nddata`` object, quality in a file."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from jitterkit.errors import ErrorCode, JitterkitError
from jitterkit.frames.cards import Cards
from jitterkit.frames.metadata import Sourced
from jitterkit.frames.units import resolve_unit


def unit_of(data: Any) -> Sourced | None:
    """Return the unit that an object states for its pixels; None where it states none, or no dimension.

    Raises
    ------
    JitterkitError
        If it is none that a detector converts.
    """
    own = getattr(data, "unit", None)
    if own is None or not str(own).strip():
        return None
    return Sourced(convertible(str(own), "argument CCDData.unit"), "", "argument CCDData.unit")


def convertible(text: str, source: str) -> str:
    """Return a unit as :func:`resolve_unit` does, or raise JitterkitError where a detector converts none."""
    unit = resolve_unit(text)
    if unit is None:
        problem = f"the unit {text!r} ({source}) is neither ADU nor electrons, nor a rate of them"
        raise JitterkitError(ErrorCode.UNKNOWN_UNIT, f"{problem}; convert the data.")
    return unit


def variance_of(data: Any) -> tuple[np.ndarray | None, str]:
    """Return the variance that an uncertainty stands for, and a warning where it is not used.

    Raises
    ------
    JitterkitError
        If its unit is not that of the data.
    """
    uncertainty = getattr(data, "uncertainty", None)
    values = getattr(uncertainty, "array", None)
    if values is None:
        return None, ""
    kind = getattr(uncertainty, "uncertainty_type", "unknown")
    powers = {"std": 2.0, "var": 1.0, "ivar": -1.0}
    if kind not in powers:
        return None, f"the uncertainty is of type {kind!r} and is not used: say what it is"
    own, unit = getattr(uncertainty, "unit", None), getattr(data, "unit", None)
    expected = None if unit is None else unit ** (2 / powers[kind])
    if own is not None and own != expected:
        problem = f"the uncertainty is in {own} and the data in {unit}"
        raise JitterkitError(ErrorCode.UNKNOWN_UNIT, f"{problem}; convert one of them.")
    values = np.array(values, dtype=np.float64)
    values[values < 0] = np.nan
    with np.errstate(divide="ignore", invalid="ignore"):
        return usable(values ** powers[kind], "the uncertainty")


def usable(variance: np.ndarray, name: str) -> tuple[np.ndarray | None, str]:
    """Return a variance and an empty text, or None and a warning where no pixel has one."""
    if (np.isfinite(variance) & (variance > 0)).any():
        return variance, ""
    return None, f"{name} has no positive value and is not used"


ALL_BITS = 2**32 - 1

_JWST_BAD = 1 | 1 << 9 | 1 << 31
"""DO_NOT_USE, NON_SCIENCE and REFERENCE_PIXEL: a jump or a saturated group leaves a usable slope."""

_HST_GOOD = {"ACS": 64, "WFC3": 64, "WFC3/IR": 64 | 8192, "NICMOS": 1024, "WFPC2": 1024}
"""Bits of usable pixels, by instrument: warm ones, whose dark current the pipeline has subtracted; hits in a
ramp, which are excluded one by one; sources (NICMOS, whose bit 64 is saturation); repaired warm pixels."""

MISSIONS = ("HST", "JWST")
"""Conventions by which bits are faults of pixels, and none is what a pixel shows."""

_LSST_GOOD = (
    "DETECTED", "DETECTED_NEGATIVE", "NOT_DEBLENDED", "CLIPPED", "REJECTED", "INEXACT_PSF", "BRIGHT_OBJECT",
    "PARTLY_VIGNETTED", "HIGH_VARIANCE", "INJECTED", "INJECTED_TEMPLATE", "FAKE", "SPIKE",
)  # fmt: skip
"""Planes of LSST and HSC that say what a pixel shows or how it was made; any other marks it as unusable."""

_SHOWN = re.compile(r"(?!SAT|BAD)(\w+_)?(DETECT(ED|IONS?)(_\w+)?|(SOURCE|OBJECT|STAR|GALAX(Y|IE)|SEGM\w*)S?)")
"""Names that other programs give such planes."""


_MASK_NAME = re.compile(r"MSKN\d+$")
"""Keyword of a plane's name; its bit is in MSKM of the same number, as LSST writes in place of MP_*."""


def _power(bit: Any) -> int | None:
    """Return the value of a bit by its number; None where it is none."""
    return 1 << bit if isinstance(bit, int) and 0 <= bit < 32 else None


def bad_bits(plane: Mapping[str, Any], cards: Cards) -> tuple[int, str]:
    """Return the bits that mark an unusable pixel, and whose convention that is.

    Parameters
    ----------
    plane : mapping
        Header of the quality plane.
    cards : Cards
        Headers of the image.

    Returns
    -------
    bits : int
        Sum of their values.
    convention : str
    """
    masks = {key[3:].upper(): _power(plane[key]) for key in plane if key.upper().startswith("MP_")}
    masks |= {str(plane[key]).upper(): plane.get(f"MSKM{key[4:]}") for key in plane if _MASK_NAME.match(key)}
    known = {name: mask for name, mask in masks.items() if isinstance(mask, int) and 0 < mask <= ALL_BITS}
    if known:
        shown = {name for name in known if name in _LSST_GOOD or _SHOWN.fullmatch(name)}
        return sum({mask for name, mask in known.items() if name not in shown}), "its named planes"
    name = cards.dialect.name
    if name == "JWST":
        return _JWST_BAD, name
    if name == "HST":
        camera = cards.text("INSTRUME").upper() + "/IR" * (cards.text("DETECTOR").upper() == "IR")
        return ALL_BITS & ~_HST_GOOD.get(camera, 0), name
    return ALL_BITS, "any bit"


def quality_of(values: np.ndarray, blank: np.ndarray | None, width: int) -> np.ndarray:
    """Return the bits of a quality plane as it was read.

    Parameters
    ----------
    values : (ny, nx) array
        float64; a negative number is one of a signed type, two's complement.
    blank : (ny, nx) bool array or None
        Where the plane has no value.
    width : int
        Bits of the type in which it is stored.

    Returns
    -------
    quality : (ny, nx) int64 array
        At least 0.  A number that is no integer counts as bit 0, and bits above the 31st as the 31st.
    """
    whole = np.nan_to_num(values, nan=0.5, posinf=0.5, neginf=0.5)
    odd = (whole != np.rint(whole)) | (np.zeros(values.shape, bool) if blank is None else blank)
    bits = np.where(odd, 1.0, whole).astype(np.int64)
    if width <= 32:
        return bits & (2**width - 1)
    return (bits & ALL_BITS) | ((bits >> 32 != 0).astype(np.int64) << 31)


_CONVERSIONS = ("PHOTMJSR", "FLUXCONV")
"""Keywords of JWST and Spitzer: MJy/sr that one count per second stands for."""

_FROM_TOP = ("TOP-DOWN", "TOPDOWN", "TOP_DOWN", "TOP DOWN")

ROW_ORDERS = (*_FROM_TOP, "BOTTOM-UP", "BOTTOMUP", "BOTTOM_UP", "BOTTOM UP")
"""Words of ``ROWORDER`` that say an order."""


def rows_from_the_top(cards: Cards) -> bool:
    """Return whether the first stored row is the top one (``ROWORDER``); warn of an order that is neither."""
    order = cards.text("ROWORDER").upper()
    if order not in ("", *ROW_ORDERS):
        cards.warn(f"ROWORDER = {order!r} is neither TOP-DOWN nor BOTTOM-UP and is ignored")
    return order in _FROM_TOP


def rate_of_brightness(cards: Cards, unit: Sourced | None) -> tuple[float, Sourced] | None:
    """Find how a header converts surface brightness to counts.

    Parameters
    ----------
    cards : Cards
    unit : Sourced or None
        What :func:`~jitterkit.frames.header.resolve` says of the pixels.

    Returns
    -------
    factor, unit : (float, Sourced) or None
        By what pixels in MJy/sr are multiplied, and the unit that they have then: ``"adu/s"``.  None for
        other pixels, and where the header has neither of :data:`_CONVERSIONS`.
    """
    if unit is None or "".join(str(unit.value).lower().split()) not in ("mjy/sr", "mjysr-1", "mjy.sr-1"):
        return None
    for card in filter(None, map(cards.number, _CONVERSIONS)):
        if card.positive:
            return 1 / card.value, Sourced("adu/s", "", f"{unit.source} in MJy/sr over {card.key}")
    return None


def units_agree(image: str, other: str, role: str) -> bool:
    """Return whether the unit of a noise suits that of an image; pipelines may copy it, unsquared."""
    base, unit = resolve_unit(image), other.strip().removeprefix("1/").removeprefix("1 /")
    if role == "sigma" or other == image:
        return base == resolve_unit(other)
    unit = re.sub(r"^(.+?) ?[*. ] ?\1$", r"\1", unit.strip(" ()[]"))  # "adu*adu"
    unit = re.sub(r"(?<=e-)2|(\*\*|\^)?\(?\+?(?<!-)2(\.0)?\)?", "", unit)
    unit = re.sub(r"(\*\*|\^)?\(?-2(\.0)?\)?", "" if role == "weight" else "-1", unit)
    return base == resolve_unit(unit.strip(" ()[]"))
