"""Hold the misfit of a frame to its expected image."""

from __future__ import annotations

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jitterkit.likelihood.data import Data, clears, mean_counts, pixel_variance, telling

POOR = 1.5
"""Chi-squared a degree of freedom beyond which the numbers of a fit mean nothing."""

MISFIT = 5.0
"""Standard deviations of chi-squared from its expectation, from which a frame does not fit."""


class Misfit(NamedTuple):
    """Hold the misfit of a frame to its expected image.

    Attributes
    ----------
    chi2 : float
        Pearson's; its expectation under the model is ``pixels``, at any flux.
    pixels : int
        How many count: used, and expected to hold something.
    spread : float
        Standard deviation of ``chi2`` under the model: each pixel adds ``2 + μ/(μ+σ²)²`` to its square.
    residual : (ny, nx) array
        ``(data - image)/sqrt(image + read variance)``; NaN where a pixel does not count.
    """

    chi2: float
    pixels: int
    spread: float
    residual: np.ndarray


def pearson(image, data: Data) -> Misfit:
    """Pearson's chi-squared of an expected image (ny, nx), and the residual in sigmas.

    Pixels that may reach their ceiling are left out: what of their noise is seen is not Poisson.
    """
    chi2, pixels, spread, residual = _pearson(jnp.asarray(image), data)
    return Misfit(float(chi2), int(pixels), float(spread), np.asarray(residual))


def chi_squared(image, data: Data):
    """The numbers of :func:`pearson`, for use within a compiled program: chi-squared, pixels and spread."""
    return _pearson(image, data)[:3]


@eqx.filter_jit
def _pearson(image, data: Data):
    mean = mean_counts(image, data)
    counts = telling(image, data) & data.used
    if data.ceiling is not None:
        counts &= clears(mean, data)
    own = pixel_variance(mean, data)
    residual = jnp.where(counts, (data.electrons + data.offset - mean) / jnp.sqrt(own), jnp.nan)
    variance = jnp.where(counts, 2 + jnp.clip(image, 0) / (data.weight**3 * own**2), 0.0).sum()
    return jnp.nansum(residual**2), counts.sum(), jnp.sqrt(variance), residual
