"""A straight smear at constant speed: drift during the exposure, or slow motion of any kind.

Nature makes it when the pointing moves much slower than the exposure is long (f T below about 0.2):
over a small part of a cycle every motion is a straight line.
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
from jitterkit.loci.special import sinc_of_square

__all__ = ["Linear"]


class Linear(Locus):
    """A uniform streak of full ``length``: ``M = sinc(f.n L)``, variance ``L²/12`` along its axis."""

    names: ClassVar[tuple[str, ...]] = ("linear_c", "linear_s")

    @classmethod
    def of(cls, length: float, angle: float = 0.0) -> Self:
        """Build from the full length [arcsec] and the angle of its axis [deg]."""
        if not length >= 0:
            raise ValueError(f"A smear's length must not be negative, in arcsec; got {length}.")
        return cls(streak_coords(length, angle))

    @classmethod
    def near(cls, moments) -> Self:
        major, _, angle = principal_axes(moments)
        return cls.of(major * np.sqrt(12.0), angle)

    def transfer(self, fx, fy):
        return sinc_of_square(along_axis(self.coords, fx, fy))

    def moments(self):
        return streak_moments(self.coords, 1 / 12)

    def describe(self) -> dict[str, float]:
        """Full ``length`` [arcsec] and ``angle`` [deg]."""
        return streak_description(self.coords)

    def points(self, n: int) -> np.ndarray:
        size = self.describe()
        along = ((np.arange(n) + 0.5) / n - 0.5) * size["length"]
        angle = np.radians(size["angle"])
        return along[:, None] * np.array([np.cos(angle), np.sin(angle)])
