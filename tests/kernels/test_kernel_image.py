"""A kernel on pixels blurs as the locus does."""

import numpy as np
import pytest
from refusals import assert_names, refused
from scipy.signal import convolve
from scipy.stats import multivariate_normal

from jitterkit.errors import ConfigurationError, ErrorCode, UndeterminedError
from jitterkit.forward import Parameters, expected_image
from jitterkit.kernel_estimate import KernelEstimate
from jitterkit.kernels import kernel_image, kernel_moments, kernel_quality, locus_of
from jitterkit.loci import Linear, Mvn, Product, Shm, Stable
from jitterkit.optics import expand, flat_band, grid_for, obstructed_circle
from jitterkit.scene import Star

P = 0.375
LOCI = {
    "small": Mvn.of(0.08, 0.03, 50.0),
    "wide": Mvn.of(0.6, 0.45, 20.0),
    "linear": Linear.of(0.375, 30.0),
    "long": Linear.of(2.5, 160.0),
    "shm": Shm.of(0.75, 70.0),
    "both": Product(Linear.of(0.6, 30.0), Mvn.of(0.1)),
}


def estimate(moments, **more):
    return KernelEstimate(np.asarray(moments, float), np.diag([1e-6] * 3), "score", **more)


@pytest.mark.parametrize("oversample", [1, 3])
@pytest.mark.parametrize("locus", LOCI.values(), ids=LOCI)
def test_sum_centre_and_second_moments_are_exact(locus, oversample):
    kernel = kernel_image(locus, P, oversample)
    y, x = (np.indices(kernel.shape).T - (np.array(kernel.shape) - 1) / 2).T * P / oversample
    moments = [np.sum(kernel * a * b) for a, b in ((x, x), (x, y), (y, y))]
    # rounding of sums of squares up to (20 pixels)²
    assert kernel.sum() == pytest.approx(1, abs=1e-12)
    np.testing.assert_allclose([np.sum(kernel * x), np.sum(kernel * y)], 0, atol=1e-13)
    np.testing.assert_allclose(moments, locus.moments(), atol=1e-13)
    np.testing.assert_allclose(kernel_moments(kernel, P / oversample), moments, atol=1e-13)


def test_a_wide_normal_is_its_density_at_the_pixel_centres():
    # beyond the Nyquist frequency exp(-2 pi² 1.2² / 4) = 8e-4 of it is left, over the pixels' 81 values of
    # 0.08 at most; three sigma and four pixels hold all but 1e-8
    locus = LOCI["wide"]
    kernel = kernel_image(locus, P)
    sxx, sxy, syy = np.asarray(locus.moments())
    y, x = (np.indices(kernel.shape).T - (np.array(kernel.shape) - 1) / 2).T * P
    density = multivariate_normal([0, 0], [[sxx, sxy], [sxy, syy]]).pdf(np.stack([x, y], -1)) * P**2
    np.testing.assert_allclose(kernel, density, atol=8e-4 * density.max())


def test_no_jitter_is_one_pixel():
    kernel = kernel_image(Stable.of(), P)
    expected = np.zeros((9, 9))
    expected[4, 4] = 1
    np.testing.assert_allclose(kernel, expected, atol=1e-15)


def test_an_asymmetric_path_of_whole_pixels_is_drawn_where_it_goes(hop):
    kernel = kernel_image(hop(P), P)
    middle = kernel.shape[0] // 2
    expected = np.zeros(kernel.shape)
    expected[middle - 1, middle - 1], expected[middle + 3, middle + 3] = 0.75, 0.25
    np.testing.assert_allclose(kernel, expected, atol=1e-12)


