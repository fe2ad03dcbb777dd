"""Random motion, well above the frame rate: a bivariate normal density.

Nature makes it from many independent disturbances (wheels, coolers, noise of the attitude loop).
It is also what any small jitter looks like: below about half a pixel an image shows the second
moments of the pointing and nothing more.
"""

from __future__ import annotations

from typing import ClassVar, Self

import jax.numpy as jnp
import numpy as np
from scipy.special import ndtri

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.loci.base import principal_axes
from jitterkit.loci.elliptic import Elliptic, covariance


class Mvn(Elliptic):
    """A normal density with covariance Σ: ``M = exp(-2 pi² f'Σf)``."""

    names: ClassVar[tuple[str, ...]] = ("mvn_xx", "mvn_xy", "mvn_yy")

    @classmethod
    def of(cls, sigma_major: float, sigma_minor: float | None = None, angle: float = 0.0) -> Self:
        """Build from the 1 sigma sizes along the two axes [arcsec] and the angle of the major one [deg].

        ``sigma_minor`` defaults to ``sigma_major``: a round blur.
        """
        return cls(covariance(sigma_major, sigma_major if sigma_minor is None else sigma_minor, angle))

    @classmethod
    def sheared(cls, sigma_major: float, shear: float, angle: float = 0.0) -> Self:
        """Build from the shear ``1 - sigma_minor/sigma_major`` in [0, 1], as the paper has it."""
        if not 0 <= shear <= 1:
            problem = f"A shear lies between 0 (round) and 1 (a line); got {shear}."
            raise ConfigurationError(ErrorCode.OUT_OF_RANGE, problem)
        return cls.of(sigma_major, sigma_major * (1 - shear), angle)

    def transfer(self, fx, fy):
        return jnp.exp(-2 * jnp.pi**2 * self.variance_along(fx, fy))

    def describe(self) -> dict[str, float]:
        """Return ``sigma_major``, ``sigma_minor`` [arcsec], ``shear`` and ``angle`` [deg]."""
        major, minor, angle = principal_axes(self.coords)
        shear = 1 - minor / major if major > 0 else 0.0
        return {"sigma_major": major, "sigma_minor": minor, "shear": shear, "angle": angle}

    def points(self, n: int) -> np.ndarray:
        side = max(2, int(np.ceil(np.sqrt(n))))
        normal = ndtri((np.arange(side) + 0.5) / side)
        normal /= normal.std()
        along, across = (g.ravel() for g in np.meshgrid(normal, normal))
        return self._placed(along, across)

    def trace(self, n: int, rng: np.random.Generator) -> np.ndarray:
        return self._placed(rng.standard_normal(n), rng.standard_normal(n))
