"""What the planes of a cube are, where its header says it: images, or errors and masks of images.

Reach for :func:`split_planes`.  Planes that nothing labels are images.  :func:`numbers_of_planes` warns of
numbers that planes have each, and that are not read.
"""

from __future__ import annotations

import math
import re
import string
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

from jitterkit.errors import ErrorCode, FrameError
from jitterkit.frames.dialects import ALIASES
from jitterkit.frames.hdu import ROLE_OF, Hdu
from jitterkit.frames.wcs import SCALE_KEYS

_MOST_LABELS = 999
"""A header of more labels is not looked for; it may declare billions of planes."""

_IMAGE, _OTHER = "image", "none"

_ROLES = (
    ("quality", r"MASK|QUALITY|DQ|FLAGS?|BAD|BPM|BADPIX"),
    ("weight", r"INVERSE VAR\w*|INV ?VAR\w*|IVAR|WEIGHTS?|WHT|WGT"),
    ("variance", r"VAR(IANCE)?S?"),
    ("sigma", r"ERRS?|ERRORS?|UNC(ERT(AINTY|AINTIES)?)?|SIGMA|STD(DEV)?|STANDARD DEVIATION|RMS|NOISE"),
    (_OTHER, r"BACKGROUND|BKG|SKY|DARK|FLAT|BIAS|MODEL|RESIDUALS?|PSF|SEGM\w*|RAW|EXPOSURE( TIME| MAP)?|TIME"
             r"|COVERAGE|CONFIDENCE|CONTEXT|CTX|SNR|S N|WAVELENGTH|THUMBNAIL|DIFF(ERENCE)?|CONTRIBUTIONS?"),
    (_IMAGE, r"SCI(ENCE)?|IMAGE|DATA|OBJECT|SPECTRUM|FLUX|INTENSITY|SIGNAL|COUNTS|FRAME|LIGHT|MEAN|MEDIAN"),
)  # fmt: skip
"""Words of labels, of which the first found counts: a "data quality mask" is no data."""

_PATTERNS = tuple((role, re.compile(rf"\b({words})(?=\b|\d)")) for role, words in _ROLES)

_NUMBERED = re.compile(r"(.*?[^\d ])[ _]?0*(\d{1,4})")
_REMARKS = ("COMMENT", "HISTORY")

_OF_PLANES = re.compile(
    r"(PLANE|PLN|LAYER|BAND|SLICE|CHAN|IMAGE(?!TYP)|IMG|FRAME|ARRAY|LABEL|CONTENT|EXT|CUBE|NAXIS)", re.I
)
"""Keywords that name planes: FILTER1 = 'DARK' and IMAGETYP = 'Dark Frame' say nothing of them."""

_AXES = re.compile(r"(CTYPE|CUNIT|CNAME|T[A-Z]{4}|NAXIS|CR\w{3}|CDELT|P[CV]\d|CD\d)")
"""Keywords whose number is that of an axis or a column, not of a plane."""

_FILE = re.compile(r"\.(fits?|fts|fz|gz|tiff?|imh|pl)\b", re.I)
_TIMES = ("DATE-BEG", "DATE-OBS", "DATE-AVG", "MJD-BEG", "MJD-OBS", "MJD-AVG", "TIME-OBS", "MJD", "TIME")
_QUANTITIES = {key for keys in ALIASES.values() for key in keys if isinstance(key, str)} | set(_TIMES)
"""Keywords of numbers that planes may have each."""

_REMARK = re.compile(
    r"\b(?:plane|layer|slice|band|channel|image|frame)s? *#?(\d+)\b *(?:[-:=,]|is|holds?|contains?)? *(.*)",
    re.I,
)

_INTENSITIES = {"STOKES": (1, -1, -2, -5, -6), "COMPLEX": ()}
"""Coordinates that are images of light: I, RR, LL, XX and YY (FITS 4.0, tables 28 and 29)."""

_SPECTRAL = re.compile(r"(WAV[EN]|AWAV|FREQ|VELO|VRAD|VOPT|ZOPT|ENER|BETA|FELO|LAMBDA|WLEN)", re.I)


