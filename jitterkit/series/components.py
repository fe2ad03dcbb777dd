"""Variance components: how much of each noise is in the Haar coefficients of a series.

Reach for :func:`fit_components`.  The likelihood is the restricted one: the trend's coefficients are
integrated out, so that fitting them does not make the noise look smaller.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

_STEPS = 100
_SHARES = 0.5 ** np.arange(12)
"""Of a step, tried until one does not lower the likelihood."""

_SETTLED = 1e-6
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
        if gain < _SETTLED:
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
    relative = shapes * state.weight
    information = relative @ relative.T / 2
    squares = (state.residual**2 - held) * state.weight + state.leverage
    towards = relative @ squares / 2
    size = np.sqrt(np.diag(information))
    root = np.linalg.cholesky(information / np.outer(size, size) + _RIDGE * np.eye(len(size)))
    return nnls(root.T, np.linalg.solve(root, towards / size))[0] / size
