"""The best period of a series.  Reach for :func:`find_period`."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from astropy.timeseries import LombScargle
from scipy.optimize import minimize_scalar

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.series.series import Series
from jitterkit.series.trend import fit_trend

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
        raise ConfigurationError(
            ErrorCode.TOO_FEW if len(y) < _FEWEST else ErrorCode.OUT_OF_RANGE,
            f"{len(y)} measurements over {span:g} show no period down to {shortest:g}; give {_FEWEST} or "
            "more, and a period within them.",
        )
    lag = t - t.min()
    search = LombScargle(lag, y - fit_trend(series, degree).at(t), e, fit_mean=True)
    step = 1 / (_OVERSAMPLE * span)
    frequencies = np.arange(1 / span, 1 / shortest + step / 2, step)
    powers = search.power(frequencies, method="fast", assume_regular_frequency=True)
    near = frequencies[np.argmax(powers)]
    found = minimize_scalar(
        lambda f: -float(search.power(f, method="cython")),
        bounds=(near - step, near + step),
        method="bounded",
    )
    best, power = float(found.x), -float(found.fun)
    alarm = search.false_alarm_probability(power, maximum_frequency=1 / shortest, method="baluev")
    _, sine, cosine = search.model_parameters(best)
    scatter = 1.0 if series.stated else float(np.std(y - fit_trend(series, degree).at(t), ddof=degree + 1))
    error = scatter * math.sqrt(2 / float(np.sum(e**-2)))
    return Period(1 / best, math.hypot(sine, cosine), error, float(alarm), power)
