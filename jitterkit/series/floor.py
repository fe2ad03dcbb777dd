"""Where averaging stops: the flat floor under which more measurements do not help.

Reach for :func:`fit_floor`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import brentq
from scipy.stats import chi2, norm

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.series.components import Components, State, fit_components, haar_coefficients
from jitterkit.series.series import Series

_FEWEST = 16
"""Measurements from which kinds of noise can be distinguished at all: four octaves."""

_CORRELATED = 1.13
"""Error of a floor over what it were if the coefficients of flicker were independent (from their exact
covariance; of a floor that hardly shows it is less, down to 1.02)."""

_UPPER = float(chi2.isf(0.1, 1)) * _CORRELATED**2
"""By which twice the log likelihood falls from the best floor to the 95 % upper limit."""

_NOTHING = 1e-4
"""Likelihood ratio below which a fit has not moved from zero."""

_CLOSE = 3e-3
"""Relative accuracy of that limit's square."""

_RATIOS = 2.0 ** np.arange(-26, 9)
"""Of a red noise's variance to the white one's at one step, tried before the fit; it starts from the best."""


@dataclass(frozen=True, eq=False)
class Floor:
    """White noise, a floor of flicker and perhaps a random walk under a series, about its trend.

    Attributes
    ----------
    floor, error : float
        The Allan deviation to which means fall, in the unit of the values, and its error; NaN at zero.
    upper : float
        95 % upper limit of the floor.
    white, white_error : float
        White noise of one step of the grid.
    scale, scale_error : float
        White noise over what the stated errors say.
    walk, walk_error : float
        Allan deviation of the random walk at one step; it grows as the root of the length.
    ratio, p_value : float
        Twice the log of the likelihood ratio against white noise alone, and how often that shows so much.
    detected : bool
        Whether the p-value is below the false-alarm probability asked for.
    p_walk : float
        How often white noise and a floor look so much like a random walk on top.
    meets : float
        Averaging length at which white noise has fallen to the floor, in steps; infinite without a floor.
    cadence : float
        A step, in the unit of the times.
    """

    floor: float
    error: float
    upper: float
    white: float
    white_error: float
    scale: float
    scale_error: float
    walk: float
    walk_error: float
    ratio: float
    p_value: float
    detected: bool
    p_walk: float
    meets: float
    cadence: float

    @property
    def significance(self) -> float:
        """Return the p-value in sigmas of a normal law, one-sided."""
        return float(norm.isf(self.p_value))

    def deviation(self, lengths) -> np.ndarray:
        """Allan deviation that the fitted noise has at averaging lengths in steps."""
        lengths = np.asarray(lengths, float)
        return np.sqrt(self.white**2 / lengths + self.floor**2 + self.walk**2 * lengths)


def fit_floor(
    series: Series,
    *,
    degree: int = 1,
    walk: bool = False,
    known_errors: bool = False,
    false_alarm: float = 0.01,
) -> Floor:
    """Fit what stops the averaging of a series.

    Parameters
    ----------
    series : Series
    degree : int
        Of the polynomial trend that is fitted with the noise and is not part of it; 0 to 3.
    walk : bool
        Fit a random walk beside the floor; it takes much of the blame for the longest averages.
    known_errors : bool
        Take the stated errors for the white noise.  Else one factor of all of them is fitted, so that
        errors a little too small do not pass for a floor.
    false_alarm : float
        Probability with which white noise may be said to have a floor.

    Returns
    -------
    floor : Floor

    Raises
    ------
    ConfigurationError
        If there are fewer than 16 measurements, or known errors were asked for and none stated.

    Notes
    -----
    The likelihood is that of the Haar coefficients, taken as independent normal numbers.  Of white noise they
    are; of flicker neighbours have a correlation of -0.13, for which error and upper limit are widened.  The
    ratio of likelihoods is zero for half of all white series and else chi-squared with one degree of freedom.

    *Fails when* outliers are in it (:meth:`~jitterkit.series.series.Series.without` takes them out), or the
    slow noise is neither flat nor a walk, as a period is.
    """
    if known_errors and not series.stated:
        problem = "No errors are stated that could be known; give errors, or fit them."
        raise ConfigurationError(ErrorCode.MISSING_VALUE, problem)
    model = _Model(series, degree, known_errors)
    if (n := len(model.haar.values) + 1) < _FEWEST:
        problem = f"{n} measurements do not show a floor; give {_FEWEST} or more."
        raise ConfigurationError(ErrorCode.TOO_FEW, problem)
    white, flicker, both = (model.fit(*red) for red in ((False, False), (True, False), (True, True)))
    chosen, unit = both if walk else flicker, model.unit
    ratio = max(0.0, 2 * (flicker.log_likelihood - white.log_likelihood))
    p_value = _chance(ratio)
    # the levels of the three noises, and their errors; NaN of those at zero or held
    amounts, variances = np.sqrt(unit * chosen.amounts), np.sqrt(np.diag(chosen.covariance)) * unit
    pairs = zip(amounts, variances, strict=True)
    errors = [float(e / (2 * x)) if x > 0 and e > 0 else math.nan for x, e in pairs]
    return Floor(
        floor=float(amounts[1]),
        error=_CORRELATED * errors[1],
        upper=math.sqrt(unit * model.upper(chosen)),
        white=float(amounts[0]),
        white_error=errors[0],
        scale=float(amounts[0]) / math.sqrt(unit),
        scale_error=errors[0] / math.sqrt(unit),
        walk=float(amounts[2]),
        walk_error=errors[2],
        ratio=ratio,
        p_value=p_value,
        detected=p_value < false_alarm,
        p_walk=_chance(2 * (both.log_likelihood - flicker.log_likelihood)),
        meets=float(amounts[0] / amounts[1]) ** 2 if amounts[1] > 0 else math.inf,
        cadence=series.cadence,
    )