@pytest.mark.parametrize("name", ["small", "linear", "shm", "wide", "both"])
def test_convolving_a_sharp_frame_gives_the_frame_of_the_forward_model(name):
    # a pupil of its own: the OTF of a full circle is nowhere negative, which the bound below needs
    pupil, band = obstructed_circle(0.125, 0.0, samples=64, noll=()), flat_band(530, 640, 3)
    otf = expand(pupil, band, grid_for(pupil, band, (48, 48), P, pad=16))
    sharp, blurred = (
        np.asarray(expected_image(Parameters(Star(0.1, -0.2, 1e6), locus), otf))
        for locus in (Stable.of(), LOCI[name])
    )
    kernel = kernel_image(LOCI[name], P)
    difference = (convolve(sharp, kernel, mode="same") - blurred)[12:-12, 12:-12]
    # a perfect circle's OTF is nowhere negative, so no pixel errs by more than the largest error of the
    # kernel's transfer function below the cutoff, 1.143 cycles/arcsec, times the peak of a centred star
    worst = kernel_quality(kernel, P, LOCI[name], cutoff=1.15).otf_max
    assert np.abs(difference).max() < worst * 1.1 * sharp.max()
    assert worst < 0.08  # the module's table: a tilted SHM of two pixels is the hardest


def test_a_finer_kernel_follows_the_locus_more_closely():
    native, fine = (
        kernel_quality(kernel_image(LOCI["shm"], P, n), P / n, LOCI["shm"], cutoff=1.143) for n in (1, 4)
    )
    assert fine.otf_rms < 0.3 * native.otf_rms


def test_an_estimate_of_moments_is_drawn_as_a_normal():
    moments = np.asarray(LOCI["small"].moments())
    np.testing.assert_allclose(kernel_image(estimate(moments), P), kernel_image(LOCI["small"], P), atol=1e-12)


def test_a_negative_variance_is_clipped_and_said_to_be():
    locus, remark = locus_of(estimate([0.04, 0.0, -0.002]))
    assert_names(remark, ["minor axis", "negative", "zero"])
    np.testing.assert_allclose(locus.moments(), [0.04, 0, 0], atol=1e-15)
    np.testing.assert_allclose(
        kernel_moments(kernel_image(estimate([0.04, 0, -0.002]), P), P), [0.04, 0, 0], atol=1e-13
    )


def test_noise_about_no_jitter_gives_no_kernel():
    with refused(ErrorCode.NO_SIGNAL, "(-0.01, 0.001, -0.02)", error=UndeterminedError):
        kernel_image(estimate([-0.01, 0.001, -0.02]), P)


def test_the_locus_of_an_estimate_goes_before_its_moments():
    found = estimate([1.0, 0, 1.0], locus=LOCI["linear"])
    assert locus_of(found) == (LOCI["linear"], "")
    np.testing.assert_array_equal(kernel_image(found, P), kernel_image(LOCI["linear"], P))


def test_a_kernel_of_pixels_is_given_out_as_it_is_in_a_frame_of_the_size_asked_for():
    pixels = np.arange(15.0).reshape(3, 5)
    found = estimate([0.1, 0, 0.1], kernel=pixels)
    np.testing.assert_allclose(kernel_image(found, P), pixels / 105)
    np.testing.assert_allclose(kernel_image(found, P, shape=(7, 5))[2:5], pixels / 105)
    with refused(ErrorCode.UNSUPPORTED, 2, error=ConfigurationError):
        kernel_image(found, P, 2)
    with refused(ErrorCode.WRONG_SHAPE, (3, 5), (3, 3), error=ConfigurationError):
        kernel_image(found, P, shape=(3, 3))
    with refused(ErrorCode.OUT_OF_RANGE, 0, error=ConfigurationError):
        kernel_image(estimate([0.1, 0, 0.1], kernel=np.zeros((3, 3))), P)


def test_a_shape_is_kept_or_refused():
    assert kernel_image(LOCI["linear"], P, shape=(7, 11)).shape == (7, 11)
    with refused(ErrorCode.WRONG_SHAPE, (8, 9), error=ConfigurationError):
        kernel_image(LOCI["linear"], P, shape=(8, 9))
    with refused(ErrorCode.WRONG_SHAPE, (5, 7), (5, 9), error=ConfigurationError):
        kernel_image(LOCI["long"], P, shape=(5, 7))


@pytest.mark.parametrize(("scale", "oversample"), [(0.0, 1), (np.nan, 1), (P, 0)])
def test_impossible_scales_are_refused(scale, oversample):
    with refused(ErrorCode.OUT_OF_RANGE, scale, oversample, error=ConfigurationError):
        kernel_image(LOCI["linear"], scale, oversample)
