"""The straight loci: a size and an axis, in coordinates of the double angle.

``(L² cos 2phi, L² sin 2phi)`` has no direction to lose at zero length, unlike ``(length, angle)``. It is not
smooth there all the same: the moments of a streak lie on a cone, of which zero length is the boundary.
Derivatives at zero length are finite (those of the cone's axis), but a fit that ends there has a kink and no
slope; the normal locus, whose moments are free, has neither.
"""

from __future__ import annotations

from typing import ClassVar, Self

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jitterkit.conventions import axis_angle
from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.loci.base import OfVariance, principal_axes, turned, whole_cycles
from jitterkit.loci.special import harmonic_transfer, uniform_transfer


def straight_moments(cosine, sine, variance) -> Float[Array, "3"]:
    """Return the second moments ``(Sxx, Sxy, Syy)`` of a straight locus, arcsec².

    Their derivatives are zero (not NaN) at zero length.

    Parameters
    ----------
    cosine, sine : float
        Its coordinates, arcsec².
    variance : float
        Along the line, in units of the length squared.
    """
    square = cosine**2 + sine**2
    positive = square > 0
    size = jnp.where(positive, jnp.sqrt(jnp.where(positive, square, 1.0)), 0.0)
    return 0.5 * variance * jnp.stack([size + cosine, sine, size - cosine])


class Streak(OfVariance):
    """A locus along a straight line.

    Attributes
    ----------
    variance : float
        Along the line, in units of the length squared (class attribute).
    """

    variance: ClassVar[float]

    @classmethod
    def of(cls, length: float, angle: float = 0.0) -> Self:
        """Build from the length [arcsec], full or peak to peak, and the angle of the axis [deg]."""
        if not length >= 0:
            problem = f"A streak's length must not be negative, in arcsec; got {length}."
            raise ConfigurationError(ErrorCode.OUT_OF_RANGE, problem)
        twice = np.radians(2 * angle)
        return cls(np.array([length**2 * np.cos(twice), length**2 * np.sin(twice)]))

    @classmethod
    def near(cls, moments) -> Self:
        major, _, angle = principal_axes(moments)
        return cls.of(major / np.sqrt(cls.variance), angle)

    def moments(self):
        cosine, sine = self.coords
        return straight_moments(cosine, sine, self.variance)

    def describe(self) -> dict[str, float]:
        """Return ``length`` [arcsec], full or peak to peak, and ``angle`` [deg]."""
        cosine, sine = (float(q) for q in self.coords)
        angle = axis_angle(np.degrees(np.arctan2(sine, cosine)) / 2)
        return {"length": float(np.sqrt(np.hypot(cosine, sine))), "angle": angle}

    def _placed(self, along: np.ndarray) -> np.ndarray:
        """Return the offsets (n, 2) of positions along the line, given in lengths from its middle."""
        size = self.describe()
        return turned(size["length"] * along, 0 * along, size["angle"])


class Linear(Streak):
    """A uniform streak of full ``length``: ``M = sinc(f.n L)``, variance ``L²/12`` along its axis.

    Nature makes it when the pointing moves much slower than the exposure is long (f T below about 0.2):
    over a small part of a cycle every motion is a straight line.
    """

    names: ClassVar[tuple[str, ...]] = ("linear_c", "linear_s")
    cumulants: ClassVar[tuple[float, float] | None] = (-6 / 5, 48 / 7)
    variance: ClassVar[float] = 1 / 12
    profile = staticmethod(uniform_transfer)

    def points(self, n: int) -> np.ndarray:
        return self._placed((np.arange(n) + 0.5) / n - 0.5)


class Shm(Streak):
    """A sinusoid of peak-to-peak ``length`` 2A: ``M = J0(pi L f.n)``, variance ``L²/8`` along its axis.

    Nature makes it when a structure rings at a frequency well above the frame rate (f T above 2 or 3).
    The image lingers at both ends of the streak; its density is the arcsine law.
    """

    names: ClassVar[tuple[str, ...]] = ("shm_c", "shm_s")
    cumulants: ClassVar[tuple[float, float] | None] = (-3 / 2, 10.0)
    variance: ClassVar[float] = 1 / 8
    profile = staticmethod(harmonic_transfer)

    def points(self, n: int) -> np.ndarray:
        return self._placed(0.5 * np.cos(np.pi * (np.arange(n) + 0.5) / n))

    def trace(self, n: int, rng: np.random.Generator) -> np.ndarray:
        return self._placed(0.5 * np.cos(whole_cycles(n, rng)))
