"""Which HDUs of a FITS file belong together: images, and the variance and quality of their pixels.

:func:`frame_groups` tells by name (EXTNAME, EXTVER) and order what is an image of its own and what says
something about one; no pixel is read.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from jitterkit.frames.hdu import Unit, product_of
from jitterkit.frames.plainheader import PlainHeader
from jitterkit.frames.units import resolve_unit

__all__ = ["Group", "Named", "frame_groups"]

_ROLES: Mapping[str, tuple[str, ...]] = {
    "quality": ("DQ", "MASK", "FLAGS", "FLAG", "FLG", "DQMASK", "BPM", "BADPIX", "BAD_PIXEL_MASK"),
    "shot": ("VAR_POISSON",),
    "read": ("VAR_RNOISE",),
    "variance": ("VARIANCE", "VAR"),
    "sigma": ("ERR", "ERROR", "ERRORS", "UNCERT", "UNCERTAINTY", "STD", "STDDEV", "SIGMA", "RMS", "NOISE"),
    "weight": ("WHT", "WEIGHT", "WEIGHTS", "WGT", "IVAR", "INVVAR", "IVM"),
}
"""Names of what is said about the pixels of an image: quality bits, variance, its root, its inverse."""

_ROLE_OF = {name: role for role, names in _ROLES.items() for name in names}

_NOISE = (("shot", "read"), ("variance",), ("sigma",), ("weight",))
"""Roles that together give the variance, the first preferred."""

_NO_IMAGE = ("CTX", "CON", "AREA", "SAMP", "TIME", "WAVELENGTH", "PSFIMAGE", "BKG", "BACKGROUND", "VAR_FLAT")
"""Names of images about other things."""

_CHIP_KEYS = ("CCDNUM", "CCDNAME", "DETSEC", "CHIPID", "DETECSEC")
"""Keywords of one detector among others of a camera."""

_ASTROPY_UNCERTAINTY = {
    "stddevuncertainty": "sigma",
    "varianceuncertainty": "variance",
    "inversevariance": "weight",
    "unknownuncertainty": "none",
}
"""UTYPE of what CCDData writes."""


@dataclass(frozen=True)
class Named:
    """An HDU with its name.

    Parameters
    ----------
    unit : Unit
    header : PlainHeader
    given : str
        Its role, where it is known otherwise than by its name.
    """

    unit: Unit
    header: PlainHeader
    given: str = ""

    @property
    def name(self) -> str:
        """EXTNAME in upper case, empty where there is none."""
        return str(self.header.get("EXTNAME", "")).strip().upper()

    @property
    def version(self) -> int:
        """EXTVER; 1 where there is none."""
        version = self.header.get("EXTVER", 1)
        return version if isinstance(version, int) else 1

    @property
    def role(self) -> str:
        """What it says about an image; empty for an image itself, ``"none"`` for anything else."""
        if self.given or not self.unit.is_image or self.name in _NO_IMAGE:
            return self.given or "none"
        role = _ROLE_OF.get(self.name, "")
        said = str(self.header.get("UTYPE", "")).strip().lower()
        return _ASTROPY_UNCERTAINTY.get(said, role) if role == "sigma" else role

    @property
    def columns(self) -> list[str]:
        """Names of the columns of a table."""
        count = self.unit.whole("TFIELDS", 0) if self.unit.what == "a table" else 0
        return [str(self.header.get(f"TTYPE{n}", "")).strip() for n in range(1, count + 1)]

    @property
    def title(self) -> str:
        """``"HDU 2 ERR,1"``."""
        return f"HDU {self.unit.number} {self.name}".rstrip() + f",{self.version}" * ("EXTVER" in self.header)

    @property
    def label(self) -> str:
        """``"ERR (HDU 2)"``."""
        where = (
            f"HDU {self.unit.number} of {self.unit.path.name}" if self.given else f"HDU {self.unit.number}"
        )
        return f"{self.name or self.given or 'image'} ({where})"


@dataclass
class Group:
    """An image with what its file says about its pixels.

    Parameters
    ----------
    image : Named
    quality : Named, optional
    noise : dict of str to Named
        By role: ``"shot"`` and ``"read"``, or one of ``"variance"``, ``"sigma"``, ``"weight"``.
    weight_is_time : bool
        Whether the weight may be an exposure time, as AstroDrizzle writes it by default.
    coordinates : Named, optional
        Table with a WCS for each plane, which is not read.
    warnings : list of str
        Why something that seemed to belong is not used.
    """

    image: Named
    quality: Named | None = None
    noise: dict[str, Named] = field(default_factory=dict)
    weight_is_time: bool = False
    coordinates: Named | None = None
    warnings: list[str] = field(default_factory=list)

    @property
    def noise_label(self) -> str:
        """Where the variance comes from."""
        return " + ".join(one.label for one in self.noise.values())

    def add(self, others: Sequence[Named]) -> None:
        """Take what fits from HDUs that may say something about the image."""
        fitting = [other for other in others if self._fits(other)]
        by_role = {other.role: other for other in reversed(fitting)}
        self.quality = self.quality or by_role.get("quality")
        for roles in _NOISE:
            if not self.noise and all(role in by_role for role in roles):
                self.noise = {role: by_role[role] for role in roles}
        tables = (other for other in others if "CD1_1" in other.columns)
        self.coordinates = next(tables, None) if any(n > 1 for n in self.image.unit.shape[:-2]) else None
        self.weight_is_time = "weight" in self.noise and any(other.name == "CTX" for other in others)

    def add_from(self, role: str, others: Sequence[Named]) -> None:
        """Take the quality or the weight that another file has of this image, unless its own file has one."""
        wanted = [one for one in others if one.unit.is_image and one.name == self.image.name]
        if len(wanted) == 1 and (self.quality is None if role == "quality" else not self.noise):
            found = Named(wanted[0].unit, wanted[0].header, role)
            if self._fits(found):
                self.quality = found if role == "quality" else self.quality
                self.noise = {role: found} if role == "weight" else self.noise

    def _fits(self, other: Named) -> bool:
        if other.role in ("", "none"):
            return False
        (*planes, ny, nx), (*own, height, width) = other.unit.shape, self.image.unit.shape
        alike = [n for n in planes if n > 1] in ([], [n for n in own if n > 1])
        units = [str(one.header.get("BUNIT", "")).strip() for one in (self.image, other)]
        if other.role == "sigma" and all(units) and resolve_unit(units[0]) != resolve_unit(units[1]):
            self.warnings.append(
                f"{other.label} is in {units[1]} and the image in {units[0]}: it is not used"
            )
            return False
        if alike and (ny, nx) == (height, width):
            return True
        shapes = f"{product_of(other.unit.shape)} pixels and the image {product_of(self.image.unit.shape)}"
        self.warnings.append(f"{other.label} has {shapes}: it is not used")
        return False

    @property
    def units(self) -> dict[int, str]:
        """What each HDU of the group is for, by its number, of those in the image's file."""
        path, words = self.image.unit.path, {"sigma": "error", "shot": "variance", "read": "variance"}
        found = {self.image.unit.number: "image"}
        if self.quality is not None and self.quality.unit.path == path:
            found[self.quality.unit.number] = f"mask of HDU {self.image.unit.number}"
        for role, one in self.noise.items():
            if one.unit.path == path:
                found[one.unit.number] = f"{words.get(role, role)} of HDU {self.image.unit.number}"
        return found


