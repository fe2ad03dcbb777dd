"""The chain of HDUs of a FITS file, followed with suspicion.

Of a damaged header a reader would look for the end through gigabytes.  :func:`read_hdus` follows the chain by
what :class:`~jitterkit.frames.hdu.Hdu` believes, and :func:`find_images` chooses the images in it.
:func:`frame_groups` finds by name (EXTNAME, EXTVER) which of them are frames, and which hold the variance and
the quality of a frame's pixels.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import BinaryIO

from jitterkit.errors import ErrorCode, FrameError
from jitterkit.frames.files import damaged, truncated, unpacks_believably
from jitterkit.frames.fitsio import CARD, PlainHeader
from jitterkit.frames.group import Group
from jitterkit.frames.hdu import BLOCK, Hdu
from jitterkit.frames.planes import role_of_label

_FRAMES_TOO = ("BIAS", "DARK", "FLAT", "SKY", "PSF")
"""EXTNAME of images that are read without a word where a file has no other."""


def is_science(hdu: Hdu) -> bool:
    """Return whether an image comes before any other of a file by its EXTNAME."""
    return hdu.name in ("SCI", "SCIENCE")


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
    science.sort(key=lambda one: (not is_science(one), bool(one.name) and one.may_describe))
    first = next((one for one in (science if hdu is None else images) if hdu in (None, one.number)), None)
    if first is None:
        return []
    chips = [one for one in science if one is first or first.is_of_one_camera(one)]
    groups = [Group(image) for image in ([first] if hdu is not None else chips)]
    described = first.role or role_of_label(first.name)
    other = first.role == "none" and first.name not in _FRAMES_TOO
    if hdu is None and (other or described not in ("", "image", "none")):
        groups[0].warnings.append(f"{first.label} is read as an image; its name says that it describes one")
    for group in groups if first.role == "" else []:
        group.add(_beside(group.image, chips, science, hdus))
        group.warnings += _of_others(group, chips, hdus)
    return groups


def _beside(image: Hdu, chips: list[Hdu], science: list[Hdu], hdus: Sequence[Hdu]) -> list[Hdu]:
    """Return what may belong to one image: of its detector by name, its EXTVER, or what follows it."""
    named = [one for one in hdus if one.role and one.detector]
    own = [one for one in named if one.detector == image.detector]
    others = {one.detector for one in science} - {image.detector}
    hdus = [one for one in hdus if one not in own and not (one in named and one.detector in others)]
    read = image.words("SAMPNUM")  # of one exposure with several (WFC3/IR), the last of which comes first
    reads = bool(read and {one.words("SAMPNUM") for one in science} - {read, ""})
    if len(chips) == 1 and image is science[0] and not reads:
        return own + hdus
    if reads or (len(chips) > 1 and len({one.version for one in chips}) == len(chips)):
        return own + [one for one in hdus if one.version == image.version]
    after = [one.number for one in science if one.number > image.number]
    end = min(after, default=math.inf)
    return own + [one for one in hdus if image.number < one.number < end]


def _of_others(group: Group, chips: list[Hdu], hdus: Sequence[Hdu]) -> list[str]:
    """Warn of a mask or an error that an image lacks and a later one has, by the order of the file alone."""
    image, has = group.image, {role == "quality" for role in group.parts}
    later = (one for one in hdus if one.role not in ("", "none") and one.number > image.number)
    alike = (one for one in later if not one.detector and one.shape[-2:] == image.shape[-2:])
    lacking = next((one for one in alike if (one.role == "quality") not in has), None)
    if lacking is None or [chip.version for chip in chips].count(image.version) == 1:
        return []
    said = f"{lacking.label} is not used for {image.label}, as it follows another image"
    return [f"{said}: give each its own, or number them by EXTVER"]


_MOST_HEADER_BLOCKS, _MOST_BLOCKS = 1000, 20000
"""Headers of more blocks than this (36,000 cards, read in 0.3 s), or all HDUs together, have no END."""

_MOST_HDUS = 1000
"""So many HDUs are searched."""

_NO_TEXT = re.compile(rb"[^ -~]")


def read_hdus(
    path: Path, handle: BinaryIO, wanted: int | None, *, sound: bool = False
) -> tuple[list[Hdu], list[str]]:
    """Read the headers of a file.

    Parameters
    ----------
    path : Path
        The file.
    handle : file object
        Its bytes, unzipped.
    wanted : int, optional
        The HDU that must be readable; by default one with an image.
    sound : bool
        Whether all that follow it must be readable too.

    Returns
    -------
    hdus : list of Hdu
        Up to 1000.
    warnings : list of str
        Why those behind the image cannot be read.

    Raises
    ------
    FrameError
        If the primary header is none or has no END, or a header up to the image contradicts FITS.
    """
    hdus: list[Hdu] = []
    start, blocks, size = 0, _MOST_BLOCKS, path.stat().st_size
    try:
        # beyond what unpacks believably nothing lies, and to seek there through a gzip may take an hour
        while len(hdus) < _MOST_HDUS and unpacks_believably(start, 0, size):
            handle.seek(start)
            number, most = len(hdus), min(blocks, _MOST_HEADER_BLOCKS)
            text, read = _header(handle, most, b"XTENSION" if number else b"SIMPLE")
            if isinstance(text, ErrorCode) and number:
                break
            if text is ErrorCode.UNKNOWN_FORMAT:
                raise FrameError(text, path, "does not begin as a FITS file does", "give a FITS file")
            if isinstance(text, ErrorCode):
                refuse = truncated if text is ErrorCode.TRUNCATED else damaged
                raise refuse(path, "has a FITS header without an END card")
            blocks -= read
            hdus.append(Hdu(path, handle, number, start, start + read * BLOCK, PlainHeader(text)))
            start = hdus[-1].next
    except FrameError as error:
        if sound or not any(hdu.is_image and wanted in (None, hdu.number) for hdu in hdus):
            raise
        return hdus, [f"what follows HDU {hdus[-1].number} is not used: {error.problem}"]
    return hdus, []


def _header(handle: BinaryIO, most: int, first: bytes) -> tuple[bytes | ErrorCode, int]:
    """Return the cards before END and the number of blocks read; without END, an error code and zero."""
    text = bytearray()
    for number in range(1, most + 1):
        block = handle.read(BLOCK)
        if number == 1 and not block.startswith(first):
            return ErrorCode.TRUNCATED if block and first.startswith(block) else ErrorCode.UNKNOWN_FORMAT, 0
        if not block:
            # a damaged END card is followed by pixels, which are not text
            return ErrorCode.DAMAGED if _NO_TEXT.search(text) else ErrorCode.TRUNCATED, 0
        for found in re.finditer(rb"END {0,5}", block):
            if found.start() % CARD == 0 and not block[found.end() : found.start() + 8]:
                return bytes(text + block[: found.start()]), number
        text += block
    return ErrorCode.DAMAGED, 0


def find_images(path: Path, handle: BinaryIO, wanted: int | None) -> tuple[list[Group], list[Hdu], list[str]]:
    """Find the images asked for, with what belongs to each.

    Parameters and errors are those of :func:`read_hdus`.

    Returns
    -------
    groups : list of Group
        At least one; FrameError is raised where there is none.
    hdus, warnings
        As :func:`read_hdus` returns them.
    """
    hdus, warnings = read_hdus(path, handle, wanted)
    groups, last = frame_groups(hdus, wanted), hdus[-1]
    if groups:
        return groups, hdus, warnings
    if wanted is not None and 0 <= wanted <= last.number:
        problem = f"HDU {wanted} is not a two- or three-dimensional image but {hdus[wanted].what}"
        raise FrameError(ErrorCode.NO_IMAGE, path, problem, "choose another HDU")
    if wanted is None:
        contents = [f"HDU {hdu.number}: {hdu.what}" for hdu in hdus[:6]] + ["..."] * (len(hdus) > 6)
        problem = f"holds no image ({', '.join(contents)})"
        remedy = "give a file with a two- or three-dimensional image"
    else:
        problem, remedy = f"has no HDU {wanted}", f"choose one from 0 to {last.number}"
    # a file may end within its last HDU, or within the header of a further one
    end = last.data + last.span
    short = not unpacks_believably(end, 0, path.stat().st_size)
    if not short:
        handle.seek(end - 1)
        short = not handle.read(1)
    if not short:
        handle.seek(last.next)
        short = _header(handle, _MOST_HEADER_BLOCKS, b"XTENSION")[0] is ErrorCode.TRUNCATED
    if short:
        raise truncated(path, problem)
    raise FrameError(ErrorCode.NO_IMAGE, path, problem, remedy)
