"""The change of a series with time: its slow trend, when its mean holds, and its best period.

Reach for :func:`fit_trend` and :func:`find_period`.  A planet's pull is a slow trend in the separation: to be
reported, not averaged away.  Where averaging stops at a floor, tell it: flicker makes slopes, too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from astropy.timeseries import LombScargle
from scipy.optimize import minimize_scalar
from scipy.stats import chi2, f

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.series.floor import Floor
from jitterkit.series.laws import contrast_covariance
from jitterkit.series.series import Series

_HIGHEST = 3


@dataclass(frozen=True, eq=False)
class Trend:
    """A polynomial under a series, in terms that white noise does not correlate.

    Attributes
    ----------
    mean, mean_error : float
        The weighted mean, which holds at the epoch whatever the slope.
    epoch : float
        The weighted mean time: there the errors of mean and slope are uncorrelated.
    slope, slope_error : float
        Of the best straight line, per unit of time; NaN of a constant.
    terms : (degree + 1,) array
        Of the values, for polynomials of mean square one over the measurements' weights.
    covariance : (degree + 1, degree + 1) array
    chances : (degree + 1,) array
        How often noise gives a term so large; NaN for the mean.
    p_value : float
        How often noise takes so much from the likelihood of a constant; NaN of a constant.
    chi2 : float
        Of the residuals, in the errors stated (or in their own scatter, where none are).
    dof : int
    """

    mean: float
    mean_error: float
    epoch: float
    slope: float
    slope_error: float
    terms: np.ndarray
    covariance: np.ndarray
    chances: np.ndarray
    p_value: float
    chi2: float
    dof: int
    _span: float
    _recurrence: np.ndarray

    def at(self, times) -> np.ndarray:
        """Return the polynomial at given times."""
        return self._basis(times) @ self.terms

    def error_at(self, times) -> np.ndarray:
        """Return one sigma of :meth:`at`."""
        basis = self._basis(times)
        return np.sqrt(np.sum((basis @ self.covariance) * basis, axis=-1))

    def _basis(self, times) -> np.ndarray:
        return _polynomials((np.asarray(times, float) - self.epoch) / self._span, self._recurrence)


def fit_trend(series: Series, degree: int = 1, *, noise: Floor | None = None) -> Trend:
    """Fit a polynomial in time by weighted least squares.

    Parameters
    ----------
    series : Series
    degree : int
        0 to 3.
    noise : Floor, optional
        What the errors and chances reckon with, instead of white noise of the stated errors.

    Returns
    -------
    trend : Trend

    Raises
    ------
    ConfigurationError
        If the degree is another, or there are not two times more than it has terms.

    Notes
    -----
    The polynomials are orthogonal over the weighted times (the discrete Legendre polynomials of this very
    series), so a term does not change with the degree.  Where no errors are stated the scatter about the
    polynomial serves, and the chances are those of the F law.

    Flicker and walks have no mean: with them ``mean_error`` is the Allan deviation of the whole series,
    by which the mean of another one next to it would differ (over sqrt(2)).
    """
    y, e, t = series.present
    if degree not in range(_HIGHEST + 1):
        problem = f"A trend of degree {degree} is not fitted; give 0 to {_HIGHEST}."
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, problem)
    if (times := len(np.unique(t))) < degree + 2:
        problem = f"{times} times have no trend of degree {degree} to test; give more."
        raise ConfigurationError(ErrorCode.TOO_FEW, problem)
    weights = (e.min() / e) ** 2
    epoch, span = float(t[0] + np.average(t - t[0], weights=weights)), float(np.ptp(t)) / 2
    recurrence = _recurrence((t - epoch) / span, weights, degree)
    basis = _polynomials((t - epoch) / span, recurrence)
    makers = basis * (weights / weights.sum())[:, None]
    level = float(np.median(y))
    terms = makers.T @ (y - level)
    squares = float(weights @ (y - level - basis @ terms) ** 2)
    dof = len(y) - degree - 1
    error = float(e.min()) if series.stated else math.sqrt(squares / dof)
    covariance = error**2 / weights.sum() * np.eye(degree + 1)
    if noise is not None:
        covariance = (noise.scale * e.min()) ** 2 / weights.sum() * np.eye(degree + 1)
        covariance += _red(series, makers, noise)
    chances, p_value = _chances(terms, covariance, 0 if series.stated or noise else dof)
    steep = 1 / (recurrence[1, 1] * span) if degree else math.nan
    first = min(1, degree)
    return Trend(
        mean=float(terms[0]) + level,
        mean_error=math.sqrt(covariance[0, 0]),
        epoch=epoch,
        slope=float(terms[first]) * steep,
        slope_error=math.sqrt(covariance[first, first]) * steep,
        terms=terms + np.r_[level, np.zeros(degree)],
        covariance=covariance,
        chances=chances,
        p_value=p_value,
        chi2=squares / error**2,
        dof=dof,
        _span=span,
        _recurrence=recurrence,
    )


def _chances(terms: np.ndarray, covariance: np.ndarray, dof: int) -> tuple[np.ndarray, float]:
    """Return the chance of each term above the mean and of all; ``dof`` where the scatter had to be found."""

    def chance(gain, count: int) -> np.ndarray:
        return f.sf(gain / count, count, dof) if dof else chi2.sf(gain, count)

    slow, covariance = terms[1:], covariance[1:, 1:]
    each = np.r_[math.nan, chance(slow**2 / np.diag(covariance), 1)]
    return each, float(chance(slow @ np.linalg.solve(covariance, slow), len(slow))) if len(slow) else math.nan


def _red(series: Series, makers: np.ndarray, noise: Floor) -> np.ndarray:
    """Return what flicker and a walk add to the covariance of the terms; the mean is no contrast."""
    slots = series.slots
    contrasts = np.zeros((slots.max() + 1, makers.shape[1] - 1))
    np.add.at(contrasts, slots, makers[:, 1:])
    found = np.zeros((makers.shape[1],) * 2)
    for level, name in ((noise.floor, "flicker"), (noise.walk, "walk")):
        if level > 0:
            found[1:, 1:] += level**2 * contrast_covariance(contrasts, name)
    found[0, 0] = noise.floor**2 + noise.walk**2 * len(contrasts)
    return found


def _recurrence(x: np.ndarray, weights: np.ndarray, degree: int) -> np.ndarray:
    """Centres and sizes ``(2, degree + 1)`` of Stieltjes' recurrence for orthonormal polynomials."""
    table = np.zeros((2, degree + 1))
    table[1, 0] = 1.0
    before, here = np.zeros_like(x), np.ones_like(x)
    for k in range(degree):
        table[0, k] = np.average(x * here**2, weights=weights)
        new = (x - table[0, k]) * here - (table[1, k] if k else 0.0) * before
        table[1, k + 1] = math.sqrt(np.average(new**2, weights=weights))
        before, here = here, new / table[1, k + 1]
    return table


