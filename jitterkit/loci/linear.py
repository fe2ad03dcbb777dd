"""A straight smear at constant speed: drift during the exposure, or slow motion of any kind.

Nature makes it when the pointing moves much slower than the exposure is long (f T below about 0.2):
over a small part of a cycle every motion is a straight line.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from jitterkit.loci.special import sinc_of_square
from jitterkit.loci.streak import Streak


class Linear(Streak):
    """A uniform streak of full ``length``: ``M = sinc(f.n L)``, variance ``L²/12`` along its axis."""

    names: ClassVar[tuple[str, ...]] = ("linear_c", "linear_s")
    cumulants: ClassVar[tuple[float, float] | None] = (-6 / 5, 48 / 7)
    variance: ClassVar[float] = 1 / 12

    def transfer(self, fx, fy):
        return sinc_of_square(self.along(fx, fy))

    def points(self, n: int) -> np.ndarray:
        return self._placed((np.arange(n) + 0.5) / n - 0.5)

    def trace(self, n: int, rng: np.random.Generator) -> np.ndarray:
        return self.points(n)
