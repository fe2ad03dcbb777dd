"""The laws of white, flicker and random-walk noise: how means over blocks of time differ.

All three come from one formula.  Of noise whose integral over time has the generalised covariance g(t), any
difference of two block means has a variance that is a sum of g at the distances of the blocks' ends: g is |t|
for white noise, t² ln|t| for flicker, |t|³ for a random walk.  Reach for :func:`difference_variance` and
:func:`degrees_of_freedom`; :func:`simulate_flicker` draws noise to try them on.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import matmul_toeplitz
from scipy.special import xlogy

from jitterkit.errors import ConfigurationError, ErrorCode, one_of

NOISES = ("white", "flicker", "walk")

_REACH = {"white": 2, "flicker": 10, "walk": 2}
"""Lags, in blocks, beyond which differences are independent; of flicker the correlation is 1e-3 there."""

_FAR = 1000.0
"""Lag from which the second difference of t² ln t is 2 ln t + 3: to 1e-7, and rounding is no better."""


def _generalised(t: np.ndarray, noise: str) -> np.ndarray:
    one_of("noise", noise, NOISES)
    t = np.abs(t)
    return t if noise == "white" else t**3 if noise == "walk" else xlogy(t**2, t)


def _fourth_difference(lag, noise: str) -> np.ndarray:
    """Return the fourth difference of g in steps of a block: of it a difference of two blocks is made."""
    lag = np.asarray(lag, float)
    ends = ((-2, 1), (-1, -4), (0, 6), (1, -4), (2, 1))
    return sum((times * _generalised(lag + shift, noise) for shift, times in ends), np.zeros_like(lag))


def difference_correlation(lag, noise: str) -> np.ndarray:
    """Correlation of two differences of adjacent block means, ``lag`` block lengths apart.

    >>> difference_correlation([0.0, 0.5, 1.0, 2.0], "white").tolist()
    [1.0, 0.25, -0.5, -0.0]
    """
    return _fourth_difference(lag, noise) / _fourth_difference(0.0, noise)


def difference_variance(first, second, distance, noise: str) -> np.ndarray:
    """Return the variance of the difference of two block means, where the Allan variance at length 1 is one.

    Parameters
    ----------
    first, second : (k,) array
        Lengths of the blocks.
    distance : (k,) array
        Between their centres.
    noise : str
        One of :data:`NOISES`.

    Returns
    -------
    variance : (k,) array
        For neighbours of one length m it is 2/m, 2 and 2m.
    """
    a, b, d = (np.asarray(x, float) for x in (first, second, distance))

    def g(t: np.ndarray) -> np.ndarray:
        return _generalised(t, noise)

    between = g(d + (b - a) / 2) + g(d - (b - a) / 2) - g(d + (a + b) / 2) - g(d - (a + b) / 2)
    shape = -2 * g(a) / a**2 - 2 * g(b) / b**2 - 2 * between / (a * b)
    return 2 * shape / _fourth_difference(0.0, noise)


def degrees_of_freedom(count: int, length: int, noise: str) -> float:
    """Return how many independent differences are worth ``count`` overlapping ones.

    Parameters
    ----------
    count : int
        Of differences of adjacent means of ``length`` measurements, each starting one after the other.
    length : int
    noise : str

    Returns
    -------
    dof : float
        Twice the squared mean of their mean square over its variance.

    Notes
    -----
    The variance of a mean of squared normal numbers is twice the mean of the squares of their correlations,
    so ``count / dof`` is the sum over lags k of ``(1 - |k|/count) rho(k)²``.  Agrees with the approximations
    of Greenhall & Riley (2003).
    """
    one_of("noise", noise, NOISES)
    lag = np.arange(1, min(count, _REACH[noise] * length))
    terms = (1 - lag / count) * difference_correlation(lag / length, noise) ** 2
    return count / (1 + 2 * float(terms.sum()))


def contrast_covariance(contrasts: np.ndarray, noise: str) -> np.ndarray:
    """Return the covariance of some weighted sums of a series, each with weights that add up to nothing.

    Parameters
    ----------
    contrasts : (n, p) array
        Weights of contiguous measurements.
    noise : str
        With an Allan variance of one at one step.

    Returns
    -------
    covariance : (p, p) array
        A contrast of two neighbours has a variance of 2, whatever the noise.
    """
    lag = np.arange(len(contrasts), dtype=float)
    near = np.minimum(lag, _FAR)
    second = sum(k * _generalised(near + shift, noise) for shift, k in ((-1, 1), (0, -2), (1, 1)))
    if noise == "walk":
        second = np.where(lag > 0, 6 * lag, 2.0)
    elif noise == "flicker":
        second = np.where(lag > _FAR, 2 * np.log(np.maximum(lag, 1)) + 3, second)
    row = -2 * second / _fourth_difference(0.0, noise)
    return contrasts.T @ matmul_toeplitz(row, contrasts)


_FROM = 200
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
        problem = f"Flicker of {n} values at a level of {level:g} cannot be drawn"
        remedy = "give two values or more, and a finite level that is not negative"
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, f"{problem}; {remedy}.")
    half = 2 * level**2 * difference_correlation(np.arange(n), "flicker")
    half[_FROM:] = level**2 * _TAIL * np.arange(n)[_FROM:] ** -2.0
    spectrum = np.fft.rfft(np.concatenate([half, half[-2:0:-1]])).real.clip(0)
    size = 2 * (n - 1)
    noise = np.fft.rfft(rng.standard_normal(size)) * np.sqrt(spectrum)
    return np.concatenate([[0.0], np.cumsum(np.fft.irfft(noise, size)[: n - 1])])
