"""A vibration caught over a part of a cycle, or a few: between a drift and a streak of many cycles.

Nature makes it when a structure rings at about the frame rate (0.2 < f T < 3).  The image is lopsided: the
pointing lingers where it turns, at one end only.
"""

from __future__ import annotations

import math
from typing import ClassVar, Self

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jitterkit.conventions import axis_angle
from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.loci.base import Locus, principal_axes, turned
from jitterkit.loci.special import exact_to, gauss_legendre, greatest_speed, mean_phasor, sinc_of_square

_LEAST, _MOST = 0.05, 3.0
"""Cycles: below, the motion is a piece of a parabola to 1e-4 of its size; above, nearly harmonic."""

_START_CYCLES = 0.6
"""Where a fit starts: of 0.3 to 1.2, tried on 45 shapes, here and at 0.5 it settled each time."""

_NODES = 96
_MANY = 256
"""Points of the path at which the greatest speed is looked for."""

_BENT = 1.6
"""By which a path that turns round needs more nodes than a straight one as fast: at 3 cycles, the worst."""


class PartialShm(Locus):
    """``r(t) = (L/2) n [sin(2 pi a t + psi) - mean]``: ``a`` cycles, t from -1/2 to 1/2 of the exposure.

    Attributes
    ----------
    coords : (4,) array
        The rms of the pointing as a vector along its line (x, y, arcsec); the square of the cycles; and
        the share of the rms that is even in time about mid-exposure, signed: 0 at a phase of 0, 1 at 90
        degrees.

    Notes
    -----
    Everything is regular at a drift, where cycles and even share are zero.  The size is the rms actually
    travelled, not the amplitude, which has no end there.  Squared cycles may become negative in a fit, as
    a variance may: the motion then runs away from the middle (hyperbolic functions for circular ones).

    The even share stands for the phase: an image does not tell a motion from the same run backwards,
    phase from 180 - phase, so that in the phase there is a fold at 90 degrees, and no slope.  The odd part
    enters by its square; where the even share passes 1 in a fit, that square is negative.

    One symmetry remains: turning the vector by 180 degrees and changing the sign of the even share
    leaves everything as it is.  :meth:`describe` gives an axis in [0, 180) and a phase in [-90, 90].

    *Fails when* the noise hides the shape.  Half a cycle at phase 0 has the very density of a whole
    one, and between 0.5 and 1 there are two cycles to each kurtosis: rms and lopsidedness are determined
    long before the cycles are.

    The integral over time is Gauss and Legendre's, by itself with 96 nodes: at 3 cycles exact to 1e-13 while
    ``pi L |f| < 4`` (1.1 arcsec at TOLIMAN's cutoff) and to 1e-6 while it is below 9, at 1.4 cycles to
    1e-13 up to 16.
    """

    names: ClassVar[tuple[str, ...]] = ("partial_x", "partial_y", "partial_cycles2", "partial_even")
    nodes: int = eqx.field(static=True, default=_NODES)  # type: ignore[misc]

    @classmethod
    def of(cls, length: float, angle: float = 0.0, cycles: float = 1.0, phase: float = 0.0) -> Self:
        """Build from what the vibration is.

        Parameters
        ----------
        length : float
            Of the full oscillation, peak to peak, arcsec, whether or not the exposure sees all of it.
        angle : float
            Of its axis, degrees.
        cycles : float
            In one exposure, 0.05 to 3.
        phase : float
            At mid-exposure, degrees; zero where the motion is fastest.
        """
        if not length >= 0:
            problem = f"A streak's length must not be negative, in arcsec; got {length}."
            raise ConfigurationError(ErrorCode.OUT_OF_RANGE, problem)
        if not _LEAST <= cycles <= _MOST:
            problem = f"A partial vibration has {_LEAST:g} to {_MOST:g} cycles an exposure"
            found = f"got {cycles:g}; with fewer it is a linear streak, with more an shm"
            raise ConfigurationError(ErrorCode.OUT_OF_RANGE, f"{problem}, {found}.")
        odd, even = _amplitudes(cycles)
        psi, phi = math.radians(phase), math.radians(angle)
        rms = math.hypot(odd * math.cos(psi), even * math.sin(psi))
        size = 0.5 * length * rms
        return cls(
            jnp.asarray([size * math.cos(phi), size * math.sin(phi), cycles**2, even * math.sin(psi) / rms])
        )

    @classmethod
    def near(cls, moments) -> Self:
        major, _, angle = principal_axes(moments)
        return cls.of(2 * major / _amplitudes(_START_CYCLES)[0], angle, _START_CYCLES)

    def sampled(self, nodes: int) -> Self:
        return type(self)(self.coords, nodes)

    def transfer(self, fx, fy):
        t, weights = (jnp.asarray(part, self.coords.dtype) for part in gauss_legendre(self.nodes))
        square, share = self.coords[2:]
        odd, even = _halves(square, t)
        odd = odd / jnp.sqrt(odd**2 @ weights)
        even = even - even @ weights
        even = even / jnp.sqrt(even**2 @ weights)
        off_zero = 1j * jnp.finfo(share.dtype).eps  # for a finite derivative of the root at zero
        x, y = self.coords[:2, None] * (jnp.sqrt(1 - share**2 + off_zero) * odd + share * even)
        return mean_phasor(x, y, weights, fx, fy)

    def moments(self):
        x, y = self.coords[:2]
        return jnp.stack([x * x, x * y, y * y])

    def exact_to(self) -> float:
        return exact_to(_BENT * greatest_speed(self.points(_MANY)), self.nodes)

    def describe(self) -> dict[str, float]:
        """``length`` peak to peak [arcsec], ``angle`` [deg], ``cycles``, ``phase`` at mid-exposure [deg].

        Fewer than 0.05 cycles, or a negative square of them, are given as 0.05.
        """
        x, y, square, share = (float(c) for c in self.coords)
        cycles = math.sqrt(max(square, _LEAST**2))
        odd, even = _amplitudes(cycles)
        direction = math.degrees(math.atan2(y, x))
        angle = axis_angle(direction)
        across = share / even * (1 if abs(direction - angle) < 90 else -1)
        along = math.sqrt(max(1 - share**2, 0.0)) / odd
        return {
            "length": 2 * math.hypot(x, y) * math.hypot(along, across),
            "angle": angle,
            "cycles": cycles,
            "phase": math.degrees(math.atan2(across, along)),
        }

    def points(self, n: int) -> np.ndarray:
        size = self.describe()
        t = (np.arange(n) + 0.5) / n - 0.5
        along = np.sin(2 * np.pi * size["cycles"] * t + np.radians(size["phase"]))
        along = 0.5 * size["length"] * (along - along.mean())
        return turned(along, 0 * along, size["angle"])


def _halves(square, t):
    """Return the parts odd and even in time, per ``2 pi a`` and ``2 pi² a²``: finite at no cycles."""
    return t * sinc_of_square(4 * square * t**2), -(t**2) * sinc_of_square(square * t**2) ** 2


def _amplitudes(cycles: float) -> tuple[float, float]:
    """Return the rms of a unit sine and of a unit cosine about its mean."""
    one, two = np.sinc(2 * cycles), np.sinc(cycles)
    return math.sqrt((1 - one) / 2), math.sqrt((1 + one) / 2 - two**2)
