"""Variance components: how much of each noise is in the Haar coefficients of a series.

The coefficients are differences of halves, of halves of halves, and so on.  Under white noise, gaps and
unequal errors or not, they are independent; under flicker and random walks nearly so, and each noise gives
them known variances.  That makes them the right thing to fit noise to, where the points of an overlapping
Allan deviation are anything but independent.

Reach for :func:`haar_coefficients` and :func:`fit_components`.  The likelihood is the restricted one: the
trend's coefficients are integrated out, so that fitting them does not make the noise look smaller.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from jitterkit.series.laws import difference_variance
from jitterkit.series.series import Series


@dataclass(frozen=True, eq=False)
class Haar:
    """Differences of the weighted means of neighbouring blocks of 1, 2, 4, ... steps.

    Attributes
    ----------
    values : (k,) array
        Later less earlier; k is one less than the measurements.
    octave : (k,) int array
        The blocks are of ``2**octave`` steps, or what there is of them.
    trend : (k, degree) array
        The same of the powers of time, counted from the middle of the series in halves of its length.
    white : (k,) array
        Variance by the errors.
    flicker, walk : (k,) array
        Variances of noises with an Allan variance of one at one step.
    """

    values: np.ndarray
    octave: np.ndarray
    trend: np.ndarray
    white: np.ndarray
    flicker: np.ndarray
    walk: np.ndarray


def haar_coefficients(series: Series, degree: int = 1) -> Haar:
    """Take a series apart, in time proportional to its length.

    Parameters
    ----------
    series : Series
    degree : int
        Of the powers of time that are taken apart with it.

    Notes
    -----
    Blocks are weighed by the errors.  For flicker and walks a block with gaps stands as a whole one with the
    same mean time and the same spread in time.
    """
    weights, means = series.gridded()
    size = 1 << (len(weights) - 1).bit_length()
    weight = np.zeros(size)
    weight[: len(weights)] = weights
    step = np.arange(size, dtype=float)
    time = 2 * step / (len(weights) - 1) - 1
    columns = np.stack([np.zeros(size), step, *(time**k for k in range(1, degree + 1))], axis=1)
    columns[: len(means), 0] = means
    spread = np.full(size, 1 / 12)
    rows: list[tuple[np.ndarray, ...]] = []
    for octave in range(size.bit_length() - 1):
        first, second = weight[0::2], weight[1::2]
        both = (first > 0) & (second > 0)
        change = columns[1::2] - columns[0::2]
        lengths = (np.sqrt(12 * part[both]) for part in (spread[0::2], spread[1::2]))
        white = 1 / first[both] + 1 / second[both]
        rows.append((change[both], np.full(len(white), octave), white, *lengths))
        weight = first + second
        share = np.divide(second, weight, out=np.zeros_like(weight), where=weight > 0)
        spread = spread[0::2] * (1 - share) + spread[1::2] * share + share * (1 - share) * change[:, 1] ** 2
        columns = columns[0::2] + share[:, None] * change
    change, octaves, white, first, second = (np.concatenate(column) for column in zip(*rows, strict=True))
    red = (difference_variance(first, second, change[:, 1], noise) for noise in ("flicker", "walk"))
    return Haar(change[:, 0], octaves, change[:, 2:], white, *red)


_STEPS = 100
_SHARES = 0.5 ** np.arange(12)
"""Of a step, tried until one does not lower the likelihood."""

_CONVERGED = 1e-6
"""Of the log likelihood, whose differences decide at 1 and more."""

_RIDGE = 1e-12
"""Of the information, for shapes that hardly differ."""


@dataclass(frozen=True, eq=False)
class Components:
    """The most likely amounts of some noises.

    Attributes
    ----------
    amounts : (q,) array
        Factors of the variances given, none negative.
    covariance : (q, q) array
        By the expected information; of an amount at zero it says how large it could be.  Zero of those held.
    log_likelihood : float
    """

    amounts: np.ndarray
    covariance: np.ndarray
    log_likelihood: float


def fit_components(
    values: np.ndarray, regressors: np.ndarray, shapes: np.ndarray, start: np.ndarray, free: np.ndarray
) -> Components:
    """Fit independent normal numbers whose variances are sums of known shapes.

    Parameters
    ----------
    values : (k,) array
    regressors : (k, p) array
        Of their mean.
    shapes : (q, k) array
        Variances that one unit of each noise gives.
    start : (q,) array
        Amounts; with them every variance must be positive.
    free : (q,) bool array
        Which of them are fitted; the others stay.

    Notes
    -----
    Fisher scoring: squared residuals, and what the trend took of them, are regressed on the variances with
    the weights of the last step, none negative.  A step that lowers the likelihood is halved.
    """
    amounts = np.array(start, float)
    state = State.at(values, regressors, amounts @ shapes)
    for _ in range(_STEPS if free.any() else 0):
        target = amounts.copy()
        target[free] = _solve(shapes[free], state, amounts[~free] @ shapes[~free])
        for step in _SHARES:
            trial = amounts + step * (target - amounts)
            new = State.at(values, regressors, trial @ shapes)
            if new.log_likelihood >= state.log_likelihood:
                break
        else:
            break
        gain = new.log_likelihood - state.log_likelihood
        amounts, state = trial, new
        if gain < _CONVERGED:
            break
    covariance = np.zeros((len(amounts), len(amounts)))
    covariance[np.ix_(free, free)] = np.linalg.pinv(_information(shapes[free], state))
    return Components(amounts, covariance, state.log_likelihood)


@dataclass(frozen=True, eq=False)
class State:
    """Residuals, leverages and likelihood at given variances."""

    weight: np.ndarray
    residual: np.ndarray
    leverage: np.ndarray
    log_likelihood: float

    @classmethod
    def at(cls, values: np.ndarray, regressors: np.ndarray, variance: np.ndarray) -> State:
        weight = 1 / variance
        weighted = regressors * weight[:, None]
        information = regressors.T @ weighted
        covariance = np.linalg.inv(information)
        residual = values - regressors @ (covariance @ (weighted.T @ values))
        leverage = np.sum((weighted @ covariance) * regressors, axis=1)
        determinant = float(np.linalg.slogdet(information)[1])
        total = -0.5 * (float(np.sum(np.log(variance)) + residual**2 @ weight) + determinant)
        return cls(weight, residual, leverage, total)


def _information(shapes: np.ndarray, state: State) -> np.ndarray:
    relative = shapes * state.weight
    return relative @ relative.T / 2


def _solve(shapes: np.ndarray, state: State, held: np.ndarray) -> np.ndarray:
    """Amounts, none negative, that come nearest to the squared residuals less what is held."""
    information = _information(shapes, state)
    squares = (state.residual**2 - held) * state.weight + state.leverage
    towards = (shapes * state.weight) @ squares / 2
    size = np.sqrt(np.diag(information))
    root = np.linalg.cholesky(information / np.outer(size, size) + _RIDGE * np.eye(len(size)))
    return nnls(root.T, np.linalg.solve(root, towards / size))[0] / size
