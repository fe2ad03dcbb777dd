import numpy as np
import pytest
from refusals import refused

from jitterkit.errors import ErrorCode
from jitterkit.series import Series, find_period


def test_a_period_is_found_with_its_amplitude(rng):
    t = np.sort(rng.uniform(0, 1000, 800)) + 5e4
    y = 10 + 0.01 * t + 0.5 * np.sin(2 * np.pi * t / 37.0 + 1) + rng.standard_normal(800)
    found = find_period(Series.of(y, 1.0, t, cadence=1.0))
    # error of a frequency: sqrt(6/n) e/(pi span amplitude) (Bretthorst)
    error = 37**2 * np.sqrt(6 / 800) * 1 / (np.pi * 1000 * 0.5)
    assert found.period == pytest.approx(37, abs=4 * error)
    assert found.amplitude == pytest.approx(0.5, abs=4 * found.amplitude_error)
    assert found.amplitude_error == pytest.approx(np.sqrt(2 / 800))
    assert found.false_alarm < 1e-6


def test_white_noise_has_a_period_no_more_often_than_said(rng):
    alarms = [find_period(Series.of(rng.standard_normal(120), 2.0)).false_alarm < 0.1 for _ in range(200)]
    assert 0.02 < np.mean(alarms) < 0.1 + 4 * 0.021


def test_a_trend_is_no_period(rng):
    y = rng.standard_normal(300) + 0.05 * np.arange(300)
    assert find_period(Series.of(y)).false_alarm > 0.01
    assert find_period(Series.of(y), degree=0).false_alarm < 1e-6


def test_without_errors_the_scatter_is_the_amplitudes_error(rng):
    y = 3 * rng.standard_normal(400)
    assert find_period(Series.of(y)).amplitude_error == pytest.approx(3 * np.sqrt(2 / 400), rel=0.15)


def test_a_trend_takes_degrees_of_freedom_from_the_scatter(rng):
    squares = [
        find_period(Series.of(3 * rng.standard_normal(12)), degree=2).amplitude_error ** 2 for _ in range(300)
    ]
    # nine degrees of freedom are left: a mean of 300 scatters by 2.7 %, and of twelve it would be 25 % less
    assert np.mean(squares) == pytest.approx(9 * 2 / 12, rel=4 * np.sqrt(2 / (9 * 300)))


def test_what_shows_no_period_is_refused(rng):
    with refused(ErrorCode.TOO_FEW, 7, 6, 2):
        find_period(Series.of(rng.standard_normal(7)))
    with refused(ErrorCode.OUT_OF_RANGE, 50, 49, 100):
        find_period(Series.of(rng.standard_normal(50)), shortest=100.0)
