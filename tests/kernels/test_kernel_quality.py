"""Every number about a kernel has one consequence that can be checked."""

import numpy as np
import pytest
from refusals import refused

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.kernels import kernel_image, kernel_quality, kernel_transfer
from jitterkit.loci import Linear, Mvn

P = 0.375


def normal(sx, sy, side=41):
    n = np.arange(side) - side // 2
    return np.outer(np.exp(-(n**2) / 2 / sy**2), np.exp(-(n**2) / 2 / sx**2))


def test_a_density_of_one_pixel_has_nothing_to_complain_of():
    kernel = np.zeros((5, 5))
    kernel[2, 2] = 1
    quality = kernel_quality(kernel, P, np.zeros(3))
    assert (quality.sum, quality.negativity, quality.ringing, quality.offset) == (1, 0, 0, (0, 0))
    assert quality.otf_max < 1e-15
    np.testing.assert_array_equal(quality.moments, 0)


def test_the_sum_is_what_a_flat_image_is_multiplied_by():
    assert kernel_quality(3 * normal(2, 1), P).sum == pytest.approx(3 * 2 * np.pi * 2, rel=1e-6)


def test_half_of_what_is_given_may_be_taken():
    assert kernel_quality(np.array([[-1.0, 3.0, -1.0]]), P).negativity == pytest.approx(0.4)


@pytest.mark.parametrize("sizes", [(4.0, 4.0), (5.0, 3.0)])
def test_one_percent_of_a_normal_lies_outside_its_core(sizes):
    # the contour at 1 % of the peak encloses 1 - 0.01; its edge of 2 pi r = 80 pixels is cut to pixels,
    # of which each holds 1e-4
    assert kernel_quality(normal(*sizes), P).ringing == pytest.approx(0.01, abs=80**0.5 * 1e-4)


def test_a_detached_bump_and_a_fringe_are_ringing():
    kernel = np.zeros((1, 9))
    kernel[0, 3:6], kernel[0, 7], kernel[0, 1] = 2.0, 1.0, -1.0
    assert kernel_quality(kernel, P).ringing == pytest.approx(2 / 8)


def test_a_shifted_kernel_moves_the_image_by_its_offset_and_no_moment():
    kernel = normal(2, 2)
    moved = np.roll(kernel, (1, -3), (0, 1))
    quality = kernel_quality(moved, P)
    np.testing.assert_allclose(quality.offset, (-3, 1), atol=1e-9)
    np.testing.assert_allclose(quality.moments, kernel_quality(kernel, P).moments, atol=1e-9)


def test_moments_are_in_arcsec_and_x_is_not_y():
    np.testing.assert_allclose(kernel_quality(normal(3, 2), P).moments, [9 * P**2, 0, 4 * P**2], atol=1e-9)


def test_the_residual_otf_of_five_pixels_is_dirichlets_against_sinc():
    quality = kernel_quality(np.ones((1, 5)), P, Linear.of(5 * P, 0.0))
    f = np.linspace(-0.5, 0.5, 65)
    fx, fy = np.meshgrid(f, f)
    with np.errstate(invalid="ignore"):
        dirichlet = np.where(fx == 0, 1, np.sin(5 * np.pi * fx) / (5 * np.sin(np.pi * fx)))
    difference = np.abs(dirichlet - np.sinc(5 * fx))[np.hypot(fx, fy) <= 0.5]
    assert quality.otf_max == pytest.approx(difference.max(), rel=1e-9)
    assert quality.otf_rms == pytest.approx(np.sqrt(np.mean(difference**2)), rel=1e-9)


def test_a_reference_may_be_moments_or_another_kernel_and_a_flip_is_no_match(hop):
    kernel = kernel_image(hop(0.3), P)
    assert kernel_quality(kernel, P, kernel).otf_max == 0
    # turned about, |K - K*| = 2 |Im K|, which reaches 1 and more within the band
    assert kernel_quality(kernel, P, kernel[::-1, ::-1].copy()).otf_max > 1
    assert kernel_quality(kernel, P, hop(0.3), cutoff=1.1).otf_max < 0.08
    assert kernel_quality(normal(2, 2), P, np.array([4, 0, 4]) * P**2).otf_max < 1e-3


def test_a_narrower_band_leaves_less_to_differ():
    kernel, locus = np.ones((1, 5)), Linear.of(5 * P, 0.0)
    assert kernel_quality(kernel, P, locus, cutoff=0.3).otf_max < kernel_quality(kernel, P, locus).otf_max


def test_the_transfer_function_of_a_kernel_is_that_of_its_points(hop):
    kernel, (fx, fy) = kernel_image(hop(P), P), (np.array([0.0, 0.4, -0.9]), np.array([0.2, -0.7]))
    expected = np.asarray(hop(P).transfer(fx[None, :], fy[:, None]))
    np.testing.assert_allclose(kernel_transfer(kernel, P, fx, fy), expected, atol=1e-12)


@pytest.mark.parametrize(
    ("kernel", "code", "value"),
    [
        (np.ones((2, 3)), ErrorCode.WRONG_SHAPE, (2, 3)),
        (np.ones(3), ErrorCode.WRONG_SHAPE, (3,)),
        (np.zeros((3, 3)), ErrorCode.OUT_OF_RANGE, 0.0),
        (np.full((3, 3), np.nan), ErrorCode.OUT_OF_RANGE, np.nan),
    ],
)
def test_what_is_no_kernel_has_no_quality(kernel, code, value):
    with refused(code, value, error=ConfigurationError):
        kernel_quality(kernel, P)


def test_the_moments_of_a_locus_drawn_small_are_those_of_the_locus():
    locus = Mvn.of(0.05, 0.02, 130.0)
    np.testing.assert_allclose(kernel_quality(kernel_image(locus, P), P).moments, locus.moments(), atol=1e-13)
