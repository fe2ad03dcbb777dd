"""Independent motions at the same time: their densities are convolved, their transfer functions multiply.

Nature makes it whenever two causes have nothing to do with each other: a drift under the noise of the
attitude loop, two wheels at unrelated speeds, a measured trace and what its sensor missed.
"""

from __future__ import annotations

import math
from typing import Self

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.loci.base import Locus


class Product(Locus):
    """Several loci at once.  Moments add.

    Attributes
    ----------
    coords : (k,) array
        Those of all parts, one after the other.
    parts : tuple of Locus
        The kinds; their sizes are in ``coords``.
    """

    coords: Float[Array, " k"]
    parts: tuple[Locus, ...]

    def __init__(self, *parts: Locus) -> None:
        flat = [
            piece for part in parts for piece in (part.factors() if isinstance(part, Product) else (part,))
        ]
        self.coords = jnp.concatenate([part.coords for part in flat]) if flat else jnp.zeros(0)
        self.parts = tuple(flat)

    @property
    def names(self) -> tuple[str, ...]:  # type: ignore[override]
        """Return the names of the parts; from its second appearance on a name is numbered."""
        every = [name for part in self.parts for name in part.names]
        times = [every[: i + 1].count(name) for i, name in enumerate(every)]
        return tuple(f"{name}_{k}" if k > 1 else name for name, k in zip(every, times, strict=True))

    def factors(self) -> tuple[Locus, ...]:
        """Return the parts at their present sizes."""
        ends = np.cumsum([len(part.names) for part in self.parts])[:-1]
        return tuple(part.at(c) for part, c in zip(self.parts, jnp.split(self.coords, ends), strict=True))

    def sampled(self, nodes: int) -> Self:
        parts = self.factors()
        others = [part.sampled(nodes) for part in parts]
        formulae = all(other is part for other, part in zip(others, parts, strict=True))
        return self if formulae else type(self)(*others)

    @classmethod
    def near(cls, moments) -> Self:
        problem = "A product of loci does not follow from second moments; build it from its parts."
        raise ConfigurationError(ErrorCode.UNSUPPORTED, problem)

    def transfer(self, fx, fy):
        product = 1.0
        for part in self.factors():
            product = product * part.transfer(fx, fy)
        return product

    def exact_to(self) -> float:
        return min((part.exact_to() for part in self.factors()), default=math.inf)

    def moments(self):
        return sum((part.moments() for part in self.factors()), jnp.zeros(3))

    def describe(self) -> dict[str, float]:
        """Return the sizes of each part, preceded by its kind (numbered where a kind comes twice)."""
        sizes: dict[str, float] = {}
        kinds = [type(part).__name__.lower() for part in self.parts]
        for i, part in enumerate(self.factors()):
            number = str(kinds[: i + 1].count(kinds[i])) if kinds.count(kinds[i]) > 1 else ""
            sizes |= {f"{kinds[i]}{number}_{name}": value for name, value in part.describe().items()}
        return sizes

    def points(self, n: int) -> np.ndarray:
        """Combine about ``n ** (1 / parts)`` points of each part with each other."""
        each = max(2, round(n ** (1 / max(len(self.parts), 1))))
        total = np.zeros((1, 2))
        for part in self.factors():
            total = (total[:, None] + part.points(each)[None]).reshape(-1, 2)
        return total

    def trace(self, n: int, rng: np.random.Generator) -> np.ndarray:
        return sum((part.trace(n, rng) for part in self.factors()), np.zeros((n, 2)))
