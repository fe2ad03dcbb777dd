import numpy as np
import pytest
from refusals import refused

from jitterkit.errors import ErrorCode
from jitterkit.series import simulate_flicker


def allan_variance(values, length):
    blocks = values[: len(values) // length * length].reshape(-1, length).mean(axis=1)
    return np.mean(np.diff(blocks) ** 2) / 2


def test_flicker_has_its_level_at_every_averaging_length(rng):
    lengths, draws = (1, 2, 7, 32, 128, 500), 300
    series = [simulate_flicker(2000, 3.0, rng) for _ in range(draws)]
    found = np.array([[allan_variance(one, length) for length in lengths] for one in series])
    error = found.std(axis=0) / np.sqrt(draws)
    assert np.all(np.abs(found.mean(axis=0) - 9) < 4 * error)
    assert error.max() < 1.2  # so that the line above says something of the longest


def test_far_neighbours_depart_by_the_logarithm_of_their_distance(rng):
    # of contiguous means the variance of a difference over k steps grows as level² ln(k)/ln(2)
    series = np.array([simulate_flicker(1001, 1.0, rng) for _ in range(2000)])
    near, far = (np.var(series[:, k] - series[:, 0]) for k in (10, 1000))
    expected = np.log(100) / np.log(2)
    assert far - near == pytest.approx(expected, abs=4 * far * np.sqrt(2 / 2000))


def test_one_seed_is_one_series():
    one, same = (simulate_flicker(100, 1.0, np.random.default_rng(4)) for _ in range(2))
    np.testing.assert_array_equal(one, same)
    assert np.ptp(simulate_flicker(50, 0.0, np.random.default_rng(4))) == 0


def test_what_cannot_be_drawn_is_refused(rng):
    with refused(ErrorCode.OUT_OF_RANGE, "1 values"):
        simulate_flicker(1, 1.0, rng)
    with refused(ErrorCode.OUT_OF_RANGE, 9, -1):
        simulate_flicker(9, -1.0, rng)
