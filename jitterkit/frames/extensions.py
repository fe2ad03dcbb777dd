"""Which HDUs of a FITS file belong together: images, and the variance and quality of their pixels.

:func:`frame_groups` tells by name (EXTNAME, EXTVER) and order what is an image of its own and what says
something about one; no pixel is read.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from jitterkit.frames.hdu import Hdu, product_of
from jitterkit.frames.units import resolve_unit

__all__ = ["Group", "frame_groups"]

_NOISE = (("shot", "read"), ("variance",), ("sigma",), ("weight",))
"""Roles that together give the variance, the first preferred."""

_CHIP_KEYS = ("CCDNUM", "CCDNAME", "DETSEC", "CHIPID", "DETECSEC")
"""Keywords of one detector among others of a camera."""


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

    @property
    def noise(self) -> dict[str, Hdu]:
        """The parts that give the variance."""
        return {role: part for role, part in self.parts.items() if role != "quality"}

    @property
    def noise_label(self) -> str:
        """Where the variance comes from."""
        return " + ".join(part.label for part in self.noise.values())

    def add(self, others: Sequence[Hdu]) -> None:
        """Take what fits from HDUs that may say something about the image."""
        fitting = {other.role: other for other in reversed([o for o in others if self._fits(o)])}
        noise = next((roles for roles in _NOISE if fitting.keys() >= set(roles)), ())
        self.parts = {role: fitting[role] for role in ("quality", *noise) if role in fitting}
        tables = (other for other in others if "CD1_1" in other.columns)
        self.coordinates = next(tables, None) if self.image.planes > 1 else None
        self.weight_is_time = "weight" in noise and any(other.name == "CTX" for other in others)

    def add_from(self, role: str, others: Sequence[Hdu]) -> None:
        """Take the quality or the weight that another file has of this image, unless its own file has one."""
        found = [replace(o, given=role) for o in others if o.is_image and o.name == self.image.name]
        has = "quality" in self.parts if role == "quality" else self.noise
        if len(found) == 1 and not has and self._fits(found[0]):
            self.parts[role] = found[0]

    def _fits(self, other: Hdu) -> bool:
        if other.role in ("", "none"):
            return False
        (*planes, ny, nx), (*own, height, width) = other.shape, self.image.shape
        alike = [n for n in planes if n > 1] in ([], [n for n in own if n > 1])
        units = [one.words("BUNIT") for one in (self.image, other)]
        if other.role == "sigma" and all(units) and resolve_unit(units[0]) != resolve_unit(units[1]):
            self.warnings.append(
                f"{other.label} is in {units[1]} and the image in {units[0]}: it is not used"
            )
            return False
        if alike and (ny, nx) == (height, width):
            return True
        shapes = f"{product_of(other.shape)} pixels and the image {product_of(self.image.shape)}"
        self.warnings.append(f"{other.label} has {shapes}: it is not used")
        return False

    @property
    def uses(self) -> dict[int, str]:
        """What each HDU of the group is for, by its number, of those in the image's file."""
        words = {"quality": "mask", "sigma": "error", "shot": "variance", "read": "variance"}
        found = {self.image.number: "image"}
        for role, part in self.parts.items():
            if part.path == self.image.path:
                found[part.number] = f"{words.get(role, role)} of HDU {self.image.number}"
        return found


def frame_groups(hdus: Sequence[Hdu], hdu: int | None) -> list[Group]:
    """Tell which HDUs are images to be read, and what belongs to each.

    Parameters
    ----------
    hdus : sequence of Hdu
        All of a file.
    hdu : int, optional
        The only image wanted; by default the first, and those that are other detectors of the same camera:
        they have its EXTNAME with another EXTVER, or but for digits, or both name their chip.

    Returns
    -------
    groups : list of Group
        Empty where there is no such image.
    """
    images = [one for one in hdus if one.is_image]
    science = [one for one in images if one.role == ""] or images
    first = next((one for one in (science if hdu is None else images) if hdu in (None, one.number)), None)
    if first is None:
        return []
    chips = [one for one in science if one is first or _is_other_chip(first, one)]
    groups = [Group(image) for image in ([first] if hdu is not None else chips)]
    for group in groups if first.role == "" else []:
        group.add(_beside(group.image, chips, science, hdus))
    return groups


def _is_other_chip(first: Hdu, other: Hdu) -> bool:
    alike = re.sub(r"\d+", "#", first.name) == re.sub(r"\d+", "#", other.name)
    chips = any(key in first.header and key in other.header for key in _CHIP_KEYS)
    return bool(first.name and other.name) and (alike or chips)


def _beside(image: Hdu, chips: list[Hdu], science: list[Hdu], hdus: Sequence[Hdu]) -> list[Hdu]:
    """What may belong to one image: of its EXTVER, or what follows it up to the next image."""
    if len(chips) == 1 and image is science[0]:
        return list(hdus)
    if len(chips) > 1 and len({one.version for one in chips}) == len(chips):
        return [one for one in hdus if one.version == image.version]
    after = [one.number for one in science if one.number > image.number]
    end = min(after, default=hdus[-1].number + 1)
    return [one for one in hdus if image.number < one.number < end]
