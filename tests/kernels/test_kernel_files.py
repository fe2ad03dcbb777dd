"""Kernels as files, and what other tools make of them."""

import numpy as np
import pytest
from astropy.convolution import CustomKernel, convolve_fft
from astropy.io import fits
from refusals import refused

from jitterkit.errors import ConfigurationError, ErrorCode, FrameError
from jitterkit.kernel_estimate import KernelEstimate
from jitterkit.kernels import kernel_image, locus_of, read_kernel, write_kernel
from jitterkit.kernels.files import kernel_cards
from jitterkit.loci import Linear, Mvn

P = 0.375


def estimate(moments, **more):
    return KernelEstimate(np.asarray(moments, float), np.diag([1e-6, 4e-6, 9e-6]), "score", **more)


def test_what_was_written_is_read(tmp_path, hop):
    kernel = kernel_image(hop(0.2), P, 2)
    path = write_kernel(tmp_path / "k.fits", 7 * kernel, plate_scale=P, estimate=hop(0.2), oversample=2)
    stored, scale, cards = read_kernel(path)
    np.testing.assert_allclose(stored, kernel, atol=1e-16)
    assert (scale, cards["OVERSAMP"], cards["LOCUS"]) == (P / 2, 2, "hop")
    assert fits.getdata(path).dtype == ">f8"


def test_the_header_says_what_each_reader_looks_for(tmp_path):
    found = estimate(Linear.of(0.6, 20.0).moments(), source="frame.fits", locus=Linear.of(0.6, 20.0))
    path = write_kernel(tmp_path / "k.fits", kernel_image(found, P), plate_scale=P, estimate=found)
    header = fits.getheader(path)
    assert (header["PIXELSCL"], header["GS_SCALE"], header["GS_WCS"]) == (P, P, "PixelScale")
    assert header["JITTER_MAJOR"] == pytest.approx(600 / np.sqrt(12))
    assert header["JITTER_MINOR"] == pytest.approx(0, abs=1e-5)  # the root of a rounding error
    assert (header["JITRTYPE"], "JITRSIGM" in header) == ("Custom jitter kernel", False)
    assert (header["METHOD"], header["SOURCE"], header["LOCUS"]) == ("score", "frame.fits", "linear")
    assert [header[f"S{axis}_ERR"] for axis in ("XX", "XY", "YY")] == pytest.approx([1e-3, 2e-3, 3e-3])
    np.testing.assert_allclose([header[f"S{axis}"] for axis in ("XX", "XY", "YY")], found.moments)


@pytest.mark.parametrize("angle", [0.0, 20.0, 90.0, 170.0])
def test_the_position_angle_is_romans_from_y_towards_x(angle):
    cards = kernel_cards(np.ones((1, 1)), plate_scale=P, estimate=Linear.of(0.6, angle))
    pa, ours = np.radians(cards["JITTER_POSITION_ANGLE"][0]), np.radians(angle)
    along = abs(np.sin(pa) * np.cos(ours) + np.cos(pa) * np.sin(ours))  # the same line, in x and y
    assert along == pytest.approx(1, abs=1e-12)
    assert cards["JTRANGLE"][0] == pytest.approx(angle)


def test_only_a_round_normal_is_what_poppy_calls_gaussian():
    def type_of(blur):
        return kernel_cards(np.ones((1, 1)), plate_scale=P, estimate=blur)["JITRTYPE"][0]

    assert type_of(Mvn.of(0.1)) == type_of(estimate([0.01, 0, 0.01])) == "Gaussian convolution"
    assert kernel_cards(np.ones((1, 1)), plate_scale=P, estimate=Mvn.of(0.1))["JITRSIGM"][0] == pytest.approx(
        0.1
    )
    for other in (Mvn.of(0.1, 0.05), estimate([0.01, 0, 0.01], kernel=np.ones((3, 3))), None):
        assert type_of(other) == "Custom jitter kernel"


def test_a_clipped_axis_is_remarked_and_the_moments_keep_their_signs():
    found = estimate([0.04, 0.0, -0.002])
    cards = kernel_cards(kernel_image(found, P), plate_scale=P, estimate=found)
    assert cards["REMARK"][0] == locus_of(found)[1] != ""
    assert (cards["SYY"][0], cards["JITTER_MINOR"][0]) == (-0.002, 0.0)


def test_without_an_estimate_the_moments_are_the_kernels_own():
    cards = kernel_cards(kernel_image(Mvn.of(0.2, 0.1, 30.0), P, 2), plate_scale=P, oversample=2)
    assert [cards["JITTER_MAJOR"][0], cards["JITTER_MINOR"][0], cards["JTRANGLE"][0]] == pytest.approx(
        [200, 100, 30]
    )


def test_a_kernel_measured_on_pixels_has_the_moments_of_its_pixels_and_no_errors_of_others():
    kernel = np.outer([0, 1, 0], [0.25, 0.5, 0.25])  # half a pixel² along x, nothing along y
    cards = kernel_cards(kernel, plate_scale=P, estimate=estimate([0.04, 0.01, 0.09], kernel=kernel))
    assert [cards[name][0] for name in ("SXX", "SXY", "SYY")] == pytest.approx([0.5 * P**2, 0, 0])
    assert cards["JITTER_MAJOR"][0] == pytest.approx(1e3 * P * np.sqrt(0.5))
    assert not {"SXX_ERR", "SXY_ERR", "SYY_ERR"} & cards.keys()


