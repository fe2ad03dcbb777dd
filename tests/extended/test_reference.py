"""The blur of a frame against a sharp one."""

import numpy as np
import pytest
from refusals import refused
from scipy.ndimage import gaussian_filter

from jitterkit.errors import ConfigurationError, ErrorCode, UndeterminedError
from jitterkit.extended import estimate_from_reference
from jitterkit.loci import Linear, Mvn


def pair(blur, scene, length, angle, decibels=30.0):
    image = blur(scene, length, angle, decibels)
    y, x = ((a - b) // 2 for a, b in zip(scene.shape, image.shape, strict=True))
    sharp = scene[y : y + image.shape[0], x : x + image.shape[1]]
    noise = np.random.default_rng(9).normal(0, sharp.std() * 10 ** (-decibels / 20), sharp.shape)
    return sharp + noise, image


@pytest.mark.parametrize(("length", "angle"), [(3.0, 53.0), (11.0, 160.0)])
def test_a_streak_is_found_against_the_sharp_frame(length, angle, blur, coins):
    estimate = estimate_from_reference(*pair(blur, coins, length, angle), plate_scale=0.5)
    found = estimate.locus.describe()
    assert isinstance(estimate.locus, Linear)
    # frames end, and what has left one is not in the other: a hundredth of the length was measured
    assert found["length"] == pytest.approx(0.5 * length, abs=0.02 * length)
    assert found["angle"] == pytest.approx(angle, abs=1.0)


def test_moments_of_a_normal_blur(coins):
    rng = np.random.default_rng(1)
    soft = gaussian_filter(coins, (1.5, 0.8), truncate=8)
    estimate = estimate_from_reference(
        coins + rng.normal(0, 1, coins.shape), soft + rng.normal(0, 1, coins.shape)
    )
    assert isinstance(estimate.locus, Mvn)
    # 2 % for the borders
    np.testing.assert_allclose(estimate.moments, [0.64, 0.0, 2.25], atol=0.045)


def test_a_frame_that_is_shifted_has_the_same_streak(blur, coins):
    sharp, image = pair(blur, coins, 11.0, 160.0)
    shifted = np.roll(image, (2, -3), axis=(0, 1))  # columns by one amount, rows by another
    found = estimate_from_reference(sharp, shifted).locus.describe()
    assert found["length"] == pytest.approx(11.0, abs=0.22)  # as above, and what leaves by the shift
    assert found["angle"] == pytest.approx(160.0, abs=1.0)


@pytest.mark.parametrize("length", [20.0, 45.0])
def test_a_long_streak_is_not_taken_for_one_of_its_nulls(blur, coins, length):
    estimate = estimate_from_reference(*pair(blur, coins, length, 30.0))
    size = estimate.locus.describe()
    assert size["length"] == pytest.approx(length, rel=0.02)  # the borders, as above
    assert size["angle"] == pytest.approx(30.0, abs=0.5)


def test_no_blur_is_found_to_be_none(blur, coins):
    estimate = estimate_from_reference(*pair(blur, coins, 0.0, 0.0))
    assert np.abs(estimate.moments / estimate.errors).max() < 5


def test_the_pixel_kernel_lies_along_the_streak(blur, coins):
    kernel = estimate_from_reference(*pair(blur, coins, 11.0, 20.0), kernel_side=31).kernel
    assert kernel.shape == (31, 31)
    assert kernel.sum() == pytest.approx(1.0)
    y, x = np.mgrid[-15:16, -15:16]
    core = np.where(kernel > 0.3 * kernel.max(), kernel, 0)
    sxx, sxy, syy = ((core * q).sum() / core.sum() for q in (x * x, x * y, y * y))
    assert np.degrees(np.arctan2(2 * sxy, sxx - syy)) / 2 == pytest.approx(20.0, abs=4.0)


def test_bad_input_is_refused(coins):
    with refused(ErrorCode.WRONG_SHAPE, 40, error=ConfigurationError):
        estimate_from_reference(coins, coins, kernel_side=40)
    rng = np.random.default_rng(0)
    with refused(ErrorCode.MODEL_MISMATCH, "-0.02", 0.3, error=UndeterminedError):  # the correlation
        estimate_from_reference(coins, rng.normal(size=coins.shape))
