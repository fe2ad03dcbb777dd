"""Means over stretches of time are those of their frames, and honest where errors are not."""

import numpy as np
import pytest

from jitterkit.report.means import running_mean, stretch_index, stretch_means, weighted_mean


def test_stretches_divide_time_evenly_and_hold_both_ends():
    np.testing.assert_array_equal(stretch_index(np.array([5.0, 6.0, 9.9, 10.0, 15.0]), 2), [0, 0, 0, 1, 1])
    np.testing.assert_array_equal(stretch_index(np.array([3.0, 3.0]), 4), [0, 0])


def test_a_stretch_has_the_weighted_mean_of_its_frames(rng):
    at, errors = np.sort(rng.uniform(0, 1, 500)), rng.uniform(1, 3, 500)
    values = 8.1 + errors * rng.standard_normal(500)
    means = stretch_means(at, values, errors, 10)
    assert means.counts.sum() == 500
    for k in range(10):
        inside = (at >= at[0] + k * np.ptp(at) / 10) & (at < at[0] + (k + 1) * np.ptp(at) / 10 + (k == 9))
        combined = weighted_mean(values[inside], errors[inside])
        assert (means.values[k], means.errors[k]) == pytest.approx((combined["mean"], combined["error"]))
        assert means.at[k] == pytest.approx(np.average(at[inside], weights=errors[inside] ** -2))


def test_errors_that_are_too_small_are_widened_by_chi_squared_over_its_degrees_of_freedom(rng):
    at = np.repeat(np.arange(4.0), 2)
    squares = [stretch_means(at, 10 * rng.standard_normal(8), np.ones(8), 4).widened ** 2 for _ in range(300)]
    # two frames in each of four stretches leave four degrees of freedom; the mean of 300 scatters by 4 %
    assert np.mean(squares) == pytest.approx(100, rel=4 * np.sqrt(2 / (4 * 300)))


def test_empty_stretches_are_left_out():
    means = stretch_means(np.array([0.0, 0.1, 9.9, 10.0]), np.ones(4), np.ones(4), 10)
    np.testing.assert_array_equal(means.counts, [2, 2])


@pytest.mark.parametrize("factor", [0.5, 1.0, 2.0])
def test_errors_are_widened_by_a_scatter_they_do_not_explain_and_never_narrowed(rng, factor):
    n, count = 20_000, 100
    values = factor * rng.standard_normal(n) + np.repeat(rng.standard_normal(count) * 50, n // count)
    means = stretch_means(np.arange(n) + 0.0, values, np.ones(n), count)
    # the root of chi2/dof scatters by 1/sqrt(2 (n - count)) = 0.5 %; changes between stretches are no noise
    assert means.widened == pytest.approx(max(factor, 1.0), rel=0.02)
    np.testing.assert_allclose(means.errors, means.widened / np.sqrt(n / count), rtol=1e-12)


def test_a_running_mean_is_the_mean_of_the_first(rng):
    errors = rng.uniform(1e-4, 3e-4, 40)
    values = 8.1 + errors * rng.standard_normal(40)
    running = running_mean(values, errors)
    for n in (2, 17, 40):
        combined = weighted_mean(values[:n], errors[:n])
        for name in ("mean", "error", "chi2_dof", "error_by_scatter"):
            assert running[name][n - 1] == pytest.approx(combined[name], rel=1e-9), name
    assert running["mean"][0] == pytest.approx(values[0], abs=1e-15)
    assert np.isnan(running["chi2_dof"][0])
