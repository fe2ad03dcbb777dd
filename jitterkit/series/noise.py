"""Flicker noise to try the rest of the room on.  Reach for :func:`simulate_flicker`."""

from __future__ import annotations

import numpy as np

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.series.laws import difference_correlation

_FAR = 200
"""Lag from which t² ln t loses more to rounding (1e-4 at 300) than its leading term leaves out (2e-5)."""

_TAIL = -1 / (2 * np.log(2))
"""The covariance at great lags k is this over k²: t² ln t has the fourth derivative -2/t²."""


def simulate_flicker(n: int, level: float, rng: np.random.Generator) -> np.ndarray:
    """Draw 1/f noise of a given Allan deviation.

    Parameters
    ----------
    n : int
        Measurements, contiguous in time.
    level : float
        The Allan deviation, the same at every averaging length.
    rng : numpy.random.Generator

    Returns
    -------
    values : (n,) array
        Starting at zero: 1/f noise has no mean of its own.

    Notes
    -----
    Each value is the mean of continuous 1/f noise over its own stretch of time.  Differences of neighbours
    are then stationary, with a covariance known in closed form; they are drawn exactly, on a circle twice as
    long whose spectrum is that covariance's Fourier transform (Davies & Harte 1987), and added up.

    Raises
    ------
    ConfigurationError
        If there are fewer than two values, or the level is negative or not finite.
    """
    if n < 2 or not (np.isfinite(level) and level >= 0):
        raise ConfigurationError(
            ErrorCode.OUT_OF_RANGE,
            f"Flicker of {n} values at a level of {level:g} cannot be drawn; give two values or more, and a "
            "finite level that is not negative.",
        )
    half = 2 * level**2 * difference_correlation(np.arange(n), "flicker")
    half[_FAR:] = level**2 * _TAIL * np.arange(n)[_FAR:] ** -2.0
    spectrum = np.fft.rfft(np.concatenate([half, half[-2:0:-1]])).real.clip(0)
    size = 2 * (n - 1)
    noise = np.fft.rfft(rng.standard_normal(size)) * np.sqrt(spectrum)
    return np.concatenate([[0.0], np.cumsum(np.fft.irfft(noise, size)[: n - 1])])