def star(shape=(41, 41), at=(25, 18)):
    image = np.zeros(shape)
    image[at] = 100.0
    return image


def test_stpsf_blurs_to_the_side_the_pointing_went(tmp_path, hop):
    # stpsf's "custom" jitter is astropy's convolve_fft with a CustomKernel of the array
    path = write_kernel(tmp_path / "k.fits", kernel_image(hop(P), P), plate_scale=P)
    out = convolve_fft(star(), CustomKernel(fits.getdata(path).astype(float)))
    assert out[24, 17] == pytest.approx(75)
    assert out[28, 21] == pytest.approx(25)


def test_dlux_blurs_to_the_same_side(tmp_path, hop):
    dlux = pytest.importorskip("dLux")
    kernel = read_kernel(write_kernel(tmp_path / "k.fits", kernel_image(hop(P), P), plate_scale=P)).kernel
    out = np.asarray(dlux.PSF(star(), P).convolve(kernel).data)
    assert out[24, 17] == pytest.approx(75)
    assert out[28, 21] == pytest.approx(25)


def test_photutils_finds_the_kernel_between_a_sharp_star_and_a_blurred_one(hop):
    matching = pytest.importorskip("photutils.psf_matching")
    photutils = pytest.importorskip("photutils.centroids")
    y, x = np.mgrid[-20:21, -20:21]
    sharp = np.exp(-(x**2 + y**2) / (2 * 1.2**2))
    kernel = kernel_image(hop(P), P, shape=(41, 41))
    blurred = convolve_fft(sharp, CustomKernel(kernel))
    found = matching.make_kernel(sharp / sharp.sum(), blurred / blurred.sum())
    # both have their light in the same places: a flip would put the quarter on the other side
    assert np.sum(found[22:25, 22:25]) == pytest.approx(0.25, abs=0.02)
    np.testing.assert_allclose(photutils.centroid_com(blurred), [20, 20], atol=1e-6)


def test_another_file_is_not_replaced_unasked(tmp_path):
    kernel = kernel_image(Mvn.of(0.2), P)
    path = write_kernel(tmp_path / "k.fits", kernel, plate_scale=P)
    with refused(ErrorCode.EXISTS, path, error=FrameError):
        write_kernel(path, kernel, plate_scale=P)
    assert write_kernel(path, kernel, plate_scale=2 * P, overwrite=True) == path
    assert read_kernel(path).plate_scale == 2 * P


@pytest.mark.parametrize(
    ("kernel", "code", "value"),
    [
        (np.ones((4, 5)), ErrorCode.WRONG_SHAPE, (4, 5)),
        (np.ones((3, 3, 3)), ErrorCode.WRONG_SHAPE, (3, 3, 3)),
        (np.array([[1, np.nan, 1]]), ErrorCode.OUT_OF_RANGE, "1 of its 3"),
        (np.zeros((3, 3)), ErrorCode.OUT_OF_RANGE, "sums to 0"),
        (-np.ones((3, 3)), ErrorCode.OUT_OF_RANGE, "sums to -9"),
    ],
    ids=["even", "cube", "nan", "zero", "negative"],
)
def test_what_is_no_kernel_is_neither_written_nor_read(tmp_path, kernel, code, value):
    with refused(code, value, error=ConfigurationError):
        write_kernel(tmp_path / "a.fits", kernel, plate_scale=P)
    fits.writeto(tmp_path / "b.fits", kernel)
    with refused(code, tmp_path / "b.fits", value, error=FrameError):
        read_kernel(tmp_path / "b.fits")
    assert not (tmp_path / "a.fits").exists()


def test_kernels_of_other_tools_are_scaled_and_keep_what_they_say(tmp_path):
    hdu = fits.ImageHDU(np.full((3, 3), 2, np.int16))
    hdu.header["GS_SCALE"] = 0.2
    fits.HDUList([fits.PrimaryHDU(), hdu]).writeto(tmp_path / "a.fits.gz")
    stored = read_kernel(tmp_path / "a.fits.gz")
    np.testing.assert_allclose(stored.kernel, 1 / 9)
    assert stored.plate_scale == 0.2
    fits.writeto(tmp_path / "b.fits", np.ones((3, 3)), fits.Header({"PIXELSCL": "none", "PIXSCALE": -1.0}))
    assert read_kernel(tmp_path / "b.fits").plate_scale is None


def test_files_that_hold_no_image_are_refused(tmp_path):
    (tmp_path / "a.fits").write_bytes(b"nothing")
    with refused(ErrorCode.UNKNOWN_FORMAT, tmp_path / "a.fits", error=FrameError):
        read_kernel(tmp_path / "a.fits")
    fits.HDUList([fits.PrimaryHDU()]).writeto(tmp_path / "b.fits")
    with refused(ErrorCode.NO_IMAGE, tmp_path / "b.fits", error=FrameError):
        read_kernel(tmp_path / "b.fits")
    path = write_kernel(tmp_path / "c.fits", np.ones((31, 31)), plate_scale=P)
    path.write_bytes(path.read_bytes()[:4000])
    with refused(ErrorCode.TRUNCATED, path, error=FrameError):
        read_kernel(path)
