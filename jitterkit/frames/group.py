"""One image of a FITS file with the HDUs that describe its pixels: :class:`Group`."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from jitterkit.frames.beside import units_agree
from jitterkit.frames.hdu import ROLE_OF, Hdu, product_of
from jitterkit.frames.planes import numbers_of_planes, split_planes

_NOISE = (("shot", "read"), ("variance",), ("sigma",), ("weight",))
"""Roles that together give the variance, the first preferred."""

_SCALES = {"CD1_1", "PC1_1", "CDELT1"}
"""Columns of a table that has a WCS for each plane of a cube."""


_BAD_NAME = re.compile(r"(?<![A-Z])(MA?SK(?!_)|BAD|HOT|DEAD|DEFECT|BPM|DQ)")
_BAD_COLUMNS = re.compile(
    r"(RAW|DET|CCD|PIX)?_?[XY]_?([12]|MIN|MAX|START|END|SIZE|PIX\w*)?|(COL|ROW|LINE)(UMN)?S?_?[12]?|[IJ]"
    r"|PIX(EL)?S?|TYPE|CODE|FLAGS?|STATUS|DQ|QUAL(ITY)?|VALUE|[XY]?EXTENT|BAD(FLAG|PIX\w*)?|N|ID|NUM(BER)?"
)
_KIND_OF_BAD = re.compile(r"PIX(EL)?S?|TYPE|CODE|FLAGS?|STATUS|DQ|QUAL(ITY)?|BAD(FLAG|PIX\w*)?")
"""Name of a table that may list bad pixels; columns of such a list, if it has no others; one it must have."""


@dataclass
class Group:
    """An image with what its file says about its pixels.

    Parameters
    ----------
    image : Hdu
    parts : dict of str to Hdu
        By role: ``"quality"``; ``"shot"`` and ``"read"``, or ``"variance"``, ``"sigma"`` or ``"weight"``.
    weight_is_time : bool
        Whether the weight may be an exposure time, as AstroDrizzle writes it by default.
    coordinates : Hdu, optional
        Table with a WCS for each plane, which is not read.
    warnings : list of str
        Why something that seemed to belong is not used.
    """

    image: Hdu
    parts: dict[str, Hdu] = field(default_factory=dict)
    weight_is_time: bool = False
    coordinates: Hdu | None = None
    warnings: list[str] = field(default_factory=list)

    def add(self, hdus: Sequence[Hdu]) -> None:
        """Take what fits from the image's own planes and from HDUs that may say something about it."""
        self.image, own, warnings = split_planes(self.image)
        self.warnings += warnings
        whole, layers = self.image.shape, self.image.layers
        shared = [replace(one, layers=layers) if layers and one.shape == whole else one for one in hdus]
        others = [*own, *shared]
        fitting = {other.role: other for other in reversed([o for o in others if self._fits(o)])}
        noise = next((roles for roles in _NOISE if fitting.keys() >= set(roles)), ())
        self.parts = {role: fitting[role] for role in ("quality", *noise) if role in fitting}
        self.warnings += filter(None, map(self._unused, others))
        self.warnings += numbers_of_planes(self.image, hdus)
        tables = (other for other in others if _SCALES & set(other.columns) and other.what == "a table")
        self.coordinates = next(tables, None) if self.image.planes > 1 else None
        self.weight_is_time = "weight" in noise and any(other.name == "CTX" for other in others)

    def add_from(self, role: str, others: Sequence[Hdu]) -> None:
        """Take the quality or the weight that another file has of this image, unless its own file has one."""
        found = [replace(o, given=role) for o in others if o.is_image and o.name == self.image.name]
        has = [own for own in self.parts if (own == "quality") == (role == "quality")]
        if len(found) == 1 and not has and self._fits(found[0]):
            self.parts[role] = found[0]

    def _unused(self, other: Hdu) -> str:
        """Say why what seems to describe the pixels of the image is not used; empty of anything else."""
        if _may_list_bad_pixels(other) and "quality" not in self.parts:
            said = f"{other.label} is a table that may list bad pixels, and is not read"
            return f"{said}: write them as an image called DQ, not zero where bad"
        used = self.parts.get(other.role)
        alike = other.is_image and other.shape[-2:] == self.image.shape[-2:]
        if alike and other.words("HDUCLAS3").upper() == "MASKZERO":
            return f"{other.label} is not used, as its zeros are the bad pixels"
        if other.name in ROLE_OF and other.constant:
            return f"{other.label} is {other.constant:g} in all pixels, without an array, and is not used"
        if (other.number == self.image.number and not other.given) or not alike or other.role == "none":
            return ""
        counts = not other.role and other.bitpix > 0 > self.image.bitpix  # integers beside floats are flags
        if other.may_describe or counts or (other.role and not self._is_of(other)):
            return f"{other.label} may describe the pixels and is not used, as its name does not say how"
        if used not in (None, other) and (other.role == "quality" or other.detector):
            return f"{other.label} is not used beside {used.label}"
        return ""

    def _is_of(self, other: Hdu) -> bool:
        return other.detector in ((), self.image.detector)

    def _fits(self, other: Hdu) -> bool:
        if other.role in ("", "none") or not self._is_of(other):
            return False
        alike = other.planes in (1, self.image.planes) and other.shape[-2:] == self.image.shape[-2:]
        units = [one.words("BUNIT") for one in (self.image, other)]
        if other.role != "quality" and all(units) and not units_agree(units[0], units[1], other.role):
            said = f"{other.label} is in {units[1]} and the image in {units[0]}: it is not used"
            self.warnings.append(said)
            return False
        if alike:
            return True
        shapes = f"{product_of(other.shape)} pixels and the image {product_of(self.image.shape)}"
        self.warnings.append(f"{other.label} has {shapes}: it is not used")
        return False

    @property
    def uses(self) -> dict[int, str]:
        """Return what each HDU of the group is for, by its number, of those in the image's file."""
        words = {"quality": "mask", "sigma": "error", "shot": "variance", "read": "variance"}
        found = {self.image.number: "image"}
        for role, part in self.parts.items():
            if part.number == self.image.number and part.path == self.image.path:
                found[part.number] += f", {words.get(role, role)}"
            elif part.path == self.image.path:
                found[part.number] = f"{words.get(role, role)} of HDU {self.image.number}"
        return found


def _may_list_bad_pixels(table: Hdu) -> bool:
    """Return whether a table seems to list bad pixels, by its name, or as it has no columns but such."""
    columns = [column.upper() for column in table.columns]
    # places alone may be those of stars, as a name would say
    kinds = not table.name or any(map(_KIND_OF_BAD.fullmatch, columns))
    listed = len(columns) > 1 and kinds and all(map(_BAD_COLUMNS.fullmatch, columns))
    return table.what == "a table" and (listed or _BAD_NAME.search(table.name) is not None)
