"""No jitter."""

from __future__ import annotations

from typing import ClassVar, Self

import jax.numpy as jnp
import numpy as np

from jitterkit.loci.base import Locus


class Stable(Locus):
    """A telescope that stands still: ``M = 1``."""

    names: ClassVar[tuple[str, ...]] = ()

    @classmethod
    def of(cls) -> Self:
        """Return the only one there is."""
        return cls(jnp.zeros(0))

    @classmethod
    def near(cls, moments) -> Self:
        return cls.of()

    def transfer(self, fx, fy):
        return jnp.ones(jnp.broadcast_shapes(jnp.shape(fx), jnp.shape(fy)))

    def moments(self):
        return jnp.zeros(3)

    def describe(self) -> dict[str, float]:
        return {}

    def points(self, n: int) -> np.ndarray:
        return np.zeros((1, 2))

    def trace(self, n: int, rng: np.random.Generator) -> np.ndarray:
        return np.zeros((n, 2))
