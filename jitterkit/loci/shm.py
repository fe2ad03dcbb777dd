"""Simple harmonic motion over many cycles: a mechanical vibration in one plane.

Nature makes it when a structure rings at a frequency well above the frame rate (f T above 2 or 3).
The image lingers at both ends of the streak; its density is the arcsine law.
"""

from __future__ import annotations

from typing import ClassVar, Self

import numpy as np

from jitterkit.loci.base import (
    Locus,
    along_axis,
    principal_axes,
    streak_coords,
    streak_description,
    streak_moments,
)
from jitterkit.loci.special import j0_of_square

__all__ = ["Shm"]


class Shm(Locus):
    """A sinusoid of peak-to-peak ``length`` 2A: ``M = J0(pi L f.n)``, variance ``L²/8`` along its axis."""

    names: ClassVar[tuple[str, ...]] = ("shm_c", "shm_s")

    @classmethod
    def of(cls, length: float, angle: float = 0.0) -> Self:
        """Build from the peak-to-peak length [arcsec] and the angle of its axis [deg]."""
        if not length >= 0:
            raise ValueError(f"A peak-to-peak length must not be negative, in arcsec; got {length}.")
        return cls(streak_coords(length, angle))

    @classmethod
    def near(cls, moments) -> Self:
        major, _, angle = principal_axes(moments)
        return cls.of(major * np.sqrt(8.0), angle)

    def transfer(self, fx, fy):
        return j0_of_square(np.pi**2 * along_axis(self.coords, fx, fy))

    def moments(self):
        return streak_moments(self.coords, 1 / 8)

    def describe(self) -> dict[str, float]:
        """Peak-to-peak ``length`` [arcsec] and ``angle`` [deg]."""
        return streak_description(self.coords)

    def points(self, n: int) -> np.ndarray:
        size = self.describe()
        along = 0.5 * size["length"] * np.cos(np.pi * (np.arange(n) + 0.5) / n)
        angle = np.radians(size["angle"])
        return along[:, None] * np.array([np.cos(angle), np.sin(angle)])
