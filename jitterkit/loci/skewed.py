"""Small motion that is not the same both ways: a normal blur with third cumulants.

Nature makes it by speed or light that changes along a path, by a vibration that decays, and by a jump that is
not in the middle of the exposure.  It is what an image shows next after the second moments where a path has
no symmetry.
"""

from __future__ import annotations

from typing import ClassVar, Self

import jax.numpy as jnp
import numpy as np

from jitterkit.loci.base import principal_axes
from jitterkit.loci.cumulants import cumulant_exponent
from jitterkit.loci.elliptic import Elliptic, covariance, normal_grid
from jitterkit.precision import real

_COMPONENTS = ("xxx", "xxy", "xyy", "yyy")


class Skewed(Elliptic):
    """Covariance Σ and third cumulants: ``M = exp(-2 pi² f'Σf + 4 pi³ i/3 sum κ_jkl f_j f_k f_l)``.

    Notes
    -----
    Exact to third order in frequency for any motion.  It is a density to first order in the skewness only,
    which is enough below one.  Skewness and position are distinguished by fine detail of the
    image: errors of x and y are about twice those of other loci, while the separation's stays.
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
