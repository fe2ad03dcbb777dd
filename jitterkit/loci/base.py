"""What every jitter locus is: the path of the pointing on the detector while the shutter is open.

A locus is a probability density of pointing offsets.  The image is blurred by it, so all the
forward model needs is its transfer function ``M(f)``, exact at every frequency; no image is shifted
and no kernel drawn.

Which one to reach for: :class:`~jitterkit.loci.mvn.Mvn` while the blur is small against the resolution
(there an image shows second moments and nothing else), :class:`~jitterkit.loci.linear.Linear`
for a drift, :class:`~jitterkit.loci.shm.Shm` for a vibration of many cycles, and
:class:`~jitterkit.loci.stable.Stable` when there is none.

To add a locus, write one file with one class of this kind and add one line to the registry in
``jitterkit/loci/__init__.py``; the contract test in ``tests/loci`` then holds it to the laws.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar, Self

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

__all__ = ["Locus", "principal_axes"]


class Locus(eqx.Module):
    """A jitter locus in coordinates that stay regular at zero size.

    Attributes
    ----------
    coords : (k,) array
        What a fit varies, in arcsec²; all zero means no jitter.  Build a locus from lengths and
        angles with its ``of`` constructor instead.
    names : tuple of str
        One a coordinate (class attribute).
    """

    coords: Float[Array, " k"]
    names: ClassVar[tuple[str, ...]]

    @abstractmethod
    def transfer(self, fx, fy):
        """Transfer function ``M(f)`` at frequencies in cycles/arcsec; 1 at zero."""

    @abstractmethod
    def moments(self) -> Float[Array, "3"]:
        """Second moments ``(Sxx, Sxy, Syy)`` of the pointing, arcsec²."""

    @abstractmethod
    def describe(self) -> dict[str, float]:
        """Sizes [arcsec] and angle [deg] as a person would give them."""

    @classmethod
    @abstractmethod
    def near(cls, moments: Float[Array, "3"]) -> Self:
        """The locus of this kind closest to given second moments: where a fit starts."""

    @abstractmethod
    def points(self, n: int) -> np.ndarray:
        """About ``n`` equally probable pointing offsets ``(m, 2)`` in arcsec, columns x and y."""


def principal_axes(moments) -> tuple[float, float, float]:
    """Principal axes of second moments.

    Parameters
    ----------
    moments : (3,) array
        ``(Sxx, Sxy, Syy)``, arcsec².

    Returns
    -------
    major, minor : float
        1 sigma along each axis, arcsec; zero where the variance is negative, as a noisy estimate of
        no jitter may be.
    angle : float
        Of the major axis, degrees counter-clockwise from +x in [0, 180).
    """
    sxx, sxy, syy = (float(s) for s in moments)
    mean, half = (sxx + syy) / 2, float(np.hypot((sxx - syy) / 2, sxy))
    angle = np.degrees(np.arctan2(2 * sxy, sxx - syy)) / 2 % 180.0
    return float(np.sqrt(max(mean + half, 0.0))), float(np.sqrt(max(mean - half, 0.0))), float(angle)
