"""What astropy.io.fits does here: cards, tiles, tables and writing; the only module that touches it.

A :class:`PlainHeader` is a header as the resolver wants it: cards that can be read, and one word about each
that cannot.  :func:`celestial_wcs` gives the coordinates of one, or none, with what was odd about them.
"""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Callable, Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from astropy import log
from astropy.io import fits
from astropy.wcs import WCS

from jitterkit.frames.framefile import collected, one_line, overheard
from jitterkit.frames.sky import usable_part

CARD = 80
"""Bytes of a card."""

_REMARKS = ("COMMENT", "HISTORY")
"""Keywords of text, which may stand many times."""

_READABLE = bytes(c if 32 <= c < 127 else ord(" " if c in b"\t\n\v\f\r" else "?") for c in range(256))
"""For ``bytes.translate``: FITS allows no other bytes in a header, not even a tab."""

_VALUELESS = re.compile(r".{8}= *(/.*)?")
"""A card that names a keyword and gives it no value, which FITS calls undefined."""


class PlainHeader(Mapping[str, Any]):
    """The readable cards of a header, with their comments; of two of one keyword the first counts.

    One without a value is as good as none, and hides those of its keyword that follow.

    Parameters
    ----------
    cards : bytes
        As they stand in the file, 80 bytes each, without END; astropy parses each when it is first asked for.

    Attributes
    ----------
    images : list of str
        The cards as they stand in the file.
    names : list of str
        The keywords, also of cards that cannot be read; no value is looked at.
    comments : dict of str to str
        Of the cards read so far.
    warnings : list of str
        One for each card that was asked for and could not be read, which counts as absent, or is followed by
        another that says otherwise.
    faults : dict of str to str
        What is wrong with cards that were asked for and count as absent: they ``"cannot be read"`` or
        have ``"no value"``.
    """

    def __init__(self, cards: bytes) -> None:
        text = cards.translate(_READABLE).decode()
        self.images = [text[at : at + CARD] for at in range(0, len(text), CARD)]
        self._cards: dict[str, list[Any]] = {}
        for card in fits.Header.fromstring(text).cards:
            self._cards.setdefault(card.keyword, []).append(card)
        self.names = list(self._cards)
        self._values: dict[str, Any] = {}
        self.comments: dict[str, str] = {}
        changed = text.encode() != cards
        self.warnings = ["the header holds bytes that are no text; read as '?'"] * changed
        self.faults: dict[str, str] = {}

    def __getitem__(self, key: str) -> Any:
        if key not in self._values:
            card, *later = self._cards[key]
            remark = key in _REMARKS
            value = "\n".join(one.value for one in (card, *later)) if remark else _value(card)
            self._values[key] = value
            if value is None:
                self.faults[key] = "cannot be read"
                image = self.lines(re.compile(re.escape(key), re.I)) or key  # of a HIERARCH
                self.warnings.append(f"the header card {image[:60].strip()!r} cannot be read")
            elif type(value).__name__ == "Undefined":
                self.faults[key] = "has no value"
            elif not remark:
                self.comments[key] = card.comment
                if any(_value(other) != value for other in later):
                    self.warnings.append(f"the header says {key} more than once; the first counts")
        if key in self.faults:
            raise KeyError(key)
        return self._values[key]

    def __iter__(self) -> Iterator[str]:
        return iter([key for key in self.names if key in self])

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def lines(self, keywords: re.Pattern[str]) -> str:
        """Return all cards with such keywords and a value as they stand, one behind the other."""
        return "".join(i for i in self.images if keywords.match(i) and not _VALUELESS.fullmatch(i))


def _value(card: Any) -> Any:
    """The value of a card, None where astropy cannot read it."""
    try:
        _ = card.comment
        return card.value
    except Exception:  # VerifyError and others
        return None


def all_hdus(handle: BinaryIO, **options: Any) -> fits.HDUList:
    """Return the HDUs of an open file as astropy has them."""
    handle.seek(0)
    return fits.open(handle, memmap=False, **options)


def packed_image(handle: BinaryIO, number: int, *, blank: bool) -> fits.CompImageHDU:
    """Return a function that unpacks tiles of an image, unscaled; ``blank``: whether BLANK has a value."""
    table = all_hdus(handle, disable_image_compression=True)[number]
    if not blank:  # astropy would compare with one that has no value
        table.header.remove("BLANK", ignore_missing=True, remove_all=True)
    return fits.CompImageHDU(bintable=table, do_not_scale_image_data=True)


def write(path: Path, array: np.ndarray, header: Mapping[str, Any]) -> None:
    """Write an array; see :func:`jitterkit.frames.write_fits`."""
    cards = fits.Header()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fits.verify.VerifyWarning)  # a long comment is cut short
        for keyword, entry in header.items():
            cards.append(_card(keyword, entry), end=True)
        if path.name.lower().endswith(".fz"):
            kind = "RICE_1" if array.dtype.kind in "iu" and array.dtype.itemsize <= 4 else "GZIP_2"
            image = fits.CompImageHDU(array, cards, compression_type=kind, quantize_level=0.0)
            hdus = fits.HDUList([fits.PrimaryHDU(), image])
        else:
            hdus = fits.HDUList([fits.PrimaryHDU(array, cards)])
        hdus.writeto(path)


def _card(keyword: str, entry: Any) -> fits.Card:
    value, comment = entry if isinstance(entry, tuple) else (entry, "")
    value = value.item() if hasattr(value, "item") else value
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        value = fits.card.UNDEFINED
    if isinstance(value, str):
        value = value.encode("ascii", "replace").decode().replace("\n", " ")
    elif not isinstance(value, bool | int | float | fits.card.Undefined):
        value = str(value)
    name = keyword if len(keyword) <= 8 and " " not in keyword else f"HIERARCH {keyword}"
    return fits.Card(name, value, str(comment).encode("ascii", "replace").decode())


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
    said += map(one_line, caught)
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
