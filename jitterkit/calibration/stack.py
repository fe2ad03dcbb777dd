"""A stack: frames of one kind and one exposure time, on disk or in memory.

Reach for :func:`~jitterkit.calibration.stack_files.open_stacks` for files, and for :meth:`Stack.of` for
arrays.  :meth:`Stack.bands` gives the pixels of all frames, so many rows at a time that they fit into the
memory allowed: a file is read once for each band.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from hashlib import sha256
from itertools import groupby
from pathlib import Path
from typing import Any, Self

import numpy as np

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.frames import open_frames

_SAMPLES = 65536
"""Pixels, about, from which the level of a frame is read: good to a thousandth of its noise."""

_OUTLYING, _LEAST_SCATTER = 5.0, 0.5
"""Scatters from the median beyond which a pixel does not count for the level, and the least scatter, ADU,
that whole numbers show."""

ROUNDING = 1 / 12
"""Variance of a converter to whole numbers [ADU²]: of a uniform law of width one.  It holds to 10 % of itself
at a noise of 0.5 ADU and to 40 % at 0.4, and better over pixels whose levels differ by a fraction of one."""

_PILED = 0.02
"""Share of the pixels at one and the same largest value from which a frame is saturated, or cut at zero; a
normal of one ADU has 0.02 % there."""


@dataclass(frozen=True)
class Shot:
    """One frame of a stack, before its pixels are read again.

    Parameters
    ----------
    name : str
        ``"flat.fits"``, or ``"flats.fits[3]"``.
    level, scatter : float
        Mean of its pixels without outliers, and 1.4826 times their median deviation [ADU].
    piled : float
        Share of its pixels at its largest value.
    floored : float
        Share of its pixels that are zero, if none is negative.
    exposure, gain : float, optional
        As its header says [s], [e-/ADU].
    whole : bool
        Whether its pixels are whole numbers.
    path : Path, optional
    index : int
        Place in its file.
    digest : str
        Of the pixels from which the level was read; empty where they are all alike.
    warnings : tuple of str
        Of its file.
    settings : mapping
        Cards of its header on the camera: its settings, temperature and filter, those that it has.
    """

    name: str
    level: float
    scatter: float
    piled: float = 0.0
    floored: float = 0.0
    exposure: float | None = None
    gain: float | None = None
    whole: bool = True
    path: Path | None = None
    index: int = 0
    digest: str = ""
    warnings: tuple[str, ...] = ()
    settings: Mapping[str, str] = field(default_factory=dict)

    @property
    def saturated(self) -> bool:
        """Return whether its pixels pile up at one value, the largest."""
        return self.piled > _PILED

    @property
    def clipped(self) -> bool:
        """Return whether its pixels pile up at zero."""
        return self.floored > _PILED


@dataclass(frozen=True, eq=False)
class Stack:
    """Frames of one kind and one exposure.

    Parameters
    ----------
    kind : {"bias", "dark", "flat"}
    shots : tuple of Shot
    shape : (int, int)
    dtype : numpy.dtype
        In which the pixels are held.
    exposure : float, optional
        Of each frame [s].
    unusable : (ny, nx) bool array
        True where a pixel is blank or not finite in any of the frames.
    pixels : (n, ny, nx) array, optional
        Of a stack in memory.
    """

    kind: str
    shots: tuple[Shot, ...]
    shape: tuple[int, int]
    dtype: np.dtype
    exposure: float | None
    unusable: np.ndarray
    pixels: np.ndarray | None = None

    @classmethod
    def of(cls, kind: str, pixels: Any, exposure: float | None = None) -> Self:
        """Make a stack of an array ``(n, ny, nx)`` [ADU].

        Raises
        ------
        ConfigurationError
            If it is not three-dimensional.
        """
        array = np.asarray(pixels)
        if array.ndim != 3 or 0 in array.shape:
            problem = f"the {kind} frames have shape {array.shape}; give one array (n, ny, nx)."
            raise ConfigurationError(ErrorCode.WRONG_SHAPE, problem)
        blank = ~np.isfinite(array).all(axis=0)
        array = np.where(blank, 0.0, array) if blank.any() else array
        shots = tuple(look(f"{kind}[{i}]", plane, exposure) for i, plane in enumerate(array))
        return cls(kind, shots, array.shape[1:], array.dtype, exposure, blank, array)

    def __len__(self) -> int:
        return len(self.shots)

    @property
    def level(self) -> float:
        """Return the median of the levels of the frames [ADU]."""
        return float(np.median([shot.level for shot in self.shots]))

    @property
    def rounding(self) -> float:
        """Variance that the converter adds by rounding to whole numbers [ADU²]; none where they are not."""
        return ROUNDING if all(shot.whole for shot in self.shots) else 0.0

    @property
    def name(self) -> str:
        """Return ``"flat, 0.5 s"``."""
        return self.kind if self.exposure is None else f"{self.kind}, {self.exposure:g} s"

    def take(self, indices: Iterable[int]) -> Self:
        """Return the stack of some of the frames."""
        chosen = list(indices)
        pixels = None if self.pixels is None else self.pixels[chosen]
        return replace(self, shots=tuple(self.shots[i] for i in chosen), pixels=pixels)

    def bands(self, memory: float, multiple: int) -> Iterator[tuple[int, np.ndarray]]:
        """Give all frames a band of rows at a time.

        Parameters
        ----------
        memory : float
            Bytes that a band may take.
        multiple : int
            Of which the number of rows in a band is a multiple, one at least.

        Yields
        ------
        first : int
            Row at which the band begins.
        pixels : (n, rows, nx) array
        """
        ny, nx = self.shape
        rows = int(memory // (len(self) * nx * self.dtype.itemsize)) // multiple * multiple
        rows = max(rows, multiple)
        for first in range(0, ny, rows):
            last = min(first + rows, ny)
            yield first, self._read(first, last) if self.pixels is None else self.pixels[:, first:last]

    def _read(self, first: int, last: int) -> np.ndarray:
        band = np.empty((len(self), last - first, self.shape[1]), self.dtype)
        numbered = enumerate(self.shots)
        for path, members in groupby(numbered, key=lambda member: member[1].path):
            with open_frames(Path(str(path))) as file:
                for index, shot in members:
                    band[index] = file[shot.index].data[first:last]
        return band


def look(name: str, data: np.ndarray, exposure: float | None) -> Shot:
    """Look at a frame: its level, and how its pixels lie about it."""
    step = max(1, int((data.size / _SAMPLES) ** 0.5))
    sample = np.asarray(data[step // 2 :: step, step // 2 :: step], dtype=float)
    middle = float(np.median(sample))
    scatter = max(1.4826 * float(np.median(np.abs(sample - middle))), _LEAST_SCATTER)
    level = float(np.mean(sample[np.abs(sample - middle) <= _OUTLYING * scatter]))
    whole = bool(np.all(sample == np.rint(sample)))
    piled = float(np.mean(sample == sample.max()))
    digest = sha256(sample.tobytes()).hexdigest() if np.ptp(sample) else ""
    floored = float(np.mean(sample == 0)) if sample.min() == 0 else 0.0
    return Shot(name, level, scatter, piled, floored, exposure, whole=whole, digest=digest)