def split_planes(image: Hdu) -> tuple[Hdu, list[Hdu], list[str]]:
    """Tell the images among the planes of a cube from what is said about their pixels.

    Parameters
    ----------
    image : Hdu

    Returns
    -------
    image : Hdu
        Restricted to the planes that are images; all of them where the header does not label them.
    parts : list of Hdu
        The same HDU for each role (errors, mask), restricted to its planes.
    warnings : list of str
        Which planes are not used, or in what they differ.

    Raises
    ------
    FrameError
        If the labels name no image.

    Notes
    -----
    Labels are: cards whose keyword names planes and that are numbered as these are (``PLANE1``, ``BANDID1``),
    one such card that lists them (``EXTNAME = 'SCI,ERR,DQ'``, or the comment of NAXIS3), remarks
    (``COMMENT Plane 2: error``), and the coordinates of an axis STOKES or COMPLEX.
    """
    if not 2 <= image.planes <= _MOST_LABELS:
        return image, [], []
    axis = next(n for n, side in enumerate(image.shape[::-1], 1) if n > 2 and side > 1)
    kind, warnings = image.words(f"CTYPE{axis}").upper(), []
    if _SPECTRAL.match(kind):
        warnings.append(f"the planes differ in wavelength ({kind!r}): the instrument's holds for all of them")
    labels, roles = [], []
    if kind in _INTENSITIES:
        coordinates = _coordinates(image, axis)
        labels = [f"{kind} {value:g}" for value in coordinates]
        roles = [_IMAGE if round(value) in _INTENSITIES[kind] else _OTHER for value in coordinates]
    for labels in _candidates(image) if not roles else ():
        if roles := roles_of_labels(labels):
            break
    if not roles:
        return image, [], warnings
    layers = [n for n, role in enumerate(roles) if role == _IMAGE]
    layers = layers or [n for n, role in enumerate(roles) if role == ""]
    if not layers:
        problem = f"HDU {image.number} holds no image: its planes are {', '.join(map(repr, labels[:9]))}"
        raise FrameError(ErrorCode.NO_IMAGE, image.path, problem, "write the image to a file of its own")
    parts = []
    for role in dict.fromkeys(role for role in roles if role not in (_IMAGE, "")):
        own = tuple(n for n, other in enumerate(roles) if other == role)
        if role != _OTHER and len(own) in (1, len(layers)):
            parts.append(replace(image, given=role, layers=own))
    used = {*layers, *(n for part in parts for n in part.layers)}
    left = [f"{n + 1} ({label!r})" for n, label in enumerate(labels) if n not in used]
    if left:
        warnings.append(f"planes of HDU {image.number} that are no image are not used: {', '.join(left[:9])}")
    return replace(image, layers=tuple(layers)), parts, warnings


def role_of_label(text: str) -> str:
    """Return what a label says of a plane.

    Parameters
    ----------
    text : str
        What stands behind a dash, colon or comma counts only if nothing in front of it is known.

    Returns
    -------
    role : str
        A role of :class:`~jitterkit.frames.hdu.Hdu`; ``"image"``, or ``"none"`` for what is neither; empty
        where the label has no known word.

    Examples
    --------
    >>> role_of_label("sigma - background fit, weights variance"), role_of_label("Data quality")
    ('sigma', 'quality')
    """
    for piece in re.split(r" -+ |[:,;(=]", text.upper()):
        name = piece.strip()
        if name in ROLE_OF:
            return ROLE_OF[name]
        words = re.sub(r"[^A-Z0-9]+", " ", name)
        found = next((role for role, pattern in _PATTERNS if pattern.search(words)), "")
        if found:
            return found
    return ""


def roles_of_labels(labels: Sequence[str]) -> list[str]:
    """Return the role that each label gives a plane; none where nothing says that planes differ."""
    roles = [role_of_label(label) for label in labels]
    return roles if len(set(roles)) > 1 and set(roles) - {_IMAGE, ""} else []


