"""The motion of an image, by its places and by telemetry."""

from __future__ import annotations

import numpy as np
import pytest
from refusals import refused

from jitterkit.errors import ErrorCode
from jitterkit.joint.velocity import (
    motion_unknown,
    smear_allowed,
    unexplained_by_trace,
    velocity_between_frames,
    velocity_from_trace,
)


def test_a_uniform_drift_has_its_velocity_even_with_gaps():
    times = np.array([0.0, 0.1, np.nan, 0.5, 0.6])
    positions = np.column_stack([2.0 * times, -3.0 * times])
    found = velocity_between_frames(times, positions)
    assert np.allclose(found[[0, 1, 3, 4]], [2.0, -3.0])
    assert np.all(np.isnan(found[2]))


def test_one_frame_alone_stands_still():
    assert np.array_equal(velocity_between_frames([0.5], [[1.0, 2.0]]), [[0.0, 0.0]])


def test_places_that_jump_about_say_nothing_of_the_velocity(rng):
    times = 0.1 * np.arange(4000)
    positions = 0.05 * rng.standard_normal((4000, 2))
    # frames that stand still while exposed: the velocity that is found is all error
    error = velocity_between_frames(times, positions)[1:-1].std()
    assert motion_unknown(times, positions) == pytest.approx(error, rel=0.03)


def test_a_straight_drift_is_known():
    times = 0.1 * np.arange(50)
    assert motion_unknown(times, np.column_stack([times, 2 * times])) < 1e-12


def test_telemetry_is_averaged_over_each_exposure():
    t = np.linspace(0, 1, 1001)
    # of sin(2 pi t) over [a, b] the mean velocity is (sin 2 pi b - sin 2 pi a)/(b - a)
    times = np.array([0.2, np.nan, 0.7])
    found = velocity_from_trace((t, np.sin(2 * np.pi * t), 0 * t), times, 0.2)
    expected = [(np.sin(2 * np.pi * (m + 0.1)) - np.sin(2 * np.pi * (m - 0.1))) / 0.2 for m in (0.2, 0.7)]
    assert np.allclose(found[[0, 2], 0], expected, atol=1e-3)
    assert np.array_equal(found[1], [0.0, 0.0])


def test_each_exposure_has_its_own_length():
    t = np.linspace(0, 2, 2001)
    found = velocity_from_trace((t, np.sin(2 * np.pi * t), 0 * t), [1.0, 1.0], [0.5, 1.0])
    assert np.allclose(
        found[:, 0], [4.0, 0.0], atol=1e-3
    )  # sin(pi/2) - sin(-pi/2) in half a period; none in one


def test_telemetry_with_a_gap_in_an_exposure_is_refused():
    t = np.linspace(0, 1, 1001)
    t = t[(t < 0.4005) | (t > 0.5995)]
    trace = (t, np.sin(t), t)
    assert velocity_from_trace(trace, [0.2, 0.8], 0.2).shape == (2, 2)
    with refused(ErrorCode.OUT_OF_RANGE, "0.4", "0.6 s"):
        velocity_from_trace(trace, [0.2, 0.65], 0.2)


@pytest.mark.parametrize(("signs", "missed"), [((1, 1), 0.0), ((-1, -1), 2.0), ((1, -1), np.sqrt(2))])
def test_telemetry_with_a_wrong_sign_misses_the_motion_between_frames(signs, missed):
    """A drift of (1, 1) arcsec/s that shakes at 660 Hz: opposite signs are off by twice the speed."""
    t, times = np.linspace(0, 1, 5001), 0.1 * np.arange(1, 10)
    shaken = 0.05 * np.sin(2 * np.pi * 660 * t)
    trace = (t, signs[0] * t + shaken, signs[1] * t - shaken)
    positions = np.column_stack([3.0 + times, times - 2.0])
    assert unexplained_by_trace(trace, times, positions, 0.05) == pytest.approx(missed, abs=2e-3)
    assert unexplained_by_trace(trace, times[:1], positions[:1], 0.05) == 0


def test_a_blur_allows_motion_up_to_three_of_its_errors_along_it():
    """A larger error across it does not: steps between exposures were taken for motion, 13 errors off."""
    errors = [1e-3, 5e-3, 9e-3]
    assert smear_allowed(np.zeros(3), errors, [2.0, 0.0]) == pytest.approx(np.sqrt(12 * 3e-3))
    assert smear_allowed([4e-3, 0.0, 0.0], errors, [2.0, 0.0]) == pytest.approx(np.sqrt(12 * 7e-3))
    assert smear_allowed([np.nan, 0.0, 0.0], errors, [2.0, 0.0]) == np.inf
