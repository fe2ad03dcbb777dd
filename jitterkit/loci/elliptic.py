"""The elliptical loci: second moments with their signs, regular at zero size.

A density whose contours are ellipses of one shape depends on frequency through ``f'Σf`` alone.  Its
coordinates are the moments themselves.  In a fit Σ may become indefinite (noise about no jitter);
clipping it would bias the separation.
"""

from __future__ import annotations

import math
from typing import ClassVar, Self

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.special import ndtri

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.loci.base import OfVariance, moments_on_axis, principal_axes, turned, whole_cycles
from jitterkit.loci.special import harmonic_transfer, normal_transfer
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


def normal_grid(n: int) -> list[np.ndarray]:
    """Return the two coordinates of at least ``n`` points on a square grid that is dense as a normal law."""
    side = max(2, int(np.ceil(np.sqrt(n))))
    normal = ndtri((np.arange(side) + 0.5) / side)
    normal /= normal.std()
    return [grid.ravel() for grid in np.meshgrid(normal, normal)]


class Elliptic(OfVariance):
    """A locus whose first three coordinates are ``(Sxx, Sxy, Syy)``, arcsec²."""

    @classmethod
    def near(cls, moments) -> Self:
        return cls(real(moments))

    def moments(self):
        return self.coords[:3]

    def _placed(self, along, across) -> np.ndarray:
        """Return the offsets (n, 2) of positions given in 1 sigma along each principal axis."""
        major, minor, angle = principal_axes(self.moments())
        return turned(major * along, minor * across, angle)


class Mvn(Elliptic):
    """A normal density with covariance Σ: ``M = exp(-2 pi² f'Σf)``.

    Nature makes it from many independent disturbances (wheels, coolers, noise of the attitude loop).
    It is also what any small jitter looks like: below about half a pixel an image shows the second
    moments of the pointing and nothing more.
    """

    names: ClassVar[tuple[str, ...]] = ("mvn_xx", "mvn_xy", "mvn_yy")
    profile = staticmethod(normal_transfer)

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

    def describe(self) -> dict[str, float]:
        """Return ``sigma_major``, ``sigma_minor`` [arcsec], ``shear`` and ``angle`` [deg]."""
        major, minor, angle = principal_axes(self.coords)
        shear = 1 - minor / major if major > 0 else 0.0
        return {"sigma_major": major, "sigma_minor": minor, "shear": shear, "angle": angle}

    def points(self, n: int) -> np.ndarray:
        return self._placed(*normal_grid(n))

    def trace(self, n: int, rng: np.random.Generator) -> np.ndarray:
        return self._placed(rng.standard_normal(n), rng.standard_normal(n))


class Ellipse(Elliptic):
    """An ellipse run round in simple harmonic motion: ``M = J0(sqrt(8 pi² f'Σf))``.

    Semi-axes ``a`` and ``b`` have variances ``a²/2`` and ``b²/2`` along them.  With ``b = 0`` it is a
    vibration in one plane, with ``a = b`` a circle.  Which way round, an image does not tell.

    Nature makes it when a structure rings at one frequency well above the frame rate and both axes follow,
    each with its own amplitude and phase: a wheel's imbalance, a whirling shaft, a cooler.
    """

    names: ClassVar[tuple[str, ...]] = ("ellipse_xx", "ellipse_xy", "ellipse_yy")
    profile = staticmethod(harmonic_transfer)
    cumulants: ClassVar[tuple[float, float] | None] = (-3 / 2, 10.0)

    @classmethod
    def of(cls, semi_major: float, semi_minor: float, angle: float = 0.0) -> Self:
        """Build from the semi-axes [arcsec] and the angle of the major one [deg]."""
        if not (semi_major >= 0 and semi_minor >= 0):
            problem = f"Semi-axes must not be negative, in arcsec; got {semi_major} and {semi_minor}."
            raise ConfigurationError(ErrorCode.OUT_OF_RANGE, problem)
        return cls(covariance(semi_major / np.sqrt(2), semi_minor / np.sqrt(2), angle))

    def describe(self) -> dict[str, float]:
        """Return ``semi_major``, ``semi_minor`` [arcsec] and ``angle`` of the major axis [deg]."""
        major, minor, angle = principal_axes(self.coords)
        return {"semi_major": math.sqrt(2) * major, "semi_minor": math.sqrt(2) * minor, "angle": angle}

    def points(self, n: int) -> np.ndarray:
        return self._at_phase(2 * np.pi * (np.arange(n) + 0.5) / n)

    def trace(self, n: int, rng: np.random.Generator) -> np.ndarray:
        return self._at_phase(whole_cycles(n, rng))

    def _at_phase(self, phase: np.ndarray) -> np.ndarray:
        return self._placed(np.sqrt(2) * np.cos(phase), np.sqrt(2) * np.sin(phase))


class Lissajous(Ellipse):
    """``x = Ax cos t``, ``y = Ay cos(t + phase)`` over many cycles: an ellipse in other words.

    Its density, transfer function and fit coordinates are those of
    :class:`~jitterkit.loci.elliptic.Ellipse`; only what a person gives and is given back differs.

    Nature makes it as she makes every ellipse; engineers meet it in this form, because an attitude sensor
    reports two axes and a spectrum of each.
    """

    names: ClassVar[tuple[str, ...]] = ("lissajous_xx", "lissajous_xy", "lissajous_yy")

    @classmethod
    def of(cls, amplitude_x: float, amplitude_y: float, phase: float = 90.0) -> Self:
        """Build from the amplitudes [arcsec], zero to peak, and the phase between the axes [deg]."""
        if not (amplitude_x >= 0 and amplitude_y >= 0):
            problem = f"Amplitudes must not be negative, in arcsec; got {amplitude_x} and {amplitude_y}."
            raise ConfigurationError(ErrorCode.OUT_OF_RANGE, problem)
        sxy = amplitude_x * amplitude_y * np.cos(np.radians(phase))
        return cls(jnp.asarray([amplitude_x**2, sxy, amplitude_y**2]) / 2)

    def describe(self) -> dict[str, float]:
        """``amplitude_x``, ``amplitude_y`` [arcsec] and ``phase`` [deg] in [0, 180]: its sign is lost."""
        sxx, sxy, syy = (float(s) for s in self.coords)
        x, y = np.sqrt(2 * max(sxx, 0.0)), np.sqrt(2 * max(syy, 0.0))
        phase = np.degrees(np.arctan2(np.sqrt(max(sxx * syy - sxy**2, 0.0)), sxy))
        return {"amplitude_x": float(x), "amplitude_y": float(y), "phase": float(phase)}
