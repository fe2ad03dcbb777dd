"""Taking a known blur out of an image, on the image's own scale."""

import numpy as np
import pytest
from refusals import refused
from scipy.signal import fftconvolve

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.kernels import deblur, kernel_image
from jitterkit.kernels.deblurring import METHODS
from jitterkit.loci import Linear, Mvn, Product

PLACES = np.array([[30, 22], [33, 61], [58, 40], [70, 70], [15, 75]])  # row, column


def stars(flux=1e5, background=200.0):
    y, x = np.mgrid[:91, :96]
    image = np.full(y.shape, float(background))
    for row, column in PLACES:
        image += flux / (2 * np.pi * 1.3**2) * np.exp(-((y - row) ** 2 + (x - column) ** 2) / (2 * 1.3**2))
    return image


def run(image, kernel, method, **more):
    return deblur(image, kernel, method=method, rng=np.random.default_rng(3), **more)


@pytest.fixture
def streak():
    return kernel_image(Product(Linear.of(6.0, 30.0), Mvn.of(0.5)), 1.0)


@pytest.mark.parametrize("method", METHODS)
def test_noisy_stars_become_sharper_and_keep_their_light(method, streak, rng):
    sharp = stars()
    blurred = fftconvolve(sharp - 200, streak, mode="same") + 200
    data = rng.poisson(blurred).astype(float)
    found = run(data, streak, method, variance=blurred)
    assert np.std(found - sharp) < 0.6 * np.std(data - sharp)
    assert found.sum() == pytest.approx(data.sum(), rel=1e-3)
    for row, column in PLACES:  # the light of each star is back within three pixels of it
        box = np.s_[row - 3 : row + 4, column - 3 : column + 4]
        share = (found[box] - 200).sum() / (sharp[box] - 200).sum()
        assert share > (data[box] - 200).sum() / (sharp[box] - 200).sum()
        assert share == pytest.approx(1, abs=0.1)


@pytest.mark.parametrize("method", METHODS)
def test_an_asymmetric_kernel_is_undone_to_the_right_side(method, hop):
    kernel = kernel_image(hop(2.0), 1.0)
    sharp = stars(background=0)
    blurred = fftconvolve(sharp, kernel, mode="same")
    found = run(blurred, kernel, method, variance=blurred + 25)
    peaks = [np.unravel_index(np.argmax(found[r - 5 : r + 6, c - 5 : c + 6]), (11, 11)) for r, c in PLACES]
    # the wrong way round the peak moves on to (-4, -4) from its star
    np.testing.assert_array_equal(peaks, np.full((5, 2), 5))


@pytest.mark.parametrize("method", ["richardson-lucy", "wiener"])
def test_the_unit_of_the_image_does_not_matter(method, streak, rng):
    data = fftconvolve(stars(), streak, mode="same") + rng.normal(0, 20, (91, 96))
    one, thousand = run(data, streak, method), run(data / 1000, streak, method)
    np.testing.assert_allclose(thousand, one / 1000, rtol=1e-6, atol=1e-6 * np.abs(one).max() / 1000)


@pytest.mark.parametrize("method", METHODS)
def test_one_pixel_as_kernel_changes_nothing_but_the_noise(method):
    kernel = np.zeros((3, 3))
    kernel[1, 1] = 1
    found = run(stars(), kernel, method, variance=1.0)
    # what the methods make smoother, they make so by less than the noise
    assert np.std(found - stars()) < (1.0 if method != "unsupervised-wiener" else 20.0)


@pytest.mark.parametrize("method", METHODS)
def test_holes_are_filled_and_do_not_spread(method, streak):
    blurred = fftconvolve(stars() - 200, streak, mode="same") + 200
    holed = blurred.copy()
    holed[50, 10], holed[51, 11] = np.nan, np.inf
    mask = np.zeros(blurred.shape, bool)
    mask[5, 5] = True
    spoilt = np.where(mask, 1e9, holed)
    whole, found = (run(image, streak, method, variance=blurred, mask=mask) for image in (blurred, spoilt))
    assert np.all(np.isfinite(found))
    assert np.abs(found - whole)[20:40, 50:70].max() < 0.01 * whole.max()


