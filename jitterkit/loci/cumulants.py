"""A locus whose higher cumulants are not quite its own: to ask an image whether it wants others.

The transfer function is multiplied by ``exp(sum kappa_n (-2 pi i f)^n / n!)``, n = 3, 4 and, on request, 6.
"""

from __future__ import annotations

import functools
import math
from typing import ClassVar, Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.loci.base import Locus, principal_axes
from jitterkit.loci.elliptic import Elliptic, covariance, normal_grid
from jitterkit.precision import real


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


_COMPONENTS = ("xxx", "xxy", "xyy", "yyy")


class Skewed(Elliptic):
    """Covariance Σ and third cumulants: ``M = exp(-2 pi² f'Σf + 4 pi³ i/3 sum κ_jkl f_j f_k f_l)``.

    Notes
    -----
    Exact to third order in frequency for any motion.  It is a density to first order in the skewness only,
    which is enough below one.  Skewness and position are distinguished by fine detail of the
    image: errors of x and y are about twice those of other loci, while the separation's stays.

    Nature makes it by speed or light that changes along a path, by a vibration that decays, and by a jump
    that is not in the middle of the exposure.  It is what an image shows next after the second moments where
    a path has no symmetry.
    """

    names: ClassVar[tuple[str, ...]] = (
        *(f"skewed_{component}" for component in ("xx", "xy", "yy")),
        *(f"skewed_{component}" for component in _COMPONENTS),
    )

    @classmethod
    def of(
        cls,
        sigma_major: float,
        sigma_minor: float | None = None,
        angle: float = 0.0,
        cumulant_xxx: float = 0.0,
        cumulant_xxy: float = 0.0,
        cumulant_xyy: float = 0.0,
        cumulant_yyy: float = 0.0,
    ) -> Self:
        """Build from 1 sigma sizes [arcsec], the angle of the major one [deg] and cumulants [arcsec³]."""
        moments = covariance(sigma_major, sigma_major if sigma_minor is None else sigma_minor, angle)
        third = [cumulant_xxx, cumulant_xxy, cumulant_xyy, cumulant_yyy]
        return cls(jnp.concatenate([moments, jnp.asarray(third, float)]))

    @classmethod
    def near(cls, moments) -> Self:
        return cls(real(np.append(np.asarray(moments, float), np.zeros(4))))

    def transfer(self, fx, fy):
        third = cumulant_exponent(3, self.coords[3:], fx, fy)
        return jnp.exp(third - 2 * jnp.pi**2 * self.variance_along(fx, fy))

    def describe(self) -> dict[str, float]:
        """``sigma_major``, ``sigma_minor`` [arcsec], ``angle`` [deg], ``cumulant_xxx`` ... [arcsec³]."""
        moments, third = np.asarray(self.coords)[:3], np.asarray(self.coords)[3:].tolist()
        major, minor, angle = principal_axes(moments)
        sizes = {"sigma_major": major, "sigma_minor": minor, "angle": angle}
        cumulants = zip((f"cumulant_{component}" for component in _COMPONENTS), third, strict=True)
        return sizes | dict(cumulants)

    def points(self, n: int) -> np.ndarray:
        return self._bent(*normal_grid(n))

    def trace(self, n: int, rng: np.random.Generator) -> np.ndarray:
        return self._bent(rng.standard_normal(n), rng.standard_normal(n))

    def _bent(self, along: np.ndarray, across: np.ndarray) -> np.ndarray:
        """Offsets (n, 2) of normal numbers, with the second moments and, to first order, the third cumulants.

        The place grows by a sixth of what the cumulants and the second-order polynomials of the numbers make.
        """
        positions = self._placed(along, across)
        axes = self._placed(np.array([1.0, 0.0]), np.array([0.0, 1.0]))  # the principal axes, 1 sigma long
        k = np.asarray(self.coords)[3:]
        tensor = np.array([[[k[0], k[1]], [k[1], k[2]]], [[k[1], k[2]], [k[2], k[3]]]])
        inverse = np.linalg.pinv(axes)
        numbers = np.stack([along, across], axis=1)
        quadratic = numbers[:, :, None] * numbers[:, None, :] - np.eye(2)
        seen = np.einsum("ijk,ja,kb->iab", tensor, inverse, inverse)
        bent = positions + np.einsum("nab,iab->ni", quadratic, seen) / 6
        bent -= bent.mean(axis=0)
        wanted, had = (np.linalg.cholesky(_regular(m)) for m in (axes.T @ axes, np.cov(bent.T, bias=True)))
        return bent @ np.linalg.inv(had).T @ wanted.T


def _regular(moments: np.ndarray) -> np.ndarray:
    """Return the second moments (2, 2) without a vanishing axis."""
    return moments + np.finfo(float).eps * max(np.trace(moments), np.finfo(float).tiny) * np.eye(2)
