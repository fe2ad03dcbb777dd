import numpy as np
import pytest
from refusals import refused

from jitterkit.errors import ErrorCode
from jitterkit.series import Series, find_outliers


@pytest.mark.parametrize("n", [25, 400])
def test_a_normal_series_has_flags_no_more_often_than_said(n, rng):
    flagged = [find_outliers(Series.of(rng.standard_normal(n)), expected=0.1).flags.any() for _ in range(400)]
    assert 0.1 - 4 * 0.015 < np.mean(flagged) < 0.1 + 4 * 0.015


def test_several_on_one_side_do_not_hide_each_other(rng):
    y = rng.standard_normal(200)
    bad = np.arange(3, 200, 7)  # 29, of which the plain standard deviation is 3.7
    y[bad] += 9
    found = find_outliers(Series.of(y, 1.0))
    np.testing.assert_array_equal(np.flatnonzero(found.flags), bad)
    assert found.scale == pytest.approx(1, abs=4 / np.sqrt(2 * 171))
    assert found.pulls[~found.flags].std(ddof=1) == pytest.approx(1, rel=1e-6)
    assert found.pulls[bad].mean() == pytest.approx(9, abs=1.2)


def test_many_at_one_end_turn_no_trend(rng):
    y = rng.standard_normal(200)
    bad = np.arange(130, 200, 4)
    y[bad] += 15
    found = find_outliers(Series.of(y, 1.0))
    # ends of a line through 182 points: good to 2/sqrt(182), which is 0.15
    assert np.abs(found.trend[[0, -1]]).max() < 3 * 0.15
    np.testing.assert_array_equal(np.flatnonzero(found.flags), bad)


def test_what_is_far_depends_on_its_own_error(rng):
    errors = np.ones(100)
    errors[[10, 20]] = 0.1, 10.0
    y = errors * rng.standard_normal(100)
    y[[10, 20]] += 3.0
    assert list(np.flatnonzero(find_outliers(Series.of(y, errors)).flags)) == [10]


def test_errors_too_small_by_one_factor_flag_nothing(rng):
    found = find_outliers(Series.of(3 * rng.standard_normal(500), 1.0))
    assert not found.flags.any()
    assert found.scale == pytest.approx(3, abs=3 * 4 / np.sqrt(1000))


def test_a_steep_trend_is_no_outlier_and_hides_none(rng):
    t = 1e5 + np.arange(300.0)
    y = rng.standard_normal(300) + 5 * t
    y[299] -= 12
    found = find_outliers(Series.of(y, 1.0, t))
    assert list(np.flatnonzero(found.flags)) == [299]
    np.testing.assert_allclose(found.trend, 5 * t, atol=0.5)


def test_missing_measurements_keep_their_places(rng):
    y = rng.standard_normal(50)
    y[[3, 30]] = np.nan
    y[40] = 30.0
    found = find_outliers(Series.of(y))
    assert list(np.flatnonzero(found.flags)) == [40]
    assert np.isnan(found.pulls[[3, 30]]).all()
    assert np.isnan(found.scale)  # no errors were stated
    left = Series.of(y).without(found.flags)
    assert left.good.sum() == 47


def test_the_limit_is_the_normal_laws_for_many():
    # of 20,000 one in 0.01/20,000 on two sides: 5.03 sigma; a scale of its own adds 1/n
    y = np.random.default_rng(1).standard_normal(20_000)
    assert find_outliers(Series.of(y)).limit == pytest.approx(5.026, abs=5e-3)


def test_a_series_without_scatter_but_for_one_has_one_outlier():
    y = 2.0 * np.arange(40)
    y[12] += 1.0
    assert list(np.flatnonzero(find_outliers(Series.of(y)).flags)) == [12]


def test_an_absurd_value_hides_no_other(rng):
    y = rng.standard_normal(200)
    y[[50, 51]] = 1e12, 15.0
    assert list(np.flatnonzero(find_outliers(Series.of(y)).flags)) == [50, 51]


def test_a_few_measurements_do_not_decide(rng):
    with refused(ErrorCode.TOO_FEW, 14, 15):
        find_outliers(Series.of(rng.standard_normal(14)))
