"""A measured frame: what its table shows beside the moments."""

from pathlib import Path

import numpy as np
import pytest

from jitterkit.batch.records import BlurMeasurement
from jitterkit.frames import Frame
from jitterkit.kernel_estimate import KernelEstimate
from jitterkit.loci import Linear

FRAME = Frame(np.ones((8, 8)), 1.0, path=Path("night.fits"), index=2, several=True)


def estimate(locus, covariance, source=""):
    return KernelEstimate(np.asarray(locus.moments()), covariance, "blind", source, locus=locus)


def test_errors_of_length_and_angle_are_those_of_streaks_whose_moments_scatter(rng):
    streak, covariance = Linear.of(2.0, 118.0), np.array([[3, 1, 0.5], [1, 2, -0.4], [0.5, -0.4, 4]]) * 1e-6
    measured = BlurMeasurement.from_estimate(FRAME, estimate(streak, covariance), 1.0, list)
    # along its axis a streak has L²/12; its axis is that of the moments
    drawn = rng.multivariate_normal(np.asarray(streak.moments()), covariance, 4000)
    values, vectors = np.linalg.eigh(drawn[:, [0, 1, 1, 2]].reshape(-1, 2, 2))
    length = np.sqrt(12 * values[:, 1])
    angle = np.degrees(np.arctan2(vectors[:, 1, 1], vectors[:, 0, 1])) % 180
    tolerance = 4 / np.sqrt(2 * 4000)  # of a standard deviation of 4000 draws, four times
    assert measured.length == pytest.approx(2.0)
    assert measured.length_err == pytest.approx(length.std(), rel=tolerance)
    assert measured.angle_err == pytest.approx(angle.std(), rel=tolerance)


@pytest.mark.parametrize(("moments", "spread"), [((1e-4, 0.0, -5e-4), 6e-4), ((-1e-4, 0.0, -2e-4), 1e-4)])
def test_a_variance_below_zero_is_one_for_the_axis_too(moments, spread):
    # turned by da, (a, 0, b) gains a cross moment of (a - b) da, whatever the signs
    noisy = KernelEstimate(np.array(moments), np.diag([4e-6, 1e-5, 4e-6]) ** 2, "score")
    found = BlurMeasurement.from_estimate(FRAME, noisy, 1.0, list).angle_err
    assert found == pytest.approx(np.degrees(1e-5 / spread), rel=1e-9)


def test_a_streak_whose_own_variance_is_below_zero_has_no_error_of_its_length():
    noisy = KernelEstimate(np.array([-1e-4, 0, -2e-4]), np.eye(3) * 1e-10, "score", locus=Linear.of(0.1))
    assert np.isnan(BlurMeasurement.from_estimate(FRAME, noisy, 1.0, list).length_err)


@pytest.mark.parametrize("error", [1e-3, 1e3])
def test_the_axis_of_a_round_kernel_is_any(error):
    # the standard deviation of an angle that is anything from -90 to 90 degrees
    round_ = KernelEstimate(np.array([2.0, 0.0, 2.0]), np.eye(3) * error**2, "score")
    assert BlurMeasurement.from_estimate(FRAME, round_, 1.0, list).angle_err == pytest.approx(
        180 / np.sqrt(12)
    )


def test_an_estimate_that_does_not_say_where_it_is_from_is_of_its_frame():
    streak = Linear.of(2.0, 20.0)
    assert (
        BlurMeasurement.from_estimate(FRAME, estimate(streak, np.eye(3)), 1.0, list).estimate.source
        == "night.fits[2]"
    )
    named = estimate(streak, np.eye(3), "other.fits[0]")
    assert BlurMeasurement.from_estimate(FRAME, named, 1.0, list).estimate.source == "other.fits[0]"
