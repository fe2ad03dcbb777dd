"""A drift and random motion at once: the natural locus of broad-band jitter, exposure by exposure.

Nature makes it from every spectrum of disturbances: what is slower than the exposure smears it, each
time in another direction, and what is faster blurs it normally.
"""

from __future__ import annotations

from typing import ClassVar, Self

import jax.numpy as jnp
import numpy as np

from jitterkit.loci.base import axis_variances
from jitterkit.loci.linear import Linear
from jitterkit.loci.mvn import Mvn
from jitterkit.loci.product import Product


class Smear(Product):
    """A straight smear convolved with a normal density: ``M = sinc(f.l) exp(-2 pi² f'Σf)``.

    *Fails when* the blur is small against the resolution: an image then shows the sum of both moments and
    does not tell one from the other.
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
