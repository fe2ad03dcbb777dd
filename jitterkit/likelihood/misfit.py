"""Hold the misfit of a frame to its expected image."""

from __future__ import annotations

import math
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

    def correlated_noise(self, image) -> str:
        """Say that the noise of neighbouring pixels is correlated, as resampling and smoothing leave it.

        Parameters
        ----------
        image : (ny, nx) array
            The expected image.

        Returns
        -------
        remark : str
            A sentence; empty where chance may explain it, or dark pixels do not fit.

        Notes
        -----
        Residuals of the darker half, where an error of the model hardly shows, are multiplied with their
        neighbours', less those a few pixels away: a gradient of the sky and a pattern of whole rows cancel.
        """
        counted = np.isfinite(self.residual)
        level = np.median(image[counted]) if counted.any() else 0.0
        known = np.where(counted & (image <= level), self.residual, np.nan)
        products = [one[:-_APART] * (one[1 : 1 - _APART] - one[_APART:]) for one in (known, known.T)]
        pairs = np.concatenate([of_axis[np.isfinite(of_axis)] for of_axis in products])
        dark, power = max(np.isfinite(known).sum(), 1), float(np.nansum(known**2))
        fits = power < dark + MISFIT * self.spread * math.sqrt(dark / max(self.pixels, 1))
        chance = float(np.sqrt(np.sum(pairs**2)))
        share = float(np.sum(pairs)) / max(len(pairs), 1) / max(power / dark, 1e-300)
        if not (fits and share > _CORRELATED and np.sum(pairs) > MISFIT * chance):
            return ""
        return (
            f"The noise of neighbouring pixels is correlated ({share:.2g}), as resampling or smoothing "
            "leaves it: that is part of the blur, and errors are not valid."
        )


_APART, _CORRELATED = 4, 0.1
"""Pixels beyond which smoothing does not reach, and a correlation that changes errors little."""


def pearson(image, data: Data) -> Misfit:
    """Pearson's chi-squared of an expected image (ny, nx), and the residual in sigmas.

    Pixels that may reach their ceiling are left out: what of their noise is seen is not Poisson.
    """
    chi2, pixels, spread, residual = _pearson(jnp.asarray(image), data)
    return Misfit(float(chi2), int(pixels), float(spread), np.asarray(residual))


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
