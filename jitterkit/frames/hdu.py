"""One HDU of a FITS file: where it lies, what it is called and what it holds.

:class:`Hdu` believes the few keywords by which FITS lays a file out only where they make sense, and refuses
the file otherwise: of a damaged header a reader would count to a NAXIS of billions, or allocate terabytes.
Everything else in a header is read by astropy, and believed less strictly.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import BinaryIO

from jitterkit.errors import FrameError
from jitterkit.frames.files import damaged
from jitterkit.frames.fitsio import PlainHeader

BLOCK = 2880
"""Headers and data take a whole number of blocks of so many bytes."""

_MOST_AXES = 999
"""FITS allows so many axes, and columns of a table."""

_STRUCTURE = re.compile(
    r"(SIMPLE|XTENSION|Z?BITPIX|Z?NAXIS\d{0,3}|[PG]COUNT|GROUPS|TFIELDS|ZIMAGE|ZTILE\d{1,3}) *=(.*)"
)
_WHOLE = re.compile(r"[+-]?\d{1,25}")

_ROLES: Mapping[str, tuple[str, ...]] = {
    "quality": ("DQ", "MASK", "FLAGS", "FLAG", "FLG", "DQMASK", "BPM", "BADPIX", "BAD_PIXEL_MASK", "QUALITY",
        "QUAL", "MSK"),
    "shot": ("VAR_POISSON",),
    "read": ("VAR_RNOISE",),
    "variance": ("VARIANCE", "VAR", "STAT"),
    "sigma": ("ERR", "ERROR", "ERRORS", "UNCERT", "UNCERTAINTY", "STD", "STDDEV", "SIGMA", "RMS", "NOISE"),
    "weight": ("WHT", "WEIGHT", "WEIGHTS", "WGT", "IVAR", "INVVAR", "IVM"),
    "none": (
        "CTX", "CON", "AREA", "SAMP", "TIME", "WAVELENGTH", "PSFIMAGE", "BKG", "BACKGROUND", "VAR_FLAT",
        "PSF", "SKY", "BIAS", "DARK", "FLAT", "MODEL", "RESIDUAL", "SEGM", "THUMBNAIL", "PREVIEW",
        "WCSDVARR", "D2IMARR", "APERTURE",
    ),
}  # fmt: skip
"""EXTNAME of what is said about the pixels of an image: quality bits, variance, its root, its inverse; and of
images about other things."""

ROLE_OF = {name: role for role, names in _ROLES.items() for name in names}

_WORD = r"(?<![A-Z])(%s)(?![A-Z])"
_ROLE_WORDS = sorted((name for name, role in ROLE_OF.items() if role != "none"), key=len, reverse=True)
_NAMED_ROLE = re.compile(_WORD % "|".join(_ROLE_WORDS))
_NO_DETECTOR = re.compile(_WORD % "|".join([*_ROLE_WORDS, "SCIENCE", "SCI", "IMAGE", "IMG", "DATA"]))
"""Words of a name that do not say of which detector its HDU is."""

_PACKED = "COMPRESSED_IMAGE"
"""EXTNAME that programs give a tile-compressed image without a name."""

_DESCRIBES = re.compile(
    r"MA?SK|BAD|GOOD|VALID|QUAL|FLA?G|HOT|COSMIC|DQ|ERR|UNC|SIG|RMS|NOISE|STD|VAR|W[HG]?T|WEIGHT|CONF|COV|EXP"
)
"""In names that are none of these, and may be of something that is said about pixels too."""

_ESO_ROLES = {
    "QUALITY": "quality",
    "MSE": "variance",
    "RMSE": "sigma",
    "INVMSE": "weight",
    "INVRMSE": "none",
    "MASKZERO": "none",  # whose zeros are the bad pixels
}
"""HDUCLAS3, or else HDUCLAS2, of what ESO's pipelines write."""

_CHIP_KEYS = ("CCDNUM", "CCDNAME", "DETSEC", "CHIPID", "DETECSEC")
"""Keywords of one detector among others of a camera."""

_ASTROPY_UNCERTAINTY = {
    "stddevuncertainty": "sigma",
    "varianceuncertainty": "variance",
    "inversevariance": "weight",
    "unknownuncertainty": "none",
}
"""UTYPE of what CCDData writes."""


