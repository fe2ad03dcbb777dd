"""Steps, lengths and covariances from an information matrix, in units that make its diagonal one."""

from __future__ import annotations

from dataclasses import field
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

LEAST_DAMPING = 1e-9
"""Damping of a step that is hardly damped: it keeps one along a direction without information finite."""

LARGE_FACTOR = 2.0
"""Factor of an error, by a parameter that is hard to tell from another, from which it is worth saying."""


class Metric(NamedTuple):
    """Hold information and curvature, by which steps are computed and measured.

    Along the columns of ``axes`` the curvature is diagonal: ``axes.T @ curvature @ axes`` is ``diag(sizes)``.
    They are orthonormal in units of the parameters that make its diagonal one.
    """

    information: Array
    curvature: Array
    sizes: Array
    axes: Array

    @classmethod
    def of(cls, information, stiffness) -> Metric:
        curvature = information + stiffness
        scale = jnp.sqrt(jnp.diag(curvature))
        scale = jnp.where(scale > 0, scale, 1.0)
        sizes, vectors = jnp.linalg.eigh(curvature / jnp.outer(scale, scale))
        return cls(information, curvature, jnp.maximum(sizes, 0.0), vectors / scale[:, None])

    def step(self, score, damping=LEAST_DAMPING):
        """Return the damped step that a score asks for."""
        return self.axes @ (score @ self.axes / (self.sizes + damping))

    def prediction_error(self, move, change):
        """Return the error of the predicted change of the score in a move, as a share of the move."""
        predicted = self.curvature @ move
        return self.length(change + predicted) / jnp.sqrt(move @ predicted)

    def length(self, score):
        """Return the length of the undamped step, in standard errors."""
        return jnp.sqrt(jnp.sum((score @ self.axes) ** 2 / (self.sizes + LEAST_DAMPING)))


def invert_information(information) -> tuple[np.ndarray, bool]:
    """Invert an information matrix.

    Parameters
    ----------
    information : (p, p) array
        Symmetric; taken in units that make its diagonal one, so that those of the parameters do not
        matter.

    Returns
    -------
    covariance : (p, p) array
        NaN where the information is singular to rounding.
    sound : bool
        Whether it is not.
    """
    information = np.asarray(information)
    scale = np.sqrt(np.maximum(np.diag(information), 0.0))
    sound = bool(np.all(np.isfinite(information)) and np.all(scale > 0))
    if sound and len(scale):
        unit = information / np.outer(scale, scale)
        values, vectors = np.linalg.eigh(unit)
        single = float(np.finfo(np.float32).eps)
        # an information sums squares of 32-bit slopes
        rounding = single if information.dtype == np.float32 else single**2
        sound = bool(values[0] > len(values) * rounding * values[-1])
    if not sound or not len(scale):
        return np.full_like(information, np.nan), sound
    return (vectors / values) @ vectors.T / np.outer(scale, scale), True


def error_factor(covariance: np.ndarray, index: int, other: int) -> float:
    """Return how many times as large a parameter's error is as it would be if another were known.

    Parameters
    ----------
    covariance : (p, p) array
    index, other : int
        Of the two parameters.
    """
    variance = covariance[index, index]
    known = variance - covariance[index, other] ** 2 / covariance[other, other]
    return float(np.sqrt(variance / known)) if known > 0 else np.inf


class Prior(eqx.Module):
    """A normal prior on the free parameters, and one on the second moments of the jitter.

    Attributes
    ----------
    mean : (p,) array
    precision : (p, p) array
        Inverse covariance; zero rows for parameters without a prior.
    moments : (3,) array
        Mean of the prior on the second moments ``(Sxx, Sxy, Syy)`` of the pointing, arcsec²: the same
        for every locus, whatever its coordinates.
    moments_precision : (3, 3) array
        Inverse covariance, arcsec⁻⁴; zero where nothing is known.
    """

    mean: Float[Array | np.ndarray, " p"]
    precision: Float[Array | np.ndarray, "p p"]
    moments: Float[Array | np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))
    moments_precision: Float[Array | np.ndarray, "3 3"] = field(default_factory=lambda: np.zeros((3, 3)))

    @classmethod
    def none(cls, size: int) -> Prior:
        """Return a prior that says nothing about any of ``size`` parameters."""
        return cls(np.zeros(size), np.zeros((size, size)))

    def costs(self, values, moments) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """Return the prior's terms of the deviance: quadratic in the parameters and in the moments."""
        off, beside = values - self.mean, moments - self.moments
        return off @ (self.precision @ off), beside @ self.moments_precision @ beside

    def stiffness(self, slope) -> Float[Array, "p p"]:
        """Return the prior's term of the information, where the moments change by ``slope`` (3, p)."""
        return self.precision + slope.T @ self.moments_precision @ slope
