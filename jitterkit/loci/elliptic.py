"""What the elliptical loci share: second moments with their signs, regular at zero size.

A density whose contours are ellipses of one shape depends on frequency through ``f'Σf`` alone.  Its
coordinates are the moments themselves.  In a fit Σ may become indefinite (noise about no jitter);
clipping it would bias the separation.
"""

from __future__ import annotations

from typing import Self

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.loci.base import Locus, moments_on_axis, principal_axes, turned
from jitterkit.precision import real


def covariance(sigma_major: float, sigma_minor: float, angle: float) -> Float[Array, "3"]:
    """Return the second moments from 1 sigma sizes along two axes [arcsec] and the angle of the first [deg].

    Raises
    ------
    ConfigurationError
        If a size is negative or no number.
    """
    if not (sigma_major >= 0 and sigma_minor >= 0):
        problem = f"Sigmas must not be negative, in arcsec; got {sigma_major} and {sigma_minor}."
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, problem)
    return jnp.asarray(moments_on_axis([sigma_major**2, 0.0, sigma_minor**2], -angle))


class Elliptic(Locus):
    """A locus whose first three coordinates are ``(Sxx, Sxy, Syy)``, arcsec²."""

    @classmethod
    def near(cls, moments) -> Self:
        return cls(real(moments))

    def moments(self):
        return self.coords[:3]

    def variance_along(self, fx, fy):
        """Return ``f'Σf``."""
        sxx, sxy, syy = self.moments()
        return sxx * fx**2 + 2 * sxy * fx * fy + syy * fy**2

    def _placed(self, along, across) -> np.ndarray:
        """Return the offsets (n, 2) of positions given in 1 sigma along each principal axis."""
        major, minor, angle = principal_axes(self.moments())
        return turned(major * along, minor * across, angle)
