"""Any smooth blur with one number for its shape: a normal density with a free excess kurtosis.

Nature makes it negative by motion with turning points (a drift has -1.2, a vibration -1.5) and positive
by motion that is calm most of the time and strong in bursts.  It is the next thing that an image shows
after the second moments, whatever the path: a test of whether a normal will do.
"""

from __future__ import annotations

import math
from typing import ClassVar, Self

import jax
import jax.numpy as jnp
import numpy as np
from scipy.special import gammaincinv

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.loci.base import principal_axes
from jitterkit.loci.elliptic import Elliptic, covariance
from jitterkit.loci.special import elementwise, log1p_over

_RING = -1.5
"""Excess kurtosis of an elliptical ring along any axis, the least of an elliptical density in a plane."""

_NARROW = 1e-9
"""Of a kurtosis, or of a density's exponent: nothing differs from none by less."""

_FAR, _TERMS = {8: 60.0, 4: 20.0}, 104
"""Where the series in w is cut, in w by the bytes of a number, and in its powers: its terms cancel."""

_NEAR, _FEWER = 12.0, 40
"""Where most blurs end, and as good a cut up to there: ``(w/2)^n/n!`` is 2e-17."""

_UNROLLED = 8
"""Powers of w that are summed in one pass over the frequencies."""

_LEAST = -0.5
"""Of ``k w/6``, which an indefinite Σ makes negative: the variance-gamma law has a pole at -1."""

_SPOKES, _GOLDEN = 16, 0.6180339887498949
"""Points on a ring; and what turns one against the next, so that all directions are met."""


