import numpy as np
import pytest
from refusals import refused
from scipy import stats

from jitterkit.errors import ErrorCode
from jitterkit.series import Series, allan_deviation, block_scatter


def nbs_series():
    """The 1000 random numbers of the NBS test of 1987, from Lewis, Goodman & Miller's generator."""
    numbers = [1234567890]
    for _ in range(999):
        numbers.append(16807 * numbers[-1] % 2147483647)
    return np.array(numbers) / 2147483647


def test_the_published_answer_for_the_published_series():
    # Riley, NIST SP 1065 (2008), table 32: overlapping Allan deviation
    allan = allan_deviation(Series.of(nbs_series()), per_octave=28)
    at = [int(np.flatnonzero(allan.lengths == length)[0]) for length in (1, 10, 100)]
    np.testing.assert_allclose(allan.deviation[at], [2.922319e-01, 9.159953e-02, 3.241343e-02], rtol=2e-7)
    np.testing.assert_array_equal(allan.count[at], [999, 981, 801])


def test_a_drift_grows_as_its_length():
    allan = allan_deviation(Series.of(5 + 3.0 * np.arange(300)))
    np.testing.assert_allclose(allan.deviation, 3 * allan.lengths / np.sqrt(2), rtol=1e-9)
    assert np.isnan(allan.expected).all()


def test_intervals_of_white_noise_hold_its_law_as_often_as_they_say(rng):
    fits = [allan_deviation(Series.of(2 * rng.standard_normal(256), 2.0)) for _ in range(400)]
    law = 2 / np.sqrt(fits[0].lengths)
    np.testing.assert_allclose(fits[0].expected, law)
    inside = np.mean([(fit.low < law) & (law < fit.high) for fit in fits], axis=0)
    # 0.6827 of 400 draws is known to 0.023; overlapping squares are only nearly chi-squared
    np.testing.assert_allclose(inside, 0.6827, atol=4 * 0.023 + 0.03)


def test_a_walk_grows_as_the_root_of_its_length(rng):
    steps = np.array([np.cumsum(rng.standard_normal(1024)) for _ in range(200)])
    found = np.mean([allan_deviation(Series.of(one)).deviation ** 2 for one in steps], axis=0)
    m = allan_deviation(Series.of(steps[0])).lengths
    law = (2 * m**2 + 1) / (6 * m)  # of means of a walk that steps once a frame
    few = m <= 64
    # 200 series of 1024/m differences, each with an error of sqrt(2): 4 sigma
    np.testing.assert_allclose(found[few] / law[few], 1, atol=4 * np.sqrt(2 / (200 * 16)))


def test_the_expectation_of_the_errors_holds_with_gaps_and_unequal_errors(rng):
    errors = np.exp2(rng.uniform(-2, 2, 512))
    there = rng.random(512) < 0.6
    there[200:290] = False
    ratios = []
    for _ in range(200):
        fit = allan_deviation(Series.of(np.where(there, errors * rng.standard_normal(512), np.nan), errors))
        ratios.append((fit.deviation / fit.expected) ** 2)
    error = np.std(ratios, axis=0) / np.sqrt(200)
    assert np.all(np.abs(np.mean(ratios, axis=0) - 1) < 4.5 * error)
    assert np.all(error < 0.15)


def test_poor_measurements_spoil_nothing(rng):
    values, errors = rng.standard_normal(600), np.ones(600)
    clean = allan_deviation(Series.of(values, errors)).deviation
    values[::50] += 1000 * rng.standard_normal(12)
    errors[::50] = 1000
    np.testing.assert_allclose(
        allan_deviation(Series.of(values, errors)).deviation[:20], clean[:20], rtol=0.15
    )


def test_nothing_is_compared_over_a_gap_longer_than_the_length(rng):
    t = np.r_[np.arange(64), np.arange(64) + 10_000.0]
    y = np.r_[np.zeros(64), np.full(64, 7.0)] + 1e-9 * rng.standard_normal(128)
    fit = allan_deviation(Series.of(y, times=t))
    near = fit.lengths < 64
    assert fit.deviation[near].max() < 1e-8
    assert fit.count[0] == 126


def test_blocks_less_than_half_full_are_no_means_of_their_length(rng):
    t = np.r_[np.arange(100.0), np.arange(200.0, 300.0)]
    fit = allan_deviation(Series.of(rng.standard_normal(200), times=t))
    # of ten steps: 81 pairs within each run, and five more at the gap, whose outer block holds 9, ... 5
    assert fit.count[fit.lengths == 10] == 2 * (81 + 5)


def test_measurements_in_any_order_and_at_real_times_are_the_same_series(rng):
    values, errors = rng.standard_normal(200), rng.uniform(1, 2, 200)
    t = 2.46e6 + 0.1 * np.arange(200) + 0.01 * rng.uniform(-1, 1, 200)
    shuffled = rng.permutation(200)
    one = allan_deviation(Series.of(values, errors, cadence=0.1))
    two = allan_deviation(Series.of(values[shuffled], errors[shuffled], t[shuffled]))
    np.testing.assert_array_equal(one.lengths, two.lengths)
    np.testing.assert_allclose(one.deviation, two.deviation, rtol=1e-9)
    np.testing.assert_allclose(one.times, two.times, rtol=1e-3)


