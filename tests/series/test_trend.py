from dataclasses import replace

import numpy as np
import pytest
from refusals import refused
from scipy.stats import kstest, linregress

from jitterkit.errors import ErrorCode
from jitterkit.series import Series, fit_floor, fit_trend, simulate_flicker


@pytest.fixture
def times(rng):
    return 2.46e6 + np.sort(rng.uniform(0, 300, 60))


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_the_fit_and_its_errors_are_those_of_weighted_least_squares(degree, times, rng):
    errors = rng.uniform(0.5, 3, 60)
    y = 10 + 0.01 * (times - times[0]) + errors * rng.standard_normal(60)
    fit = fit_trend(Series.of(y, errors, times), degree)
    x = (times - times.mean()) / 100
    expected, covariance = np.polyfit(x, y, degree, w=1 / errors, cov="unscaled")
    powers = np.vander(x, degree + 1)
    np.testing.assert_allclose(fit.at(times), powers @ expected, rtol=1e-9)
    np.testing.assert_allclose(
        fit.error_at(times), np.sqrt(np.einsum("ij,jk,ik->i", powers, covariance, powers))
    )
    assert fit.chi2 == pytest.approx(np.sum(((y - powers @ expected) / errors) ** 2))
    assert fit.dof == 59 - degree


def test_mean_and_slope_hold_at_the_epoch_whatever_the_degree(times, rng):
    errors = rng.uniform(0.5, 3, 60)
    y = 10 + errors * rng.standard_normal(60) + 1e-4 * (times - times[0]) ** 2
    series = Series.of(y, errors, times)
    line, cubic = fit_trend(series, 1), fit_trend(series, 3)
    expected, covariance = np.polyfit(times - line.epoch, y, 1, w=1 / errors, cov="unscaled")
    np.testing.assert_allclose([line.slope, line.mean], expected)
    np.testing.assert_allclose([line.slope_error, line.mean_error], np.sqrt(np.diag(covariance)))
    assert abs(covariance[0, 1]) < 1e-9 * np.sqrt(covariance[0, 0] * covariance[1, 1])
    assert line.mean == pytest.approx(np.average(y, weights=errors**-2))
    np.testing.assert_allclose(cubic.terms[:2], line.terms, rtol=1e-9)
    assert (cubic.slope, cubic.mean) == pytest.approx((line.slope, line.mean))


@pytest.mark.parametrize("stated", [True, False])
def test_chances_of_white_noise_are_uniform(stated, times, rng):
    fits = [
        fit_trend(Series.of(2 * rng.standard_normal(8), 2.0 if stated else None, times[:8]), 2)
        for _ in range(400)
    ]
    assert kstest([fit.p_value for fit in fits], "uniform").pvalue > 1e-3
    assert kstest([fit.chances[2] for fit in fits], "uniform").pvalue > 1e-3


def test_without_errors_the_chance_is_students(times, rng):
    y = rng.standard_normal(9) + 0.1 * np.arange(9)
    fit, expected = fit_trend(Series.of(y, times=times[:9])), linregress(times[:9] - times[0], y)
    assert fit.p_value == pytest.approx(expected.pvalue)
    assert fit.slope_error == pytest.approx(expected.stderr)


def test_white_noise_as_fitted_goes_before_the_errors_stated(rng):
    series = Series.of(2 * rng.standard_normal(500), np.linspace(0.5, 1.5, 500))
    louder = replace(fit_floor(series), floor=0.0, scale=2.0)
    assert fit_trend(series, noise=louder).slope_error == pytest.approx(2 * fit_trend(series).slope_error)


def test_a_planet_is_reported(rng):
    t = np.linspace(0, 3600, 5000)
    y = 10 + 465e-6 * rng.standard_normal(5000) + 1e-7 * t
    fit = fit_trend(Series.of(y, 465e-6, t))
    assert fit.p_value < 1e-6
    assert fit.slope == pytest.approx(1e-7, abs=4 * fit.slope_error)
    assert fit.slope_error == pytest.approx(465e-6 / np.sqrt(5000) / (3600 / np.sqrt(12)), rel=0.01)
    assert fit.epoch == pytest.approx(1800)


def test_with_a_floor_slopes_have_the_error_that_flicker_gives_them(rng):
    draws, n, level = 200, 500, 3.0
    floor = replace(fit_floor(Series.of(rng.standard_normal(n), 1.0)), white=1.0, scale=1.0, floor=level)
    pulls, blind, errors = [], [], []
    for _ in range(draws):
        series = Series.of(rng.standard_normal(n) + simulate_flicker(n, level, rng), 1.0)
        fit = fit_trend(series, 3, noise=floor)
        pulls.append(fit.terms[1:] / np.sqrt(np.diag(fit.covariance)[1:]))
        blind.append(fit_trend(series).p_value)
        errors.append(fit.p_value)
    assert fit.chi2 / fit.dof > 1.5  # flicker in the residuals
    np.testing.assert_allclose(np.std(pulls, axis=0), 1, atol=4 / np.sqrt(2 * draws))
    assert kstest(errors, "uniform").pvalue > 1e-3
    assert np.median(blind) < 1e-3
    assert fit.mean_error == pytest.approx(floor.deviation(n))


def test_with_a_walk_slopes_have_the_error_that_it_gives_them(rng):
    draws, n, step = 300, 400, 0.5
    floor = fit_floor(Series.of(rng.standard_normal(n), 1.0))
    # of steps of s the Allan variance is s²/3 times the length
    walk = replace(floor, white=1.0, scale=1.0, floor=0.2, walk=step / np.sqrt(3))
    pulls = []
    for _ in range(draws):
        y = rng.standard_normal(n) + np.cumsum(step * rng.standard_normal(n)) + simulate_flicker(n, 0.2, rng)
        fit = fit_trend(Series.of(y, 1.0), 2, noise=walk)
        pulls.append(fit.terms[1:] / np.sqrt(np.diag(fit.covariance)[1:]))
    np.testing.assert_allclose(np.std(pulls, axis=0), 1, atol=4 / np.sqrt(2 * draws))
    assert fit.mean_error == pytest.approx(walk.deviation(n))


def test_what_is_no_trend_is_refused(times, rng):
    with refused(ErrorCode.OUT_OF_RANGE, 4, "0 to 3"):
        fit_trend(Series.of(rng.standard_normal(60)), 4)
    with refused(ErrorCode.TOO_FEW, 4, 3):
        fit_trend(Series.of(rng.standard_normal(4)), 3)
