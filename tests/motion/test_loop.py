import numpy as np
import pytest
from refusals import refused

from jitterkit.errors import ErrorCode
from jitterkit.motion import Line, PowerSpectrum, close_loop, follow, loop_rejection, split_spectrum

MIX = np.array([1.0, -0.6, 2.0])


def test_a_loop_leaves_half_the_power_at_its_bandwidth_and_f_squared_below():
    np.testing.assert_allclose(loop_rejection([2.0, 2e-4, 2e4], 2.0), [0.5, 1e-8, 1], rtol=1e-7)


def test_a_loop_on_a_coarse_spectrum_is_integrated_exactly():
    exposure, slope = 0.1, -1.3
    spectrum = PowerSpectrum([0.05, 400.0], [1e-5 * f**slope * MIX for f in (0.05, 400.0)])
    left = split_spectrum(close_loop(spectrum, 3.0), exposure)
    f = np.geomspace(0.05, 400.0, 2_000_001)
    z = np.pi * f * exposure
    smear = 3 * (np.sin(z) - z * np.cos(z)) ** 2 / z**4
    for part, weight in ((left.displacement, np.sinc(f * exposure) ** 2), (left.smear, smear)):
        expected = np.trapezoid(1e-5 * f**slope * f**2 / (f**2 + 9) * weight, f) * MIX
        np.testing.assert_allclose(part, expected, rtol=3e-5)


def test_a_loop_takes_its_part_of_a_line():
    (line,) = close_loop(PowerSpectrum(lines=(Line(4.0, 0.2, 30.0, 0.1),)), 3.0).lines
    assert (line.amplitude, line.minor, line.angle) == pytest.approx((0.16, 0.08, 30.0))  # 4/5 of each


def test_following_a_record_leaves_the_power_that_the_rejection_says():
    f, bandwidth = 4.0, 3.0
    t = np.arange(0, 10, 1 / 4000)
    x, y = follow(t, 7 + np.sin(2 * np.pi * f * t), np.full_like(t, 5.0), bandwidth)
    settled = t >= 2  # e^-37 of the start is left, and 32 whole cycles
    assert np.mean(x[settled] ** 2) == pytest.approx(0.5 * f**2 / (f**2 + bandwidth**2), rel=1e-5)
    np.testing.assert_allclose(y, 0)


def test_following_a_ramp_lags_by_the_speed_over_the_turn_rate():
    t = np.array([0.0, 0.5, 0.7, 5.0])
    x, y = follow(t, 2 * t, -t, 1.0)
    np.testing.assert_allclose(x, 2 * (1 - np.exp(-2 * np.pi * t)) / (2 * np.pi), rtol=1e-12)
    np.testing.assert_allclose(y, -x / 2, rtol=1e-12)


@pytest.mark.parametrize("bandwidth", [0.0, -1.0, np.nan])
def test_a_bandwidth_that_cannot_be_is_refused(bandwidth):
    for act in (
        lambda: close_loop(PowerSpectrum(lines=(Line(1, 1),)), bandwidth),
        lambda: follow([0, 1], [0, 1], [0, 1], bandwidth),
    ):
        with refused(ErrorCode.OUT_OF_RANGE, f"{bandwidth:g} Hz"):
            act()