def _polynomials(x: np.ndarray, table: np.ndarray) -> np.ndarray:
    """Return the polynomials (..., degree + 1) at given positions."""
    found = [np.ones_like(x)]
    for k in range(table.shape[1] - 1):
        new = (x - table[0, k]) * found[k] - (table[1, k] * found[k - 1] if k else 0.0)
        found.append(new / table[1, k + 1])
    return np.stack(found, axis=-1)


_OVERSAMPLE = 5
_FEWEST = 8
"""Measurements; a sinusoid with a mean and a trend has five numbers."""


@dataclass(frozen=True, eq=False)
class Period:
    """The sinusoid that takes most of a series' scatter.

    Attributes
    ----------
    period : float
        In the unit of the times.
    amplitude, amplitude_error : float
        Zero to peak, and the error of either of its two components under white noise.
    false_alarm : float
        How often the best period of white noise takes so much; an upper bound.
    power : float
        The share of chi-squared about the trend that it takes.
    """

    period: float
    amplitude: float
    amplitude_error: float
    false_alarm: float
    power: float


def find_period(series: Series, *, degree: int = 1, shortest: float | None = None) -> Period:
    """Search a series for a period.

    Parameters
    ----------
    series : Series
    degree : int
        Of the trend that is taken off first.
    shortest : float, optional
        Shortest period, in the unit of the times; two cadences if not given.  The longest is the series.

    Returns
    -------
    period : Period

    Raises
    ------
    ConfigurationError
        If there are fewer than eight measurements, or the shortest period is longer than the series.

    Notes
    -----
    The least-squares periodogram with a free mean (Zechmeister & Kürster 2009), its false alarms by the bound
    of Baluev (2008), which holds whatever one factor the errors are off by.

    *Assumes* white noise.  *Fails when* there is a floor: flicker always has a longest period.
    """
    y, e, t = series.present
    span = float(np.ptp(t))
    shortest = 2 * series.cadence if shortest is None else shortest
    if len(y) < _FEWEST or not 0 < shortest < span:
        code = ErrorCode.TOO_FEW if len(y) < _FEWEST else ErrorCode.OUT_OF_RANGE
        problem = f"{len(y)} measurements over {span:g} show no period down to {shortest:g}"
        raise ConfigurationError(code, f"{problem}; give {_FEWEST} or more, and a period within them.")
    residual = y - fit_trend(series, degree).at(t)
    search = LombScargle(t - t.min(), residual, e, fit_mean=True)
    step = 1 / (_OVERSAMPLE * span)
    frequencies = np.arange(1 / span, 1 / shortest + step / 2, step)
    powers = search.power(frequencies, method="fast", assume_regular_frequency=True)
    near = frequencies[np.argmax(powers)]

    def loss(frequency: float) -> float:
        return -float(search.power(frequency, method="cython"))

    found = minimize_scalar(loss, bounds=(near - step, near + step), method="bounded")
    best, power = float(found.x), -float(found.fun)
    alarm = search.false_alarm_probability(power, maximum_frequency=1 / shortest, method="baluev")
    _, sine, cosine = search.model_parameters(best)
    scatter = 1.0 if series.stated else float(np.std(residual, ddof=degree + 1))
    error = scatter * math.sqrt(2 / float(np.sum(e**-2)))
    return Period(1 / best, math.hypot(sine, cosine), error, float(alarm), power)
