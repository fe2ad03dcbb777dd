"""The coefficients and the likelihood, against explicit matrices."""

import numpy as np
import pytest
from scipy.optimize import minimize

from jitterkit.series import Series, simulate_flicker
from jitterkit.series.components import fit_components, haar_coefficients
from jitterkit.series.laws import contrast_covariance


def as_matrix(errors, there):
    """The coefficients of each measurement alone, (k, n)."""

    def of(values):
        values = np.where(there, values, np.nan)
        # an offset at the median is taken off, to which differences are blind
        return haar_coefficients(Series.of(values, errors)).values

    still = np.arange(len(errors)) * 1e-300  # a series must vary
    return np.stack([of(still + one) - of(still) for one in np.eye(len(errors))[there]], axis=1)


def test_white_noise_gives_independent_coefficients_of_the_variance_said(rng):
    errors = rng.uniform(1, 5, 37)
    there = rng.random(37) < 0.7
    there[[0, -1]] = True
    matrix = as_matrix(errors, there)
    covariance = (matrix * errors[there] ** 2) @ matrix.T
    haar = haar_coefficients(Series.of(np.where(there, errors, np.nan), errors))
    assert len(matrix) == there.sum() - 1
    np.testing.assert_allclose(covariance, np.diag(haar.white), atol=1e-9)


@pytest.mark.parametrize("noise", ["flicker", "walk"])
def test_red_noise_gives_coefficients_of_the_variance_said(noise, rng):
    there = np.ones(43, bool)
    matrix = as_matrix(np.ones(43), there)
    haar = haar_coefficients(Series.of(rng.standard_normal(43)))
    np.testing.assert_allclose(np.diag(contrast_covariance(matrix.T, noise)), getattr(haar, noise), rtol=1e-9)


@pytest.mark.parametrize("noise", ["flicker", "walk"])
def test_of_series_with_gaps_the_variance_said_is_nearly_right(noise, rng):
    there = rng.random(256) < 0.6
    there[60:150] = False
    there[[0, -1]] = True
    full = np.zeros((there.sum() - 1, 256))
    full[:, there] = as_matrix(np.ones(256), there)
    haar = haar_coefficients(Series.of(np.where(there, rng.standard_normal(256), np.nan)))
    ratio = getattr(haar, noise) / np.diag(contrast_covariance(full.T, noise))
    assert np.abs(np.log(ratio)).max() < 0.3
    assert abs(np.log(ratio).mean()) < 0.05


def test_the_trend_is_taken_apart_with_the_series():
    n = 50
    time = np.linspace(-1, 1, n)
    errors = np.linspace(1, 2, n)
    haar = haar_coefficients(Series.of(3 * time - 2 * time**2, errors), degree=2)
    np.testing.assert_allclose(haar.trend @ [3, -2], haar.values, atol=1e-12)


def restricted_likelihood(amounts, values, regressors, shapes):
    """The textbook's (Patterson & Thompson 1971), with whole matrices."""
    v = np.diag(amounts @ shapes)
    inverse = np.linalg.inv(v)
    information = regressors.T @ inverse @ regressors
    projected = inverse - inverse @ regressors @ np.linalg.inv(information) @ regressors.T @ inverse
    return -0.5 * (np.linalg.slogdet(v)[1] + np.linalg.slogdet(information)[1] + values @ projected @ values)


def test_the_fit_is_the_maximum_of_the_restricted_likelihood(rng):
    values = rng.standard_normal(200) + simulate_flicker(200, 0.5, rng)
    haar = haar_coefficients(Series.of(values), degree=2)
    shapes = np.stack([haar.white, haar.flicker, haar.walk])
    fit = fit_components(haar.values, haar.trend, shapes, np.ones(3), np.ones(3, bool))

    def loss(amounts):
        return -restricted_likelihood(amounts, haar.values, haar.trend, shapes)

    best = minimize(loss, [1.0, 0.3, 0.01], bounds=[(1e-6, None), (0, None), (0, None)], method="L-BFGS-B")
    assert fit.log_likelihood == pytest.approx(-loss(fit.amounts), abs=1e-9)
    assert fit.log_likelihood == pytest.approx(-best.fun, abs=1e-4)
    np.testing.assert_allclose(fit.amounts, best.x, atol=0.02)


def test_amounts_that_are_held_stay():
    values = np.random.default_rng(1).standard_normal(64)
    haar = haar_coefficients(Series.of(values))
    shapes = np.stack([haar.white, haar.flicker])
    fit = fit_components(haar.values, haar.trend, shapes, [1.0, 0.25], np.array([True, False]))
    assert fit.amounts[1] == 0.25
    assert fit.amounts[0] != 1.0
    assert fit.covariance[1, 1] == 0
