"""A free path: a smooth curve through a few positions that the pointing passes at equal times.

Nature makes it when the pointing moves slowly but not straight: a settling slew, a slow loop, a drift with
a bend or a kick.  It is the locus that assumes least of a motion below the frame rate.
"""

from __future__ import annotations

import functools
from typing import Self

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.interpolate import CubicSpline

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.loci.base import Locus, principal_axes, turned
from jitterkit.loci.special import exact_to, gauss_legendre, greatest_speed, mean_phasor

_KNOTS = 4
_NODES = 16
_MANY = 256
"""Points of the path at which the greatest speed is looked for."""

_BEND = 0.1
"""Of the length, that a fit starts bent by at least: a straight line is its own mirror image."""

_PARABOLA = 4 / 45
"""Variance of a parabola over its span, in units of its height squared."""


def _names(knots: int) -> tuple[str, ...]:
    return tuple(f"path_{axis}{k}" for axis in "xy" for k in range(1, knots))


class Path(Locus):
    """A cubic spline through K knots, equally spaced over the exposure.

    Attributes
    ----------
    coords : (2 (K - 1),) array
        Steps from knot to knot, arcsec: first all in x, then all in y.  The mean offset is taken off, so
        that K - 1 steps are all there is to know.

    Notes
    -----
    With four knots or fewer the spline is the one polynomial through them (not-a-knot at both ends); with
    two, a straight line at constant speed.  Run backwards it leaves the same image, so an image gives the
    path but not its direction; a path that is its own reversal (there and back) is degenerate in a fit.

    The integral over time has by itself 16 nodes between two knots, exact to rounding while a step turns the
    phase by less than 8 rad at ``f`` (1.1 arcsec at TOLIMAN's cutoff).
    """

    coords: Float[Array, " k"]
    names: tuple[str, ...] = eqx.field(static=True, default=_names(_KNOTS))  # type: ignore[misc]
    nodes: int = eqx.field(static=True, default=_NODES)  # type: ignore[misc]

    def __init__(self, coords, nodes: int = _NODES) -> None:
        self.coords = jnp.asarray(coords, float)
        self.names = _names(len(self.coords) // 2 + 1)
        self.nodes = nodes

    def at(self, coords: Float[Array | np.ndarray, " k"]) -> Self:
        """Return a path with other steps, of which there may be more or fewer."""
        knots = len(coords) // 2 + 1
        path = self if knots == self.knots else type(self).of(np.zeros((knots, 2))).sampled(self.nodes)
        return eqx.tree_at(lambda one: one.coords, path, coords)

    def sampled(self, nodes: int) -> Self:
        return type(self)(self.coords, nodes)

    @classmethod
    def of(cls, knots) -> Self:
        """Build from the positions passed.

        Parameters
        ----------
        knots : (K, 2) array
            Offsets x and y in arcsec, at equal times from the start of the exposure to its end, K at
            least 2; their common offset does not matter.

        Raises
        ------
        ConfigurationError
            If there are fewer, or one is not finite.
        """
        knots = np.asarray(knots, float)
        _check(knots)
        return cls(np.diff(knots, axis=0).T.ravel())

    @classmethod
    def near(cls, moments) -> Self:
        """Return a straight line of the greater variance, bent to a parabola of the lesser."""
        major, minor, angle = principal_axes(moments)
        length, s = np.sqrt(12) * major, np.linspace(-0.5, 0.5, _KNOTS)
        height = max(minor / np.sqrt(_PARABOLA), _BEND * length)
        return cls.of(turned(length * s, height * (4 * s**2 - 1), angle))

    def transfer(self, fx, fy):
        x, y, weights = self._at_nodes()
        return mean_phasor(x, y, weights, fx, fy)

    def moments(self):
        x, y, weights = self._at_nodes()
        return jnp.stack([x * x, x * y, y * y]) @ weights

    def exact_to(self) -> float:
        return exact_to(greatest_speed(self.points(_MANY)) / (self.knots - 1), self.nodes)

    def describe(self) -> dict[str, float]:
        """Return ``x1``, ``y1``, ``x2``, ``y2``, ... of the knots, arcsec from the mean offset."""
        positions = self._at(np.linspace(-0.5, 0.5, self.knots))
        return {
            f"{axis}{k}": float(v)
            for k, xy in enumerate(positions, 1)
            for axis, v in zip("xy", xy, strict=True)
        }

    def points(self, n: int) -> np.ndarray:
        offsets = self._at((np.arange(n) + 0.5) / n - 0.5)
        return offsets - offsets.mean(axis=0)

    @property
    def knots(self) -> int:
        """Number of positions that the path passes."""
        return len(self.names) // 2 + 1

    def finer(self, knots: int) -> Self:
        """Return the path with as many knots at equal times; of four or fewer, more are the same curve."""
        times = np.linspace(-0.5, 0.5, knots)
        return type(self).of(self._at(times)).sampled(self.nodes)

    @staticmethod
    @functools.cache
    def variances(knots: int) -> np.ndarray:
        """Return the variances (knots - 1,) along an axis of independent combinations of steps of rms one."""
        matrix, weights = _quadrature(knots, _NODES)
        return np.linalg.eigvalsh(matrix.T @ (weights[:, None] * matrix))

    def _at_nodes(self):
        """Return the offsets x and y (n,) from the mean at the nodes in time, and their weights (n,)."""
        positions, weights = (
            jnp.asarray(part, self.coords.dtype) for part in _quadrature(self.knots, self.nodes)
        )
        x, y = self.coords.reshape(2, -1) @ positions.T
        return x, y, weights

    def _at(self, times: np.ndarray) -> np.ndarray:
        """Return the offsets (n, 2) from the mean at times from -1/2 to 1/2."""
        positions, weights = gauss_legendre(self.nodes, self.knots - 1)
        mean = weights @ _spline(self.knots, positions)
        return (_spline(self.knots, times) - mean) @ np.asarray(self.coords).reshape(2, -1).T


def _check(knots: np.ndarray) -> None:
    if knots.ndim != 2 or knots.shape[1] != 2:
        code = ErrorCode.WRONG_SHAPE
    elif len(knots) < 2:
        code = ErrorCode.TOO_FEW
    elif not np.all(np.isfinite(knots)):
        code = ErrorCode.OUT_OF_RANGE
    else:
        return
    problem = f"A path needs two knots or more, each a finite x and y in arcsec; got {knots.tolist()}."
    raise ConfigurationError(code, problem)


@functools.cache
def _quadrature(knots: int, nodes: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the matrix from steps to offsets from the mean at the nodes, and the nodes' weights (n,)."""
    times, weights = gauss_legendre(nodes, knots - 1)
    matrix = _spline(knots, times)
    return matrix - weights @ matrix, weights


def _spline(knots: int, times: np.ndarray) -> np.ndarray:
    """Return the matrix from steps to offsets from the first knot at given times."""
    return CubicSpline(np.linspace(-0.5, 0.5, knots), np.tri(knots, knots - 1, -1))(times)