@pytest.mark.parametrize("method", METHODS)
def test_a_gradient_across_the_borders_stays_one(method, streak):
    slope = 1000 + 5.0 * np.arange(96) * np.ones((91, 1))
    found = run(slope, streak, method, variance=1000.0)
    # half the noise (32), and a hundredth of the level
    np.testing.assert_allclose(found[3:-3, 3:-3], slope[3:-3, 3:-3], atol=16)


def test_less_noise_calls_for_more_iterations_and_less_smoothing(streak):
    blurred = fftconvolve(stars() - 200, streak, mode="same") + 200
    for method in ("richardson-lucy", "wiener"):
        errors = [np.std(run(blurred, streak, method, variance=v) - stars()) for v in (1e5, 1e3, 1e1)]
        assert errors == sorted(errors, reverse=True)


@pytest.mark.parametrize("method", ["richardson-lucy", "wiener"])
def test_the_image_blurred_again_differs_from_the_data_by_the_noise(method, streak, rng):
    blurred = fftconvolve(stars() - 200, streak, mode="same") + 200
    data = rng.poisson(blurred).astype(float)
    again = fftconvolve(run(data, streak, method, variance=blurred) - 200, streak, mode="same") + 200
    # 8700 pixels scatter by 1.5 %; doublings and three steps a decade stop somewhat below one.  Where the
    # stars are it is above one, and below it elsewhere: the criterion is one for the whole image
    assert 0.8 < np.mean((data - again) ** 2 / blurred) < 1.05


def test_iterations_and_balance_may_be_given(streak):
    data = fftconvolve(stars(), streak, mode="same")
    few, many = (np.std(deblur(data, streak, iterations=n)) for n in (2, 30))
    assert many > few
    smooth, rough = (np.std(deblur(data, streak, method="wiener", balance=b)) for b in (10.0, 1e-3))
    assert rough > smooth


def test_negative_pixels_are_lifted_for_richardson_and_lucy(streak, rng):
    data = fftconvolve(stars(background=0), streak, mode="same") + rng.normal(0, 30, (91, 96))
    found = deblur(data, streak)
    assert np.all(np.isfinite(found))
    assert found.sum() == pytest.approx(data.sum(), rel=0.01)


@pytest.mark.parametrize(
    ("more", "code", "values"),
    [
        (
            {"method": "magic"},
            ErrorCode.UNKNOWN_NAME,
            ["'magic'", "richardson-lucy, wiener, unsupervised-wiener"],
        ),
        ({"method": "unsupervised-wiener"}, ErrorCode.MISSING_VALUE, ["rng"]),
        ({"kernel": np.ones((2, 3))}, ErrorCode.WRONG_SHAPE, [(2, 3), 6]),
        ({"kernel": np.ones(3)}, ErrorCode.WRONG_SHAPE, [(3,)]),
        ({"kernel": np.zeros((3, 3))}, ErrorCode.OUT_OF_RANGE, [(3, 3), 0]),
        ({"image": np.full((9, 9), np.nan)}, ErrorCode.NO_DATA, [81]),
        ({"mask": np.ones((9, 9), bool)}, ErrorCode.NO_DATA, [81]),
        ({"image": np.ones(9)}, ErrorCode.WRONG_SHAPE, [(9,)]),
        ({"variance": np.ones((9, 8))}, ErrorCode.WRONG_SHAPE, ["variance", (9, 8), (9, 9)]),
        ({"mask": np.zeros((8, 9), bool)}, ErrorCode.WRONG_SHAPE, ["mask", (8, 9), (9, 9)]),
    ],
)
def test_what_cannot_be_deblurred_is_refused(more, code, values):
    given = {"image": np.ones((9, 9)), "kernel": np.ones((3, 3)), **more}
    with refused(code, *values, error=ConfigurationError):
        deblur(**given)
