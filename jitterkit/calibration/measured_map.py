"""A map of a detector with its error, and whether it serves better than one number for all pixels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

_MANY = 10_000
"""Frames that nobody takes."""


@dataclass(frozen=True, eq=False)
class MeasuredMap:
    """A map with its error.

    Parameters
    ----------
    name : str
        As the detector calls it: ``"bias"``, ``"read_noise"``, ``"dark_current"``, ``"flat"``.
    unit : str
    values : (ny, nx) array
    error : float
        Standard error of a typical pixel.
    number, number_error : float
        That of all good pixels, and its standard error.
    spread : float
        Standard deviation over the good pixels.
    frames : int
        How many frames it was made of.
    """

    name: str
    unit: str
    values: np.ndarray
    error: float
    number: float
    number_error: float
    spread: float
    frames: int

    @property
    def true_spread(self) -> float:
        """Return the spread less what the errors make of it; zero where they make all of it."""
        return max(self.spread**2 - self.error**2, 0.0) ** 0.5

    @property
    def serves(self) -> bool:
        """Return whether pixels differ by more than the map's error: else a number is nearer to the truth."""
        return self.true_spread > self.error

    def sentence(self) -> str:
        """Say whether the frames were enough."""
        unit = f" {self.unit}" if self.unit else ""
        ratio = f"pixels differ by {self.true_spread:.3g}{unit}, a pixel is known to {self.error:.3g}{unit}"
        conclusion = "the map serves" if self.serves else "one number serves better than the map"
        more = ""
        if 0 < self.true_spread <= self.error:
            wanted = int(np.ceil(self.frames * (self.error / self.true_spread) ** 2 * 2))
            more = f", until there are some {wanted} frames" if wanted < _MANY else ""
        return f"{self.name.replace('_', ' ')} of {self.frames} frames: {ratio}; {conclusion}{more}."
