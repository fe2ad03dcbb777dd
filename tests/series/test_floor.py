import numpy as np
import pytest
from refusals import refused

from jitterkit.errors import ErrorCode
from jitterkit.series import Series, fit_floor, simulate_flicker

WHITE = 465e-6


def white(n, rng, stated=WHITE):
    return Series.of(WHITE * rng.standard_normal(n), stated, 0.1 * np.arange(n))


@pytest.mark.parametrize("known", [False, True])
def test_white_noise_has_a_floor_no_more_often_than_said(known, rng):
    fits = [fit_floor(white(256, rng), known_errors=known, false_alarm=0.1) for _ in range(300)]
    alarms = np.mean([fit.detected for fit in fits])
    # one in ten is 30 ± 5 of 300; small series have fewer: 4 sigma above, and some there must be
    assert 0.02 < alarms < 0.1 + 4 * 0.0173
    assert [fit.detected for fit in fits] == [fit.p_value < 0.1 for fit in fits]


def test_a_floor_is_found_without_bias_and_with_an_honest_error(rng):
    n, level, draws = 6000, 60e-6, 80
    fits = [
        fit_floor(Series.of(WHITE * rng.standard_normal(n) + simulate_flicker(n, level, rng), WHITE))
        for _ in range(draws)
    ]
    pulls = np.array([(fit.floor - level) / fit.error for fit in fits])
    assert abs(pulls.mean()) < 4 / np.sqrt(draws)
    assert 1 - 4 / np.sqrt(2 * draws) < pulls.std() < 1 + 4 / np.sqrt(2 * draws)
    assert np.mean([fit.upper > level for fit in fits]) == pytest.approx(0.95, abs=4 * 0.025)
    assert np.mean([fit.detected for fit in fits]) > 0.95
    scale = np.array([(fit.scale - 1) / fit.scale_error for fit in fits])
    assert scale.std() == pytest.approx(1, abs=4 / np.sqrt(2 * draws))
    # (465/60)²: the floor's error, 6 %, is the square's half
    assert np.median([fit.meets for fit in fits]) == pytest.approx((465 / 60) ** 2, rel=0.1)


def test_gaps_and_unequal_errors_move_no_floor(rng):
    n, level, draws = 4000, 60e-6, 40
    found = []
    for _ in range(draws):
        errors = WHITE * np.exp2(rng.uniform(-1, 1, n))
        values = errors * rng.standard_normal(n) + simulate_flicker(n, level, rng)
        values[(rng.random(n) < 0.2) | (np.arange(n) // 500 == 3)] = np.nan
        fit = fit_floor(Series.of(values, errors))
        found.append((fit.floor - level) / fit.error)
    assert abs(np.mean(found)) < 4 / np.sqrt(draws)
    assert np.std(found) == pytest.approx(1, abs=4 / np.sqrt(2 * draws))


def test_errors_too_small_are_no_floor(rng):
    fit = fit_floor(white(20_000, rng, stated=WHITE / 1.1))
    assert fit.scale == pytest.approx(1.1, abs=4 * fit.scale_error)
    assert fit.scale_error == pytest.approx(1.1 / np.sqrt(2 * 20_000), rel=0.05)
    assert not fit.detected
    assert fit_floor(white(20_000, rng, stated=WHITE / 1.1), known_errors=True).detected


def test_without_errors_the_white_level_is_found(rng):
    fit = fit_floor(Series.of(3.0 * rng.standard_normal(5000)))
    assert fit.white == pytest.approx(3, abs=4 * fit.white_error)


def test_a_trend_is_no_floor(rng):
    y = WHITE * rng.standard_normal(3000) + 3e-6 * np.arange(3000)
    assert not fit_floor(Series.of(y, WHITE)).detected
    assert fit_floor(Series.of(y, WHITE), degree=0).detected
    assert not fit_floor(Series.of(y + 1e-9 * np.arange(3000) ** 2, WHITE), degree=2).detected


def test_a_walk_is_distinguished_from_a_floor(rng):
    n, step = 6000, 20e-6
    walk = step * np.cumsum(rng.standard_normal(n))
    fit = fit_floor(Series.of(WHITE * rng.standard_normal(n) + walk, WHITE), walk=True)
    assert fit.p_walk < 1e-3
    # of steps of s the Allan variance is s² (2 m² + 1)/(6 m): s²/3 times the length
    assert fit.walk == pytest.approx(step / np.sqrt(3), abs=4 * fit.walk_error)
    lengths = np.array([1.0, 10.0, 1000.0])
    law = np.sqrt(fit.white**2 / lengths + fit.floor**2 + fit.walk**2 * lengths)
    np.testing.assert_allclose(fit.deviation(lengths), law)
    flicker = WHITE * rng.standard_normal(n) + simulate_flicker(n, 60e-6, rng)
    assert fit_floor(Series.of(flicker, WHITE)).p_walk > 1e-3


def test_no_floor_has_an_upper_limit_that_a_floor_there_would_have_raised(rng):
    fit = next(f for f in (fit_floor(white(4000, rng)) for _ in range(20)) if f.floor == 0)
    assert np.isnan(fit.error)
    assert fit.meets == np.inf
    assert fit.p_value == 1
    n, level = 4000, 3 * fit.upper
    louder = fit_floor(Series.of(WHITE * rng.standard_normal(n) + simulate_flicker(n, level, rng), WHITE))
    assert louder.detected
    # of one amount that cannot be negative the likelihood ratio is the square of a one-sided deviate
    assert louder.significance == pytest.approx(np.sqrt(louder.ratio), rel=1e-6)
    assert louder.significance > 3


def test_a_unit_is_no_matter(rng):
    y = rng.standard_normal(500) + simulate_flicker(500, 0.4, rng)
    small, large = fit_floor(Series.of(y, 1.0)), fit_floor(Series.of(1e6 * y + 7e9, 1e6))
    assert large.floor == pytest.approx(1e6 * small.floor, rel=1e-4)
    assert large.upper == pytest.approx(1e6 * small.upper, rel=1e-2)
    assert large.ratio == pytest.approx(small.ratio, abs=1e-3)


def test_what_shows_no_floor_is_refused(rng):
    with refused(ErrorCode.TOO_FEW, 15, 16):
        fit_floor(white(15, rng))
    with refused(ErrorCode.MISSING_VALUE):
        fit_floor(Series.of(rng.standard_normal(50)), known_errors=True)
