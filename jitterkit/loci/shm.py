"""Simple harmonic motion over many cycles: a mechanical vibration in one plane.

Nature makes it when a structure rings at a frequency well above the frame rate (f T above 2 or 3).
The image lingers at both ends of the streak; its density is the arcsine law.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from jitterkit.loci.base import whole_cycles
from jitterkit.loci.special import j0_of_square
from jitterkit.loci.streak import Streak


class Shm(Streak):
    """A sinusoid of peak-to-peak ``length`` 2A: ``M = J0(pi L f.n)``, variance ``L²/8`` along its axis."""

    names: ClassVar[tuple[str, ...]] = ("shm_c", "shm_s")
    cumulants: ClassVar[tuple[float, float] | None] = (-3 / 2, 10.0)
    variance: ClassVar[float] = 1 / 8

    def transfer(self, fx, fy):
        return j0_of_square(np.pi**2 * self.along(fx, fy))

    def points(self, n: int) -> np.ndarray:
        return self._placed(0.5 * np.cos(np.pi * (np.arange(n) + 0.5) / n))

    def trace(self, n: int, rng: np.random.Generator) -> np.ndarray:
        return self._placed(0.5 * np.cos(whole_cycles(n, rng)))
