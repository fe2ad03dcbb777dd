"""Motion at one frequency in two axes, over many cycles: the pointing runs round an ellipse.

Nature makes it when a structure rings at one frequency well above the frame rate and both axes follow,
each with its own amplitude and phase: a wheel's imbalance, a whirling shaft, a cooler.
"""

from __future__ import annotations

import math
from typing import ClassVar, Self

import numpy as np

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.loci.base import principal_axes, whole_cycles
from jitterkit.loci.elliptic import Elliptic, covariance
from jitterkit.loci.special import j0_of_square


class Ellipse(Elliptic):
    """An ellipse run round in simple harmonic motion: ``M = J0(sqrt(8 pi² f'Σf))``.

    Semi-axes ``a`` and ``b`` have variances ``a²/2`` and ``b²/2`` along them.  With ``b = 0`` it is a
    vibration in one plane, with ``a = b`` a circle.  Which way round, an image does not tell.
    """

    names: ClassVar[tuple[str, ...]] = ("ellipse_xx", "ellipse_xy", "ellipse_yy")
    cumulants: ClassVar[tuple[float, float] | None] = (-3 / 2, 10.0)

    @classmethod
    def of(cls, semi_major: float, semi_minor: float, angle: float = 0.0) -> Self:
        """Build from the semi-axes [arcsec] and the angle of the major one [deg]."""
        if not (semi_major >= 0 and semi_minor >= 0):
            problem = f"Semi-axes must not be negative, in arcsec; got {semi_major} and {semi_minor}."
            raise ConfigurationError(ErrorCode.OUT_OF_RANGE, problem)
        return cls(covariance(semi_major / np.sqrt(2), semi_minor / np.sqrt(2), angle))

    def transfer(self, fx, fy):
        return j0_of_square(8 * np.pi**2 * self.variance_along(fx, fy))

    def describe(self) -> dict[str, float]:
        """Return ``semi_major``, ``semi_minor`` [arcsec] and ``angle`` of the major axis [deg]."""
        major, minor, angle = principal_axes(self.coords)
        return {"semi_major": math.sqrt(2) * major, "semi_minor": math.sqrt(2) * minor, "angle": angle}

    def points(self, n: int) -> np.ndarray:
        return self._at_phase(2 * np.pi * (np.arange(n) + 0.5) / n)

    def trace(self, n: int, rng: np.random.Generator) -> np.ndarray:
        return self._at_phase(whole_cycles(n, rng))

    def _at_phase(self, phase: np.ndarray) -> np.ndarray:
        return self._placed(np.sqrt(2) * np.cos(phase), np.sqrt(2) * np.sin(phase))
