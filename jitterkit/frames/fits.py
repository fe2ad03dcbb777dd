"""FITS files as frames, and images of FITS files that need not be frames: kernels, pupils, PSFs.

Reach for :class:`FitsFile`.  The chain of HDUs is followed in :mod:`~jitterkit.frames.hdus` first, so that
nothing is believed of a header that the file cannot hold.  The pixels are read one plane at a time in
:mod:`~jitterkit.frames.pixels`; headers, tiles and coordinates are astropy's.
"""

from __future__ import annotations

import bisect
import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from jitterkit.frames.beside import rows_from_the_top
from jitterkit.frames.cards import Cards
from jitterkit.frames.files import files_beside, open_bytes
from jitterkit.frames.fitsimage import FitsImage
from jitterkit.frames.fitsio import PlainHeader, all_hdus
from jitterkit.frames.frame import RawFrame
from jitterkit.frames.framefile import FrameFile, translated
from jitterkit.frames.group import Group
from jitterkit.frames.hdu import Hdu
from jitterkit.frames.hdus import find_images, is_science, read_hdus
from jitterkit.frames.pixels import open_pixels


class FitsFile(FrameFile):
    """The planes of one image HDU of a FITS file, or of the detectors of one camera.

    Parameters
    ----------
    path : Path
        Plain, gzipped or tile-compressed.
    hdu : int, optional
        By default the first with a two- or three-dimensional image.

    Raises
    ------
    FrameError
        If there is no such HDU, no image, more data declared than present, or no readable header.
    """

    kind = "FITS"

    def __init__(self, path: Path, hdu: int | None) -> None:
        super().__init__(path)
        self._images: dict[int, FitsImage] = {}
        with translated(path) as caught:
            try:
                self._handle = self.enter_context(open_bytes(path))
                self._groups, self._hdus, broken = find_images(path, self._handle, hdu)
                for role, other in files_beside(path):
                    beside, _ = read_hdus(other, self.enter_context(open_bytes(other)), None)
                    for group in self._groups:
                        group.add_from(role, beside)
                self._starts = [0, *itertools.accumulate(group.image.planes for group in self._groups)]
                self._count = self._starts[-1]
                first = self._image(0)
            except BaseException:
                self.close()
                raise
        self.hdu, self.shape, self.dtype = first.hdu.number, first.shape, first.dtype
        broken += _left_out(self._hdus, self._groups) if hdu is None else []
        self.metadata = first.metadata = first.metadata.warn(*broken, *caught)

    def _image(self, number: int) -> FitsImage:
        if number not in self._images:
            tables = partial(all_hdus, self._handle)
            self._images[number] = FitsImage(self._groups[number], self._hdus[0].header, tables)
        return self._images[number]

    def _read(self, index: int) -> RawFrame:
        number = bisect.bisect_right(self._starts, index) - 1
        frame = self._image(number).read(index - self._starts[number])
        self.metadata = self._image(0).metadata
        return frame.with_fields(after=index - self._starts[number])

    def text(self, key: str) -> str:
        """Return a keyword of the first image's header, or of the primary one, as text."""
        hdu = self._groups[0].image
        return Cards(hdu.header, hdu.number, self._hdus[0].header).text(key)

    def _stacking(self) -> str:
        shared = any(group.image.planes > 1 and group.coordinates is None for group in self._groups)
        labelled = [group.image.label for group in self._groups if group.image.layers]
        return ", ".join(labelled) or "planes of one header" * shared

    def _contents(self) -> list[tuple[str, str, str, str]]:
        if len(self._hdus) == 1:
            return []
        uses = {number: use for group in self._groups for number, use in group.uses.items()}
        return [(hdu.title, hdu.what, "", uses.get(hdu.number, "not used")) for hdu in self._hdus]