def frame_groups(hdus: Sequence[Named], hdu: int | None) -> list[Group]:
    """Tell which HDUs are images to be read, and what belongs to each.

    Parameters
    ----------
    hdus : sequence of Named
        All of a file.
    hdu : int, optional
        The only image wanted; by default the first, and those that are other detectors of the same camera:
        they have its EXTNAME with another EXTVER, or but for digits, or both name their chip.

    Returns
    -------
    groups : list of Group
        Empty where there is no such image.
    """
    images = [one for one in hdus if one.unit.is_image]
    science = [one for one in images if one.role == ""] or images
    first = next((one for one in images if one.unit.number == hdu), None) if hdu is not None else None
    first = science[0] if hdu is None and science else first
    if first is None:
        return []
    chips = [one for one in science if one is first or _is_other_chip(first, one)]
    groups = []
    for image in [first] if hdu is not None else chips:
        group = Group(image)
        if first.role == "":
            group.add(_beside(image, chips, science, hdus))
        groups.append(group)
    return groups


def _is_other_chip(first: Named, other: Named) -> bool:
    if not first.name or not other.name:
        return False
    if first.name == other.name or re.sub(r"\d+", "#", first.name) == re.sub(r"\d+", "#", other.name):
        return True
    return any(key in first.header and key in other.header for key in _CHIP_KEYS)


def _beside(image: Named, chips: list[Named], science: list[Named], hdus: Sequence[Named]) -> list[Named]:
    """What may belong to one image: of its EXTVER, or what follows it up to the next image."""
    if len(chips) == 1 and image is science[0]:
        return list(hdus)
    if len(chips) > 1 and len({one.version for one in chips}) == len(chips):
        return [one for one in hdus if one.version == image.version]
    after = [one.unit.number for one in science if one.unit.number > image.unit.number]
    end = min(after, default=hdus[-1].unit.number + 1)
    return [one for one in hdus if image.unit.number < one.unit.number < end]