def _candidates(image: Hdu) -> Iterator[list[str]]:
    """Yield what may be labels of all planes."""
    header, count = image.header, image.planes
    for cards in (cards for key, cards in _numbered(image).items() if _OF_PLANES.match(key)):
        yield [value if isinstance(value, str) else comment for value, comment in cards]
    remarks = "\n".join(str(header.get(key, "")) for key in _REMARKS)
    found = {int(one[1]): one[2] for line in remarks.splitlines() if (one := _REMARK.search(line))}
    if set(found) == set(range(1, count + 1)):
        yield [found[n] for n in sorted(found)]
    for key in filter(_OF_PLANES.match, header):
        text = header[key]
        text = text if isinstance(text, str) else header.comments[key] if key.startswith("NAXIS") else ""
        parts = re.split(r"[,;/|+]", text.strip(" []()"))
        if len(parts) == count and all(map(role_of_label, parts)):
            yield [part.strip() for part in parts]


def _numbered(image: Hdu) -> dict[str, list[tuple[Any, str]]]:
    """Return values and comments of cards that are numbered as the planes are, by their common keyword."""
    header, count = image.header, math.prod(image.shape[:-2])
    found: dict[str, dict[int, tuple[Any, str]]] = {}
    for key in header:
        name = None if _AXES.match(key) or key in _REMARKS else _NUMBERED.fullmatch(key)
        if name and not _FILE.search(str(header[key])):
            found.setdefault(name[1], {})[int(name[2])] = header[key], header.comments[key]
    ranges = [set(range(first, first + count)) for first in (0, 1)]
    return {key: [cards[n] for n in sorted(cards)] for key, cards in found.items() if set(cards) in ranges}


def numbers_of_planes(image: Hdu, others: Sequence[Hdu]) -> list[str]:
    """Warn of numbers that a file has for each plane of a cube, which are not read.

    Parameters
    ----------
    image : Hdu
    others : sequence of Hdu
        Of the same file; a table with a row for each plane is about the planes.

    Returns
    -------
    warnings : list of str
        One for each quantity in the columns of a table, or in numbered cards (``EXPTIME1``) that differ; and
        one where a further celestial WCS has another scale.
    """
    count = math.prod(image.shape[:-2])
    if not 2 <= count <= _MOST_LABELS:
        return []
    found: dict[str, str] = {}
    for table in (other for other in others if other.what == "a table" and other.whole("NAXIS2") == count):
        for column in table.columns:
            if column.upper().replace("_", "-") in _QUANTITIES:
                found.setdefault(column, f"the table of HDU {table.number}")
    for key, cards in _numbered(image).items():
        known = len(key) > 2 and any(name.startswith(key.rstrip("_-")) for name in _QUANTITIES)
        if known and len({str(value) for value, _ in cards}) > 1:
            found.setdefault(key, f"cards {key} with a number")
    said = [
        f"{name} of each plane, in {where}, is not read: all have the header's"
        for name, where in found.items()
    ]
    letters = []
    for letter in string.ascii_uppercase:  # of further WCS
        celestial = re.match(r"(RA|DEC|[GE]L(ON|AT))-", image.words(f"CTYPE1{letter}"))
        pairs = ((image.header.get(key), image.header.get(key + letter)) for key in SCALE_KEYS)
        if celestial and any(other not in (None, own) for own, other in pairs):
            letters.append(letter)
    shown = f"the WCS {', '.join(letters)} has another scale; the first WCS is that of all planes"
    return said + [shown] * bool(letters)


def _coordinates(image: Hdu, axis: int) -> list[float]:
    """Return the coordinate of each plane along an axis; a number that is none is 1, as FITS says."""
    found = []
    for keys in ([f"CDELT{axis}", f"CD{axis}_{axis}"], [f"CRVAL{axis}"], [f"CRPIX{axis}"]):
        values = [value for value in map(image.header.get, keys) if isinstance(value, int | float)]
        numbers = (value for value in values if not isinstance(value, bool) and math.isfinite(value))
        found.append(float(next(numbers, 1.0)))
    step, value, pixel = found
    return [value + (n + 1 - pixel) * step for n in range(image.planes)]
