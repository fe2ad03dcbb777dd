"""Independent motions at the same time: densities are convolved, transfer functions multiply.

Nature makes it whenever two causes have nothing to do with each other: a drift under the noise of the
attitude loop, two wheels at unrelated speeds, a measured trace and what its sensor missed.
"""

from __future__ import annotations

import math
from typing import ClassVar, Self

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.loci.base import Locus, axis_variances, principal_axes
from jitterkit.loci.elliptic import Mvn
from jitterkit.loci.streak import Linear, Shm


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


_LEAST = 0.1
"""Of the greater length, that the lesser starts with: at none a streak has no slope to follow."""


class Tones(Product):
    """Two independent vibrations; their moments add.

    Which is the first, an image does not tell.  For three tones or more, multiply: ``Product(Shm.of(0.3),
    Shm.of(0.2, 40.0), Shm.of(0.1, 80.0))``.

    *Assumes* frequencies without a small common multiple; with one, the path closes and is another.

    Nature makes it from two wheels at different speeds, or two modes of one structure.  The image is
    a lozenge, brightest at its four corners.
    """

    names: ClassVar[tuple[str, ...]] = ("tone1_c", "tone1_s", "tone2_c", "tone2_s")

    def __init__(self, first: Shm, second: Shm) -> None:
        super().__init__(first, second)

    @classmethod
    def of(cls, length1: float, angle1: float, length2: float, angle2: float) -> Self:
        """Build from both lengths, peak to peak [arcsec], and the angles of their axes [deg]."""
        return cls(Shm.of(length1, angle1), Shm.of(length2, angle2))

    @classmethod
    def near(cls, moments) -> Self:
        """Start with one tone along each principal axis."""
        major, minor, angle = principal_axes(moments)
        scale = Shm.variance**-0.5
        return cls.of(scale * major, angle, scale * max(minor, _LEAST * major), angle + 90)

    def describe(self) -> dict[str, float]:
        """Return ``length1``, ``angle1``, ``length2`` and ``angle2``, arcsec and degrees."""
        parts = enumerate(self.factors(), start=1)
        return {f"{name}{k}": value for k, part in parts for name, value in part.describe().items()}


class Smear(Product):
    """A straight smear convolved with a normal density: ``M = sinc(f.l) exp(-2 pi² f'Σf)``.

    *Fails when* the blur is small against the resolution: an image then shows the sum of both moments and
    does not tell one from the other.

    Nature makes it from every spectrum of disturbances: what is slower than the exposure smears it, each
    time in another direction, and what is faster blurs it normally.
    """

    names: ClassVar[tuple[str, ...]] = ("smear_c", "smear_s", "smear_xx", "smear_xy", "smear_yy")

    def __init__(self, smear: Linear, rest: Mvn) -> None:
        super().__init__(smear, rest)

    @classmethod
    def of(
        cls,
        length: float,
        angle: float = 0.0,
        sigma_major: float = 0.0,
        sigma_minor: float | None = None,
        sigma_angle: float = 0.0,
    ) -> Self:
        """Build from the smear's full length and axis, and the normal's sizes and axis [arcsec, deg].

        ``sigma_minor`` defaults to ``sigma_major``.
        """
        return cls(Linear.of(length, angle), Mvn.of(sigma_major, sigma_minor, sigma_angle))

    @classmethod
    def near(cls, moments) -> Self:
        """Build from moments: the excess of the major axis over the minor is smear; the rest is round."""
        major, minor, angle = axis_variances(moments)
        length = np.sqrt((major - minor) / Linear.variance)
        return cls(Linear.of(length, angle), Mvn(jnp.asarray([minor, 0.0, minor])))

    def describe(self) -> dict[str, float]:
        """Return ``length`` and ``angle`` of the smear; the normal's sigmas and ``sigma_angle``."""
        smear, rest = (part.describe() for part in self.factors())
        sigmas = {name: rest[name] for name in ("sigma_major", "sigma_minor")}
        return {**smear, **sigmas, "sigma_angle": rest["angle"]}
