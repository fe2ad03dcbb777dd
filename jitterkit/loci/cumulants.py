"""A locus whose third and fourth cumulants are not quite its own: to ask an image whether it wants others.

The transfer function is multiplied by ``exp(sum kappa_n (-2 pi i f)^n / n!)``, n = 3 and 4.
"""

from __future__ import annotations

from typing import Self

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.loci.base import Locus

__all__ = ["CUMULANTS", "WithCumulants", "fourth_cumulants"]

CUMULANTS = tuple(f"cumulant{n}{k}" for n in (3, 4) for k in range(n + 1))
"""``xxx, xxy, xyy, yyy, xxxx, ...``"""


def fourth_cumulants(moments) -> np.ndarray:
    """Fourth cumulants (5,) of a blur with second moments (3,) and an excess kurtosis of one."""
    sxx, sxy, syy = np.asarray(moments, float)
    return np.array([sxx**2, sxx * sxy, (sxx * syy + 2 * sxy**2) / 3, sxy * syy, syy**2])


class WithCumulants(Locus):
    """A locus whose third and fourth cumulants are off by the last nine coordinates.

    To first order in them: it need not be a density, so only what a scoring step asks for differs
    from the locus itself.
    """

    coords: Float[Array, " k"]
    locus: Locus

    def __init__(self, locus: Locus, cumulants=None) -> None:
        own = jnp.zeros(len(CUMULANTS)) if cumulants is None else jnp.asarray(cumulants)
        self.coords = jnp.concatenate([locus.coords, own])
        self.locus = locus

    @property
    def names(self) -> tuple[str, ...]:  # type: ignore[override]
        """Those of the locus, then the cumulants'."""
        return (*self.locus.names, *CUMULANTS)

    @property
    def inner(self) -> Locus:
        """The locus at its present size."""
        return self.locus.at(self.coords[: -len(CUMULANTS)])

    @classmethod
    def near(cls, moments) -> Self:
        raise ConfigurationError(
            ErrorCode.UNSUPPORTED, "Cumulants do not follow from second moments; put them on a locus."
        )

    def transfer(self, fx, fy):
        x, y, c = 2 * jnp.pi * fx, 2 * jnp.pi * fy, self.coords[-len(CUMULANTS) :]
        odd = c[0] * x**3 + 3 * c[1] * x**2 * y + 3 * c[2] * x * y**2 + c[3] * y**3
        even = c[4] * x**4 + 4 * c[5] * x**3 * y + 6 * c[6] * x**2 * y**2 + 4 * c[7] * x * y**3 + c[8] * y**4
        return self.inner.transfer(fx, fy) * jnp.exp(1j * odd / 6 + even / 24)

    def moments(self):
        return self.inner.moments()

    def describe(self) -> dict[str, float]:
        cumulants = map(float, self.coords[-len(CUMULANTS) :])
        return self.inner.describe() | dict(zip(CUMULANTS, cumulants, strict=True))

    def points(self, n: int) -> np.ndarray:
        return self.inner.points(n)

    def trace(self, n: int, rng: np.random.Generator) -> np.ndarray:
        return self.inner.trace(n, rng)
