"""A locus whose higher cumulants are not quite its own: to ask an image whether it wants others.

The transfer function is multiplied by ``exp(sum kappa_n (-2 pi i f)^n / n!)``, n = 3, 4 and, on request, 6.
"""

from __future__ import annotations

import functools
import math
from typing import Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.loci.base import Locus


def cumulant_names(order: int) -> tuple[str, ...]:
    """Return the names of the cumulants of one order n: those of ``x^n, x^(n-1) y, ..., y^n``."""
    return tuple(f"cumulant{order}{k}" for k in range(order + 1))


CUMULANTS = (*cumulant_names(3), *cumulant_names(4))
"""``xxx, xxy, xyy, yyy, xxxx, ...``"""


def form_cumulants(moments, power: int) -> tuple[np.ndarray, np.ndarray]:
    """Cumulants (2 p + 1,) of order 2 p that are the power p of a form, and their slope (2 p + 1, 3).

    Of a blur whose transfer function depends on ``f'Sf`` alone they are this by a number: the excess
    kurtosis for p = 2.

    Parameters
    ----------
    moments : (3,) array
        Of the form, ``(Sxx, Sxy, Syy)``.
    power : int
    """
    sxx, sxy, syy = np.asarray(moments, float)
    form = np.array([sxx, 2 * sxy, syy])
    lower = functools.reduce(np.convolve, [form] * (power - 1), np.ones(1))
    ways = np.array([math.comb(2 * power, k) for k in range(2 * power + 1)])
    turns = np.array([[1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 1.0]])
    slope = np.stack([power * np.convolve(lower, turn) for turn in turns], axis=1)
    return np.convolve(lower, form) / ways, slope / ways[:, None]


def cumulant_exponent(order: int, cumulants, fx, fy):
    """Return the logarithm of a transfer function by cumulants ``x^n, x^(n-1) y, ...`` of one order."""
    x, y = 2 * jnp.pi * fx, 2 * jnp.pi * fy
    form = sum(math.comb(order, k) * cumulants[k] * x ** (order - k) * y**k for k in range(order + 1))
    return (1, -1j, -1, 1j)[order % 4] / math.factorial(order) * form


class WithCumulants(Locus):
    """A locus whose cumulants of some orders are off by its last coordinates.

    To first order in them: it need not be a density, so only what a scoring step asks for differs
    from the locus itself.
    """

    coords: Float[Array, " k"]
    locus: Locus
    orders: tuple[int, ...] = eqx.field(static=True)

    def __init__(self, locus: Locus, orders: tuple[int, ...] = (3, 4), cumulants=None) -> None:
        own = np.zeros(sum(orders) + len(orders)) if cumulants is None else jnp.asarray(cumulants)
        traced = isinstance(locus.coords, jax.Array)
        self.coords = (jnp if traced else np).concatenate([locus.coords, own])
        self.locus, self.orders = locus, orders

    @property
    def names(self) -> tuple[str, ...]:  # type: ignore[override]
        """Return the names of the locus, then those of the cumulants."""
        return (*self.locus.names, *self._own)

    @property
    def _own(self) -> tuple[str, ...]:
        return tuple(name for order in self.orders for name in cumulant_names(order))

    @property
    def inner(self) -> Locus:
        """Return the locus at its present size."""
        return self.locus.at(self.coords[: -len(self._own)])

    @classmethod
    def near(cls, moments) -> Self:
        problem = "Cumulants do not follow from second moments; put them on a locus."
        raise ConfigurationError(ErrorCode.UNSUPPORTED, problem)

    def transfer(self, fx, fy):
        exponent, left = 0.0, self.coords[-len(self._own) :]
        for order in self.orders:
            exponent = exponent + cumulant_exponent(order, left[: order + 1], fx, fy)
            left = left[order + 1 :]
        return self.inner.transfer(fx, fy) * jnp.exp(exponent)

    def moments(self):
        return self.inner.moments()

    def describe(self) -> dict[str, float]:
        cumulants = map(float, self.coords[-len(self._own) :])
        return self.inner.describe() | dict(zip(self._own, cumulants, strict=True))

    def points(self, n: int) -> np.ndarray:
        return self.inner.points(n)

    def trace(self, n: int, rng: np.random.Generator) -> np.ndarray:
        return self.inner.trace(n, rng)