@dataclass(eq=False)
class Hdu:
    """One HDU as its header describes it; making one refuses a structure that cannot be.

    Parameters
    ----------
    path : Path
        For sentences.
    handle : file object
        The unpacked bytes of the file.
    number : int
        From 0.
    start, data : int
        Where its header and its data begin [bytes].
    header : PlainHeader
    given : str
        Its role, where it is known otherwise than by its name.
    layers : tuple of int
        The only planes that count, from 0; all of them where it is empty.

    Attributes
    ----------
    structure : dict of str to str
        What the keywords that lay the file out say, as written without the comment.
    packed : bool
        Whether it is a table that holds a tile-compressed image.
    span, next : int
        Bytes of data it declares, without padding, and where the next HDU begins [bytes].
    bitpix : int
        Bits of a stored pixel, negative for floating point.
    shape : tuple of int
        Sides of the image, slowest axis first; of a table its own.
    what : str
        What it is, for a refusal.
    is_image : bool
        Whether it holds frames: two axes with pixels, and at most one more to stack them along.
    """

    path: Path
    handle: BinaryIO
    number: int
    start: int
    data: int
    header: PlainHeader
    given: str = ""
    layers: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        self.structure: dict[str, str] = {}
        for match in filter(None, map(_STRUCTURE.match, self.header.images)):
            key, value = match[1], match[2].partition("/")[0].strip()
            if (first := self.structure.setdefault(key, value)) != value:
                raise self.refusal(f"says {key} twice, {first[:30]!r} and {value[:30]!r}")
        if self.number == 0 and self.structure.get("SIMPLE") != "T":
            raise damaged(self.path, "has a damaged primary header (SIMPLE is not T)")
        if not 0 <= self.whole("TFIELDS", 0) <= _MOST_AXES:
            raise self.refusal(f"declares TFIELDS = {self.whole('TFIELDS')} columns")
        extension = self.structure.get("XTENSION", "").strip(" '") if self.number else "IMAGE"
        self.packed = self.structure.get("ZIMAGE") == "T" and extension == "BINTABLE"
        groups = self.number == 0 and self.structure.get("GROUPS") == "T"
        axes = self._axes("NAXIS")
        count = math.prod(axes[:-1] if groups and axes and axes[-1] == 0 else axes) if axes else 0
        elements = self.whole("PCOUNT", 0) + count
        bits = {key: self.whole(key) for key in ("BITPIX", "ZBITPIX")[: 1 + self.packed]}
        for key, value in bits.items():
            if value not in (8, 16, 32, 64, -32, -64):
                raise self.refusal(f"has {key} = {value}, which FITS does not know")
        self.bitpix = bits["ZBITPIX" if self.packed else "BITPIX"]
        self.span = abs(bits["BITPIX"]) // 8 * max(self.whole("GCOUNT", 1) * elements, 0)
        self.next = self.data + -(-self.span // BLOCK) * BLOCK
        self.shape = self._axes("ZNAXIS") if self.packed else axes
        array = not groups and (self.packed or extension in ("IMAGE", "IUEIMAGE"))
        self.what = f"an array of {product_of(self.shape)}" if self.shape else "empty"
        self.what = self.what if array else "random groups" if groups else "a table"
        stacked = sum(side > 1 for side in self.shape[:-2]) <= 1
        self.is_image = array and len(self.shape) > 1 and math.prod(self.shape) > 0 and stacked

    def refusal(self, problem: str) -> FrameError:
        """Return the exception for a damaged file."""
        return damaged(self.path, f"HDU {self.number} {problem}")

    def whole(self, key: str, default: int | None = None) -> int:
        """Return a whole number of the structure, or refuse the file."""
        words = self.structure.get(key)
        if words is None and default is not None:
            return default
        if words is None:
            raise self.refusal(f"has no {key}")
        if _WHOLE.fullmatch(words) is None:
            raise self.refusal(f"has {key} = {words[:30]!r} where a whole number belongs")
        return int(words)

    def _axes(self, stem: str) -> tuple[int, ...]:
        count = self.whole(stem)
        if not 0 <= count <= _MOST_AXES:
            raise self.refusal(f"declares {stem} = {count} axes")
        sides = tuple(self.whole(f"{stem}{n}") for n in range(count, 0, -1))
        if any(side < 0 for side in sides):
            raise self.refusal(f"declares {product_of(sides)} pixels")
        return sides

    @property
    def planes(self) -> int:
        """Number of planes of an image, of those that count."""
        return len(self.layers) or math.prod(self.shape[:-2])

    @cached_property
    def name(self) -> str:
        """EXTNAME in upper case, or else EXTTYPE (LSST); empty where there is neither."""
        name = (self.words("EXTNAME") or self.words("EXTTYPE")).upper()
        return "" if name == _PACKED else name

    def words(self, key: str) -> str:
        """Return the value of a card as text without outer blanks, empty where there is none."""
        return str(self.header.get(key, "")).strip()

    @property
    def version(self) -> int:
        """EXTVER; 1 where there is none."""
        version = self.header.get("EXTVER", 1)
        return version if isinstance(version, int) else 1

    @cached_property
    def role(self) -> str:
        """Return what it says about an image; empty for an image itself, ``"none"`` for anything else."""
        if self.given or not self.is_image:
            return self.given or "none"
        eso = [self.words(key).upper() for key in ("HDUCLAS3", "HDUCLAS2")]
        named = ROLE_OF.get(self.name) or self._named[0]
        role = next((_ESO_ROLES[word] for word in eso if word in _ESO_ROLES), named)
        return _ASTROPY_UNCERTAINTY.get(self.words("UTYPE").lower(), role) if role == "sigma" else role

    @property
    def detector(self) -> tuple[str, ...]:
        """Words of the name that say of which detector it is: of SCI1, ERR_1 and DQ.1 ``("1",)``."""
        return self._named[1]

    @cached_property
    def _named(self) -> tuple[str, tuple[str, ...]]:
        """The role that a word of the name gives, as in CCD1_ERR, and the words for the detector."""
        found = _NAMED_ROLE.findall(self.name)
        listed = len(found) > 1 or re.search("[,;|+]", self.name)  # the labels of a cube's planes
        if self.name in ROLE_OF or self.header.get("HDUCLAS2") or listed:
            return "", ()
        words = re.findall(r"[A-Z]+|\d+", _NO_DETECTOR.sub(" ", self.name))
        return ROLE_OF[found[0]] if found else "", tuple(words)

    def is_of_one_camera(self, other: Hdu) -> bool:
        """Return whether two images are of different chips of one camera, as far as their headers say."""
        alike = re.sub(r"\d+", "#", self.name) == re.sub(r"\d+", "#", other.name)
        reads = {one.words("SAMPNUM") for one in (self, other)} - {""}
        alike = alike and len(reads) < 2
        chips = any(key in self.header and key in other.header for key in _CHIP_KEYS)
        pairs = list(zip(self.detector, other.detector, strict=False))  # SCI_A and SCI_B, 1-1.E and 1-2.F
        lettered = self.detector != other.detector and len(self.detector) == len(other.detector)
        lettered = lettered and all(a == b or _are_numbers(a, b) for a, b in pairs)
        return bool(self.name and other.name) and (alike or chips or lettered)

    @property
    def may_describe(self) -> bool:
        """Return whether an image seems to say something about the pixels of another, and not what."""
        named = self.name and not _DESCRIBES.search(self.name)
        return self.is_image and not self.role and not named

    @property
    def constant(self) -> float:
        """The value of all pixels of an array that HST leaves out, 0 where there is none."""
        value = self.header.get("PIXVALUE", 0) if self.what == "empty" else 0
        return float(value) if isinstance(value, int | float) else 0.0

    @property
    def columns(self) -> list[str]:
        """Names of the columns of a table, or of the table in which an image is packed."""
        return [self.words(f"TTYPE{n}") for n in range(1, self.whole("TFIELDS", 0) + 1)]

    @property
    def title(self) -> str:
        """``"HDU 2 ERR,1"``."""
        return f"HDU {self.number} {self.name}".rstrip() + f",{self.version}" * ("EXTVER" in self.header)

    @property
    def label(self) -> str:
        """``"ERR (HDU 2)"``."""
        name, where = self.name or self.given or "image", f"HDU {self.number}"
        if self.layers:
            name = self.given or "image"
            where = f"plane {', '.join(str(n + 1) for n in self.layers)} of {where}"
        elif self.given:
            where = f"{where} of {self.path.name}"
        return f"{name} ({where})"


def _are_numbers(one: str, other: str) -> bool:
    """Return whether two words may tell detectors apart: two numbers, or two single letters."""
    return (one + other).isdigit() or ((one + other).isalpha() and len(one) == len(other) == 1)


def product_of(sides: tuple[int, ...]) -> str:
    """Sides in the order of FITS, the first of them where there are very many."""
    shown = " x ".join(map(str, sides[:-6:-1]))
    return f"{shown} x ..." if len(sides) > 5 else shown
