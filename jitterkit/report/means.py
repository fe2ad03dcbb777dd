"""Means of independent measurements."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

COMBINED = ("mean", "error", "typical_error", "scatter", "chi2_dof", "error_by_scatter")


def weighted_mean(values: np.ndarray, errors: np.ndarray) -> dict[str, Any]:
    """Combine independent measurements of one number.

    Parameters
    ----------
    values, errors : (n,) arrays
        In one unit; those that are not finite, or have no positive error, are left out.

    Returns
    -------
    combined : dict
        ``n`` used; ``mean`` and its ``error`` from the errors alone; ``typical_error``, their median;
        ``scatter``, the sample's standard deviation; ``chi2_dof`` of the values about the mean; and
        ``error_by_scatter``, the mean's error if all errors were off by one factor.  NaN where there
        are too few.  Equal errors give the plain mean and ``error = errors[0]/sqrt(n)``.
    """
    values, errors = np.asarray(values, float), np.asarray(errors, float)
    used = np.isfinite(values) & np.isfinite(errors) & (errors > 0)
    values, errors = values[used], errors[used]
    n = len(values)
    if n == 0:
        return {"n": 0} | dict.fromkeys(COMBINED, math.nan)
    weights = (errors.min() / errors) ** 2
    mean = values[0] + np.average(values - values[0], weights=weights)  # differences keep the last digits
    error = errors.min() / np.sqrt(weights.sum())
    alone = n == 1
    chi2_dof = math.nan if alone else np.sum(((values - mean) / errors) ** 2) / (n - 1)
    scatter = math.nan if alone else np.std(values, ddof=1)
    numbers = (mean, error, np.median(errors), scatter, chi2_dof, error * np.sqrt(chi2_dof))
    return {"n": n} | {name: float(value) for name, value in zip(COMBINED, numbers, strict=True)}


def running_mean(values: np.ndarray, errors: np.ndarray) -> dict[str, np.ndarray]:
    """Combine the first measurement, the first two, and so on.

    Parameters
    ----------
    values, errors : (n,) arrays
        Finite; errors positive.

    Returns
    -------
    combined : dict of (n,) arrays
        ``mean``, ``error``, ``chi2_dof`` and ``error_by_scatter``, as :func:`weighted_mean` has them of so
        many; the last two NaN of one.
    """
    values, errors = np.asarray(values, float), np.asarray(errors, float)
    level = float(np.average(values, weights=errors**-2))  # differences keep the last digits
    weight, first, second = (np.cumsum(errors**-2 * (values - level) ** k) for k in range(3))
    count = np.arange(len(values))
    with np.errstate(invalid="ignore", divide="ignore"):
        chi2_dof = np.maximum(second - first**2 / weight, 0) / count
    error = weight**-0.5
    mean = level + first / weight
    return {"mean": mean, "error": error, "chi2_dof": chi2_dof, "error_by_scatter": error * np.sqrt(chi2_dof)}