def _left_out(hdus: list[Hdu], groups: list[Group]) -> list[str]:
    """Warn of images as large as those that are read, and of masks and errors, that no frame has.

    Beside an image called SCI others are known to be none; and a warning may have named them.
    """
    used = {number for group in groups for number in group.uses}
    kinds = {role == "quality" for group in groups for role in group.parts}
    said, first = " ".join(text for group in groups for text in group.warnings), groups[0].image
    left = [one for one in hdus if one.is_image and one.number not in used and one.label not in said]
    labels = [
        one.label
        for one in left
        if (one.role and one.role != "none" and (one.role == "quality") not in kinds)
        or (not one.role and not is_science(first) and min(one.shape[-2:]) >= min(first.shape[-2:]))
    ]
    shown = ", ".join(labels[:3]) + " and others" * (len(labels) > 3)
    return [f"not used: {shown}; --hdu reads another image"] if labels else []


def is_plane(path: Path, hdu: int | None = None) -> bool:
    """Return whether a file holds one frame, by its layout alone; raises as :class:`FitsFile` does."""
    with translated(path), open_bytes(path) as handle:
        return sum(group.image.planes for group in find_images(path, handle, hdu)[0]) == 1


@dataclass(frozen=True)
class NamedImage:
    """One image of a FITS file that need not be a frame: a pupil, a PSF.

    Parameters
    ----------
    hdu : int
    name : str
        EXTNAME in upper case; empty if there is none.
    pixels : (..., ny, nx) array
        float64, scaled; blank pixels are NaN; row index upwards.
    header : PlainHeader
        Of its own HDU.
    """

    hdu: int
    name: str
    pixels: np.ndarray
    header: PlainHeader

    def positive(self, *keys: str) -> float | None:
        """Return the first of some cards that holds a positive number."""
        values = (self.header.get(key) for key in keys)
        numbers = (v for v in values if isinstance(v, int | float) and not isinstance(v, bool))
        return next((float(number) for number in numbers if 0 < number < math.inf), None)

    def quantity(self, name: str, *keys: str) -> float | None:
        """Return the first of some cards that holds a positive number, converted to the unit of a quantity.

        Parameters
        ----------
        name : str
            ``"plate_scale"`` (arcsec) or ``"pupil_scale"`` (m): what a card without a unit is in.
        *keys : str
            Those whose unit is another, or cannot be read, are passed over.
        """
        cards = Cards(self.header, self.hdu)
        numbers = filter(None, (cards.quantity(name, key) for key in keys))
        return next((number.value for number in numbers if number.positive), None)


def read_images(path: Path) -> tuple[list[NamedImage], Mapping[str, Any]]:
    """Read every image of a file, with its name and header.

    Parameters
    ----------
    path : Path
        Plain, gzipped or tile-compressed.

    Returns
    -------
    images : list of NamedImage
        In the order of the file.
    header : PlainHeader
        Of the primary HDU.

    Raises
    ------
    FrameError
        If the file cannot be read.
    """
    with translated(path), open_bytes(path) as handle:
        hdus, _ = read_hdus(path, handle, None, sound=True)
        arrays = [hdu for hdu in hdus if hdu.what.startswith("an array")]
        images = [NamedImage(a.number, a.name, _upwards(a), a.header) for a in arrays]
        return images, hdus[0].header


def read_image(path: Path) -> tuple[np.ndarray, Mapping[str, Any]]:
    """Read the first image of a file as one array, which need not be a frame: a kernel, say.

    Parameters
    ----------
    path : Path
        Plain, gzipped or tile-compressed.

    Returns
    -------
    image : (..., ny, nx) array
        float64, scaled; blank pixels are NaN; row index upwards.
    header : PlainHeader
        Of the same HDU.

    Raises
    ------
    FrameError
        If there is no image, or the file cannot be read.
    """
    with translated(path), open_bytes(path) as handle:
        image = find_images(path, handle, None)[0][0].image
        return _upwards(image), image.header


def _upwards(hdu: Hdu) -> np.ndarray:
    """All pixels of an HDU, row index upwards whatever its ROWORDER."""
    pixels = open_pixels(hdu).everything()
    return pixels[..., ::-1, :] if pixels.ndim > 1 and rows_from_the_top(Cards(hdu.header)) else pixels