def test_block_means_of_white_noise_scatter_by_the_root_of_their_length(rng):
    fits = [block_scatter(Series.of(3 * rng.standard_normal(1000) + 10, 3.0)) for _ in range(600)]
    n = fits[0].lengths
    whole = 1000 % n == 0  # where no block is shorter than the others
    np.testing.assert_allclose(fits[0].expected[whole], 3 / np.sqrt(n[whole]), rtol=1e-12)
    ratios = np.array([(fit.scatter / fit.expected) ** 2 for fit in fits])
    np.testing.assert_allclose(ratios.mean(axis=0), 1, atol=4.5 * np.sqrt(2 / (4 * 600)))  # 5 blocks or more
    spread = np.std([fit.scatter for fit in fits], axis=0) / np.mean([fit.error for fit in fits], axis=0)
    # of 600 draws; of five blocks the normal law is off by a twentieth
    np.testing.assert_allclose(spread, 1, atol=4.5 / np.sqrt(2 * 600) + 0.05)


def test_the_scatter_of_five_blocks_is_as_uncertain_as_chi_of_four_degrees_of_freedom(rng):
    found = block_scatter(Series.of(rng.standard_normal(5)))
    exact = stats.chi(4).std() / np.sqrt(4)
    # the normal law is 3.6 % above that of chi; of five degrees of freedom it would be 7 % below
    assert found.error[0] / found.scatter[0] == pytest.approx(exact, rel=0.05)


def test_what_blocks_share_does_not_average(rng):
    shared = np.repeat(5 * rng.standard_normal(40), 64)
    fit = block_scatter(Series.of(shared + rng.standard_normal(2560), 1.0))
    at = int(np.flatnonzero(fit.lengths == 64)[0])
    assert fit.scatter[at] == pytest.approx(5, rel=4 / np.sqrt(2 * 39))
    assert fit.expected[at] == pytest.approx(1 / 8)


@pytest.mark.parametrize(
    ("arguments", "code", "values"),
    [
        (([1.0, 2.0, 3.0], [1.0, 2.0]), ErrorCode.WRONG_SHAPE, ["(3,)", "(2,)"]),
        (([1.0, 2.0, np.nan],), ErrorCode.TOO_FEW, [2]),
        (([1.0, 2.0, 3.0, 4.0], [1.0, 0.0, np.nan, 1.0]), ErrorCode.TOO_FEW, [2]),
        (([1.0, 2.0, 3.0], None, [0.0, 1.0, np.nan]), ErrorCode.MISSING_VALUE, [3, "nan"]),
        (([1.0, 2.0, 3.0], None, [5.0, 5.0, 5.0]), ErrorCode.TOO_FEW, [5]),
        (([4.0, 4.0, 4.0],), ErrorCode.UNSUPPORTED, [4]),
    ],
)
def test_what_is_no_series_is_refused(arguments, code, values):
    with refused(code, *values):
        Series.of(*arguments)


def test_a_cadence_is_shorter_than_the_series():
    with refused(ErrorCode.OUT_OF_RANGE, 8, 1.5):
        Series.of(np.arange(13.0), times=np.arange(13.0), cadence=8.0)


def test_a_cadence_is_long_enough_for_the_series():
    with refused(ErrorCode.OUT_OF_RANGE, "1e+09", 60):
        Series.of(np.arange(3.0), times=[0.0, 1.0, 1e9], cadence=1.0)


def test_nights_of_frames_stand_on_a_grid_of_a_million_steps(rng):
    t = np.concatenate([86400.0 * night + 0.1 * np.arange(200) for night in range(4)])
    series = Series.of(2 * rng.standard_normal(800), 2.0, t)
    assert series.cadence == pytest.approx((3 * 86400 + 19.9) / 2**20)
    weights, _ = series.gridded()
    assert weights.sum() == pytest.approx(800 / 4)
    assert allan_deviation(series).expected[0] == pytest.approx(2 / np.sqrt(series.cadence / 0.1), rel=0.3)


def test_measurements_in_one_step_are_one(rng):
    values, errors = rng.standard_normal(300), rng.uniform(1, 2, 300)
    pairs = np.repeat(np.arange(150.0), 2)
    together = Series.of(values, errors, pairs, cadence=1.0)
    weights = (errors**-2).reshape(150, 2)
    means = np.average(values.reshape(150, 2), axis=1, weights=weights)
    alone = Series.of(means, weights.sum(axis=1) ** -0.5)
    np.testing.assert_allclose(allan_deviation(together).deviation, allan_deviation(alone).deviation)


def test_a_cadence_is_positive():
    with refused(ErrorCode.OUT_OF_RANGE, -1):
        Series.of([1.0, 2.0, 3.0], cadence=-1.0)


def test_four_measurements_have_no_scatter_of_blocks():
    with refused(ErrorCode.TOO_FEW, "4 measurements", "4 steps", 5):
        block_scatter(Series.of([1.0, 2.0, 3.0, 5.0]))
    with refused(ErrorCode.TOO_FEW, "6 measurements", "3 steps", 5):
        block_scatter(Series.of([1.0, 2.0, 3.0, 5.0, 6.0, 4.0], times=[0.0, 0.0, 0.0, 0.0, 1.0, 2.0]))