class Shaped(Elliptic):
    """Covariance Σ and excess kurtosis ``k``, the same along every axis.

    Notes
    -----
    With ``w = 4 pi² f'Σf``, for negative k ``M = 0F1(; b; -b w/2)`` with ``b = -(3 + k)/k``: Bessel's
    family, of the densities ``(1 - r/(nu + 1))^(nu - 1)`` in ``r = x'Σ⁻¹x/2``.  It holds others exactly: the
    normal at k = 0; along a line the uniform streak at -1.2; a uniform ellipse at -1; and the ellipse run
    round (along a line: shm) at -1.5, the least that an elliptical density can have.  A fit may go below.
    For positive k it is the variance-gamma law ``M = (1 + k w/6)^(-3/k)``.

    Exact to rounding up to w = 60 (a drift of 3.7 arcsec at TOLIMAN's cutoff), in 32 bits up to 20 to 1e-6
    for k above -2 and to 3e-5 at -3; beyond, it is let fall to zero where k is negative, and
    :meth:`exact_to` says from where on.
    """

    names: ClassVar[tuple[str, ...]] = ("shaped_xx", "shaped_xy", "shaped_yy", "shaped_kurtosis")

    @classmethod
    def of(
        cls, sigma_major: float, sigma_minor: float | None = None, angle: float = 0.0, kurtosis: float = 0.0
    ) -> Self:
        """Build from the 1 sigma sizes [arcsec], the angle of the major one [deg] and the excess kurtosis."""
        if not -2 <= kurtosis < np.inf:
            problem = f"No density has an excess kurtosis below -2; got {kurtosis}."
            raise ConfigurationError(ErrorCode.OUT_OF_RANGE, problem)
        moments = covariance(sigma_major, sigma_major if sigma_minor is None else sigma_minor, angle)
        return cls(jnp.append(moments, kurtosis))

    @classmethod
    def near(cls, moments) -> Self:
        return cls(np.append(np.asarray(moments, float), 0.0))

    def transfer(self, fx, fy):
        w, k = 4 * jnp.pi**2 * self.variance_along(fx, fy), self.coords[3]
        return jax.lax.cond(k > 0, _heavy, _light, w, k)  # both would take half as long again

    def exact_to(self) -> float:
        major, _, _ = principal_axes(self.coords[:3])
        if not self.coords[3] < 0 < major:
            return math.inf
        return math.sqrt(_FAR[jnp.zeros(()).dtype.itemsize]) / (2 * math.pi * major)

    def describe(self) -> dict[str, float]:
        """Return ``sigma_major``, ``sigma_minor`` [arcsec], ``angle`` [deg] and ``kurtosis``."""
        *moments, kurtosis = np.asarray(self.coords).tolist()
        major, minor, angle = principal_axes(moments)
        return {"sigma_major": major, "sigma_minor": minor, "angle": angle, "kurtosis": kurtosis}

    def points(self, n: int) -> np.ndarray:
        """Rings of sixteen points, each ring equally probable."""
        rings, spokes = max(2, n // _SPOKES), np.arange(_SPOKES)
        lattice = np.arange(rings) * _GOLDEN % 1.0
        half_square = self._half_square((np.arange(rings) + 0.5) / rings, lattice)
        phase = 2 * np.pi * (spokes + lattice[:, None]) / _SPOKES
        return self._on_rings(np.repeat(half_square / half_square.mean(), _SPOKES), phase.ravel())

    def trace(self, n: int, rng: np.random.Generator) -> np.ndarray:
        half_square = self._half_square(rng.uniform(size=n), rng.uniform(size=n))
        return self._on_rings(half_square, rng.uniform(0, 2 * np.pi, n))

    def _half_square(self, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return half the squared radius in sigmas, of mean one, from numbers uniform in [0, 1)."""
        kurtosis = max(float(self.coords[3]), _RING)
        if kurtosis < 0:
            nu = max(-3 / kurtosis - 2, _NARROW)
            return (nu + 1) * (1 - (1 - u) ** (1 / nu))
        normal = -np.log1p(-u)
        if kurtosis < _NARROW:
            return normal
        return normal * gammaincinv(3 / kurtosis, np.maximum(v, _NARROW)) * kurtosis / 3

    def _on_rings(self, half_square: np.ndarray, phase: np.ndarray) -> np.ndarray:
        radius = np.sqrt(2 * half_square)
        return self._placed(radius * np.cos(phase), radius * np.sin(phase))


def _heavy(w, k):
    return jnp.exp(-w / 2 * log1p_over(jnp.maximum(k * w / 6, _LEAST)))


def _light(w, k):
    return jnp.exp(-w / 2) * _lightened(w, k)


@elementwise
def _lightened(w, k):
    """Return ``exp(w/2) 0F1(; b; -b w/2)`` as a power series in w, ``b = -(3 + k)/k``: one at k = 0.

    Divided by the normal's transform it satisfies ``q w (S'' - S' + S/4) + S' = 0`` with ``q = 1/b``, whose
    series has no cancellation near the normal, and no pole at any negative k.
    """
    k, w = jnp.where(k > 0, 0.0, k), jnp.minimum(w, _FAR[w.dtype.itemsize])

    def grow(pair, n):  # a loop, because a hundred terms written out take half a minute to compile
        before, last = pair
        c = k * (before / 4 - n * last) / ((n + 1) * (3 + k - n * k))
        return (last, c), c

    first = jnp.ones_like(k), jnp.zeros_like(k)
    _, rest = jax.lax.scan(grow, first, jnp.arange(1.0, _TERMS - 1, dtype=k.dtype))
    rows = jnp.concatenate([jnp.stack(first), rest]).reshape(-1, _UNROLLED)
    few = jnp.max(jnp.abs(w)) < _NEAR
    wanted = ~few | (np.arange(len(rows)) < _FEWER // _UNROLLED)

    def add(total, part):
        row, counts = part
        return jax.lax.cond(counts, _continued, lambda total, *_: total, total, row, w), None

    return jax.lax.scan(add, jnp.zeros_like(k * w), (rows, wanted), reverse=True)[0]


def _continued(total, row, w):
    """Return a sum of higher powers of w, by Horner's rule, with the coefficients of the next lower ones."""
    for n in reversed(range(_UNROLLED)):
        total = total * w + row[n]
    return total
