"""Trails of stars."""

import numpy as np
import pytest
from refusals import refused
from scipy import fft

from jitterkit.errors import ConfigurationError, ErrorCode, UndeterminedError
from jitterkit.extended import estimate_trail
from jitterkit.extended.trail import _weighted, find_trails

SIDE = 240


def trails(streaks, noise=3.0, seed=0):
    """Points of (x, y, electrons, length, angle) with a PSF of 1.2 pixels, exactly smeared, on 100 counts."""
    fy, fx = fft.fftfreq(SIDE)[:, None], fft.rfftfreq(SIDE)
    total = np.zeros((SIDE, SIDE // 2 + 1), complex)
    for x, y, light, length, angle in streaks:
        c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
        phase = -2j * np.pi * (fx * x + fy * y) - 2 * (np.pi * 1.2) ** 2 * (fx**2 + fy**2)
        total += light * np.exp(phase) * np.sinc(length * (c * fx + s * fy))
    return fft.irfft2(total, (SIDE, SIDE)) + np.random.default_rng(seed).normal(100, noise, (SIDE, SIDE))


def sky(length, angle, light=9e3):
    positions = [(50, 60), (180.3, 50.7), (60.4, 185.2), (190.1, 180.6), (120.2, 75.1)]
    return [(x, y, light, length, angle) for x, y in positions]


@pytest.mark.parametrize(("length", "angle"), [(8.6, 115.0), (14.0, 20.0), (31.3, 160.0), (20.0, 0.0)])
def test_length_and_angle_of_the_trails(length, angle):
    estimate = estimate_trail(trails(sky(length, angle)))
    found = estimate.locus.describe()
    # 1 %: light in the wings below the threshold, where it was measured at 0.5 %
    assert found["length"] == pytest.approx(length, abs=0.01 * length + 0.1)
    assert abs((found["angle"] - angle + 90) % 180 - 90) < 1.0
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    expected = length**2 / 12 * np.array([c * c, c * s, s * s])
    assert np.abs((estimate.moments - expected) / estimate.errors).max() < 5


def test_a_satellite_is_outvoted():
    image = trails([*sky(15.0, 40.0), (125, 130, 4e4, 90, 150.0)])
    assert len(find_trails(image)) >= 5
    found = estimate_trail(image).locus.describe()
    assert found["length"] == pytest.approx(15.0, abs=0.25)
    assert found["angle"] == pytest.approx(40.0, abs=1.0)


def test_a_trail_across_the_border_is_not_measured():
    assert not find_trails(trails([(3, 120, 9e3, 30, 0.0)]))


def test_places_are_columns_and_rows():
    (trail,) = find_trails(trails([(60.0, 150.0, 2e4, 20, 30.0)], noise=1.0))
    # a hundredth of the length
    assert (trail.x, trail.y) == pytest.approx((60.0, 150.0), abs=0.2)


@pytest.mark.parametrize(
    ("streaks", "code", "values"),
    [
        ([], ErrorCode.NOT_CONSTRAINED, ["8 pixels"]),
        (sky(2.0, 30.0), ErrorCode.NOT_CONSTRAINED, ["8 pixels"]),
        ([(60, 60, 2e4, 20, 0.0), (170, 170, 2e4, 20, 70.0)], ErrorCode.AMBIGUOUS, ["2 trails", "1 at most"]),
    ],
    ids=["noise", "points", "two"],
)
def test_without_a_majority_of_trails_the_frame_is_refused(streaks, code, values):
    with refused(code, *values, error=UndeterminedError):
        estimate_trail(trails(streaks))


@pytest.mark.parametrize(
    ("image", "code", "values"),
    [
        (np.where(np.eye(50), np.nan, 1.0), ErrorCode.OUT_OF_RANGE, ["50 of 2500"]),
        (np.zeros((3, 50, 40)), ErrorCode.WRONG_SHAPE, [(3, 50, 40), "float64"]),
        (np.full((50, 40), "a"), ErrorCode.WRONG_TYPE, [(50, 40), "<U1"]),
    ],
    ids=["nan", "colour", "text"],
)
def test_what_is_no_image_is_refused(image, code, values):
    with refused(code, *values, error=ConfigurationError):
        estimate_trail(image)


def test_trails_that_scatter_widen_the_error_of_their_mean():
    # two values, one degree of freedom: the variance is 2 of one, 1 of the mean
    assert _weighted([1.0, 3.0], [1.0, 1.0]) == pytest.approx((2.0, 1.0))
    assert _weighted([1.0, 1.2], [1.0, 1.0]) == pytest.approx((1.1, np.sqrt(0.5)))  # no less than stated
