"""The celestial coordinates of a header, or none, with what was odd about them."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
from astropy import log
from astropy.wcs import WCS

from jitterkit.frames.fitsio import CARD, PlainHeader
from jitterkit.frames.framefile import collected, one_line, overheard
from jitterkit.frames.sky import usable_part

SCALE_KEYS = ("CD1_1", "CD1_2", "CDELT1", "PC1_1")

_LOOKUP_KEYS = ("CPDIS1", "CPDIS2", "D2IMDIS1", "D2IMDIS2", "AXISCORR")
"""Keywords of a distortion that stands in other HDUs."""

#: The keywords a WCS is made of, but for its dates: a frame has its time elsewhere, and so the frames of a
#: telescope that stares have one WCS.
_KEYWORDS = re.compile(
    r"(WCS|CTYPE|CRVAL|CRPIX|CDELT|CUNIT|CROTA|CNAME|CD\d|PC\d|P[SV]\d|LONPOLE|LATPOLE|RADE|EQUINOX|EPOCH|"
    r"[AB]P?_|[CD][PQ]|D2IM|AXISCORR|WAT\d|PROJP|RESTF|RESTW|SPECSYS|VELREF|LTV|LTM)"
)

_MATRIX = re.compile(r"(CD|PC)\d_\d *=")
_CD, _PC = re.compile(r"\bCD\d_\d *="), re.compile(r"\bPC\d_\d *=")
_PV2, _TAN = re.compile(r"PV2_\d+ *="), re.compile(r"(CTYPE[12] *= *'(?:RA|DEC|GLON|GLAT)-+)TAN( *')")

_BARE = re.compile(r"(CTYPE[12] *= *')(RA|DEC|[GE]L(?:ON|AT)) *'")
"""Axes of the sky without a projection."""

_HARMLESS = re.compile(r"made the change 'Success'|RADECSYS keyword is deprecated")
"""What astropy says of a WCS that it reads as it was meant: of every cube with a CD matrix, and of headers
before FITS 3.0."""

_CONTRADICTION = 1.0
"""Degrees by which CROTA2 may differ from a matrix."""

#: ``WCS`` opens the file of that name if its text is one; no name begins with 320 blanks.
_NO_PATH = " " * 320


def celestial_wcs(
    header: PlainHeader, tables: Callable[[], Any] | None = None
) -> tuple[WCS | None, list[str]]:
    """Build the celestial part of a header's WCS.

    Parameters
    ----------
    header : PlainHeader
    tables : callable, optional
        Gives the HDUs of the file, as astropy has them, to a WCS whose distortion is in lookup tables.

    Returns
    -------
    wcs : astropy.wcs.WCS or None
        Two axes, 0-based through ``pixel_to_world_values``; None where the header has no celestial
        axes, no scale, or one that cannot be inverted.
    warnings : list of str
        Why a WCS that seemed to be there is not used, or what was mended in it.

    Notes
    -----
    Made of the cards that have to do with coordinates alone, and remembered: 0.5 ms where the coordinates are
    new, 0.1 ms where the frame before had the same.
    """
    if not str(header.get("CTYPE1", "")).strip():
        return None, []
    if not any(header.get(key) for key in SCALE_KEYS):
        return None, ["the WCS has no CD, PC or CDELT, so it has no scale and is ignored"]
    try:
        cards, looked_up = header.lines(_KEYWORDS), any(header.get(key) for key in _LOOKUP_KEYS)
        wcs, messages = _made.__wrapped__(cards, tables()) if tables and looked_up else _made(cards)
        # a copy for each: a WCS can be changed, and one must not be used by two threads
        return (None if wcs is None else wcs.celestial), [*_turn_warnings(header, wcs), *messages]
    except Exception as error:  # wcslib raises a dozen kinds, none of them fatal to the image
        return None, [f"the WCS cannot be used ({one_line(error)}) and is ignored"]


def _turn_warnings(header: PlainHeader, wcs: WCS | None) -> list[str]:
    """Warn of a CROTA that is not used: that of the first axis alone, or one that contradicts a matrix."""
    along_x, along_y = header.get("CROTA1"), header.get("CROTA2")
    if along_x and along_y is None and "CDELT1" in header:
        return [f"CROTA1 = {along_x} without CROTA2 turns no axis and is ignored"]
    if wcs is None or not isinstance(along_y, int | float) or not header.lines(_MATRIX):
        return []
    matrix = wcs.celestial.pixel_scale_matrix
    turned = np.degrees(np.arctan2(-matrix[0, 1], matrix[1, 1])) + 0.0  # -0 is 0
    apart = [abs((sign * along_y - turned + 90) % 180 - 90) for sign in (1, -1)]  # programs differ in sign
    said = f"CROTA2 = {along_y:g} contradicts the matrix of the WCS, turned by {turned:.4g} degrees"
    return [f"{said}, and is ignored"] if min(apart) > _CONTRADICTION else []


@lru_cache(maxsize=8)
def _made(cards: str, tables: Any = None) -> tuple[WCS | None, tuple[str, ...]]:
    """The WCS of some cards where it is celestial, and what was said of it."""
    # strictly a map of right ascension itself, 1/cos(dec) too wide; who writes so means the usual projection
    each = (cards[start : start + CARD] for start in range(0, len(cards), CARD))
    with_tan = (_BARE.sub(lambda c: f"{c[1]}{c[2]:-<5}TAN'", card)[:CARD].ljust(CARD) for card in each)
    projected = "".join(with_tan)
    # a tangent plane has no parameters in latitude: these are polynomials, as older SCAMP writes them
    scamp = _TAN.sub(r"\1TPV\2", projected) if _PV2.search(cards) else projected
    with overheard(log) as said, collected() as caught:  # astropy prints warnings of distortions
        whole = WCS(_NO_PATH + scamp, tables)
        celestial, problems = usable_part(whole)
    said += (text for text in map(one_line, caught) if not _HARMLESS.search(text))
    if celestial is None:
        return None, problems
    if _CD.search(cards) and _PC.search(cards):
        said.append("the WCS has a CD and a PC matrix, which FITS forbids; PC with CDELT is used")
    if projected != cards:
        said.append("the WCS names no projection and is read as TAN")
    if scamp != projected:
        said.append("the WCS is TAN with PV of SCAMP and is read as TPV")
    said += problems
    return celestial, tuple(dict.fromkeys(said))
