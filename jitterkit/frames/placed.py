"""Pixels with a position: the common base of the two records of an image, and the checks of arrays."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path
from typing import Any, Self

import numpy as np

from jitterkit.errors import ErrorCode, JitterkitError

#: Stands for a mask without a bad pixel; the records spread it over the image.
NONE_MASKED: np.ndarray = np.zeros((), dtype=bool)


class Placed:
    """Name, shape and cutting of both records."""

    path: Path | None
    index: int
    several: bool
    origin: tuple[int, int]
    mask: np.ndarray

    @property
    def name(self) -> str:
        """``"file.fits"``, or ``"cube.fits[3]"`` for one frame of several."""
        stem = "array" if self.path is None else self.path.name
        return f"{stem}[{self.index}]" if self.several else stem

    @property
    def shape(self) -> tuple[int, int]:
        """``(ny, nx)``."""
        ny, nx = self.mask.shape
        return ny, nx

    def region(self, x0: int, y0: int, nx: int, ny: int) -> Self:
        """Cut out a rectangle.

        Parameters
        ----------
        x0, y0 : int
            First column and row, 0-based in *this* frame.
        nx, ny : int
            Columns and rows.

        Returns
        -------
        region : same type
            A copy of the pixels; ``origin`` is advanced by ``(x0, y0)``.

        Raises
        ------
        JitterkitError
            If the rectangle is empty or does not lie inside the frame.
        """
        height, width = self.shape
        if min(nx, ny) < 1 or x0 < 0 or y0 < 0 or x0 + nx > width or y0 + ny > height:
            problem = f"the region x {x0} to {x0 + nx - 1}, y {y0} to {y0 + ny - 1} does not lie inside"
            frame = f"a frame of {width} x {height} pixels"
            raise JitterkitError(ErrorCode.OUT_OF_RANGE, f"{problem} {frame}; choose one that does.")
        cut = (slice(y0, y0 + ny), slice(x0, x0 + nx))
        arrays = {k: array[cut].copy() for k, array in vars(self).items() if isinstance(array, np.ndarray)}
        origin = (self.origin[0] + x0, self.origin[1] + y0)
        return replace(self, **arrays, origin=origin)  # type: ignore[type-var]

    def with_fields(self, **facts: Any) -> Self:
        """Return the same pixels with some fields replaced; their checks and their digest stay.

        Parameters
        ----------
        **facts
            By field.

        Raises
        ------
        TypeError
            If one is no field, or holds pixels.
        """
        pixels = {name for name, value in vars(self).items() if isinstance(value, np.ndarray)}
        known = {one.name for one in fields(self)} - pixels  # type: ignore[arg-type]
        if odd := sorted(facts.keys() - known):
            kind = type(self).__name__
            raise TypeError(f"{odd[0]!r} is not a field that can be replaced in a {kind}.")
        other = object.__new__(type(self))
        vars(other).update(vars(self), **facts)
        return other


def image_of(name: str, values: Any) -> np.ndarray:
    """Values as a two-dimensional array of float64, or JitterkitError under their name."""
    array = np.ascontiguousarray(values, dtype=np.float64)
    if array.ndim != 2 or 0 in array.shape:
        problem = f"{name} has shape {np.shape(values)}; a frame is two-dimensional, (ny, nx)."
        raise JitterkitError(ErrorCode.WRONG_SHAPE, problem)
    return array


def matching(name: str, values: Any, shape: tuple[int, ...], dtype: type) -> np.ndarray:
    """Values as an array of an image's shape, a number spread over it, or JitterkitError under their name."""
    spread = np.full(shape, values) if np.ndim(values) == 0 else values
    array: np.ndarray = np.ascontiguousarray(spread, dtype=dtype)
    if array.shape != shape:
        problem = f"{name} has shape {array.shape}, the image {shape}; give one value per pixel."
        raise JitterkitError(ErrorCode.WRONG_SHAPE, problem)
    return array
