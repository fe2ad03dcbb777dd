"""What a length, an angle and their errors become."""

import numpy as np
import pytest

from jitterkit.extended.spectrum import streak_estimate


def moments(length, angle):
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    return length**2 / 12 * np.array([c * c, c * s, s * s])


@pytest.mark.parametrize("angle", [0.0, 27.0, 115.0])
def test_errors_of_the_moments_follow_from_those_of_the_streaks_end(angle):
    length, along, across, scale = 20.0, 0.3, 0.2, 0.5
    found = streak_estimate(length, angle, "blind", (along, across), scale)
    # central differences, exact to 1e-6 of themselves at these steps; beyond first order only 1e-5 is added
    h = 1e-3
    slopes = [
        (moments(length + h, angle) - moments(length - h, angle)) / (2 * h),
        (moments(length, angle + np.degrees(h / length)) - moments(length, angle - np.degrees(h / length)))
        / (2 * h),
    ]
    expected = sum(e**2 * np.outer(slope, slope) for e, slope in zip((along, across), slopes, strict=True))
    assert found.covariance / scale**4 == pytest.approx(expected, rel=1e-5, abs=2e-4)
    assert found.moments == pytest.approx(scale**2 * moments(length, angle), rel=1e-12)


def test_across_a_streak_the_moments_are_uncertain_to_second_order(rng):
    # an end off by b across has a variance of b²/12 across; of b² about zero the rms is sqrt(3) that of b's
    # error squared.  The two errors of the end count alike, so that at 0.2 each it is off by sqrt(4/3).
    found = streak_estimate(20.0, 0.0, "blind", (0.2, 0.2), 1.0)
    drawn = rng.normal(0, 0.2, 20_000) ** 2 / 12
    assert found.errors[2] == pytest.approx(np.sqrt(4 / 3) * np.sqrt(np.mean(drawn**2)), rel=0.05)


def test_what_was_not_measured_is_not_given():
    found = streak_estimate(20.0, 30.0, "blind", (0.3, 0.2), 1.0)
    assert np.isnan(found.shape)  # a streak is assumed: its locus says so
    assert np.isnan(found.shape_err)
    assert found.source == ""  # an image does not know its name
    assert found.locus.describe() == pytest.approx({"length": 20.0, "angle": 30.0})