def _chance(ratio: float) -> float:
    """Return the probability of so large a likelihood ratio where the amount is zero and cannot be less."""
    return 1.0 if ratio < _NOTHING else float(chi2.sf(ratio, 1)) / 2


class _Model:
    """Haar coefficients and the variances that may be in them, counted in the white variance of a step."""

    def __init__(self, series: Series, degree: int, known_errors: bool) -> None:
        self.haar = haar = haar_coefficients(series, degree)
        self.unit = float(np.median(haar.white[haar.octave == haar.octave.min()])) / 2
        self.shapes = np.stack([haar.white, self.unit * haar.flicker, self.unit * haar.walk])
        self.free_white = not known_errors

    def fit(self, flicker: bool, walk: bool) -> Components:
        """Fit white noise and some red ones, from the best of a grid of amounts."""
        free = np.array([self.free_white, flicker, walk])
        # from those that describe the mean squares of octaves best, about the trend under white noise
        tries = [_RATIOS if one else np.zeros(1) for one in free[1:]]
        red = np.stack(np.meshgrid(*tries, indexing="ij"), axis=-1).reshape(-1, 2)
        amounts = np.concatenate([np.ones((len(red), 1)), red], axis=1)
        count, squares, shapes = self._octaves
        variance = amounts @ shapes
        if self.free_white:
            factor = ((squares / variance) @ count / count.sum())[:, None]
            amounts, variance = amounts * factor, variance * factor
        return self._fit(amounts[np.argmin((np.log(variance) + squares / variance) @ count)], free)

    def _fit(self, start: np.ndarray, free: np.ndarray) -> Components:
        return fit_components(self.haar.values, self.haar.trend, self.shapes, start, free)

    @cached_property
    def _octaves(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the number of coefficients, mean squared residual and mean variances of each octave."""
        octave = self.haar.octave
        residual = State.at(self.haar.values, self.haar.trend, self.haar.white).residual
        count = np.bincount(octave)
        sums = np.stack([np.bincount(octave, row) for row in (residual**2, *self.shapes)])
        means = sums[:, count > 0] / count[count > 0]
        return count[count > 0], means[0], means[1:]

    def upper(self, best: Components) -> float:
        """Return the amount of flicker at which the likelihood has fallen to the 95 % upper limit."""
        free = np.array([self.free_white, False, best.covariance[2, 2] > 0])
        likeliest, step = best.amounts[1], 2 * math.sqrt(best.covariance[1, 1])

        def short(amount: float) -> float:
            held = np.array([best.amounts[0], amount, best.amounts[2]])
            return 2 * (best.log_likelihood - self._fit(held, free).log_likelihood) - _UPPER

        while short(likeliest + step) < 0:
            step *= 2
        return float(brentq(short, likeliest, likeliest + step, xtol=_CLOSE * step, rtol=_CLOSE))
