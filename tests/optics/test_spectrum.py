import numpy as np
import pytest
from refusals import refused

from jitterkit.errors import ErrorCode
from jitterkit.forward import Parameters, expected_image
from jitterkit.loci import Stable
from jitterkit.optics import Grid, Spectrum, expand, flat_band, lines
from jitterkit.scene import Binary


def test_a_flat_band_integrates_polynomials_in_wavelength_exactly():
    band = flat_band(530, 640, 5)
    for degree in range(10):
        mean = (640 ** (degree + 1) - 530 ** (degree + 1)) / (degree + 1) / 110
        assert np.dot(band.weights, np.power(band.wavelengths, degree)) == pytest.approx(mean, rel=1e-13)


def test_weights_are_scaled_to_sum_to_one():
    assert Spectrum((500, 600), (3, 1)).weights == (0.75, 0.25)
    assert lines(500, 600, 700, 800).weights == (0.25,) * 4


def test_thirteen_nodes_make_a_band_and_five_samples_with_end_points_do_not(toliman):
    grid, binary = Grid((128, 128), 0.375, 64), Binary(10.0, 180.0, 0.0, 0.0, 3.811e7, 3.37)

    def image(spectrum):
        return expected_image(
            Parameters(binary, Stable.of()), expand(toliman, spectrum, grid, derivatives=False)
        )

    truth = image(flat_band(530, 640, 24))

    def chi_squared(spectrum):
        return float(np.sum((image(spectrum) - truth) ** 2 / truth))

    assert chi_squared(flat_band(530, 640)) < 0.05
    # The figures of the module's introduction, to the digits given: they are there to warn.
    assert chi_squared(flat_band(530, 640, 9)) == pytest.approx(63, rel=0.05)
    assert chi_squared(flat_band(530, 640, 5)) == pytest.approx(9300, rel=0.05)
    assert chi_squared(lines(*np.linspace(530, 640, 5))) == pytest.approx(3.4e5, rel=0.05)


def test_a_band_of_fewer_nodes_is_a_band():
    assert flat_band(530, 640).sampled(9) == flat_band(530, 640, 9)
    assert flat_band(530, 640, 9).sampled(20) == flat_band(530, 640, 20)


@pytest.mark.parametrize("samples", [1, 2, 5, 9])
def test_fewer_wavelengths_have_the_same_moments(samples, rng):
    light = Spectrum(tuple(rng.uniform(500, 700, 40)), tuple(rng.uniform(0, 1, 40)))
    fewer = light.sampled(samples)
    assert len(fewer.wavelengths) == samples
    assert min(fewer.weights) > 0
    for degree in range(2 * samples):
        told, kept = (
            np.dot(one.weights, ((np.array(one.wavelengths) - 600) / 100) ** degree) for one in (light, fewer)
        )
        assert kept == pytest.approx(told, abs=1e-12)


def test_of_a_band_s_nodes_the_fewer_are_those_of_gauss_and_legendre():
    nodes = flat_band(530, 640, 13)
    fewer = Spectrum(nodes.wavelengths, nodes.weights).sampled(7)
    x, w = np.polynomial.legendre.leggauss(7)
    np.testing.assert_allclose(fewer.wavelengths, 585 + 55 * x, rtol=1e-12)
    np.testing.assert_allclose(fewer.weights, w / 2, rtol=1e-11)


def test_lines_are_never_more_than_they_are():
    assert lines(500, 600).sampled(5) == lines(500, 600)
    assert lines(500, 600).sampled(1).wavelengths == pytest.approx((550,))


@pytest.mark.parametrize(
    ("build", "code", "values"),
    [
        (lambda: Spectrum((500,), (1, 2)), ErrorCode.WRONG_SHAPE, ("2 weights", "1 wavelengths")),
        (lambda: Spectrum((), ()), ErrorCode.WRONG_SHAPE, ("0 weights", "0 wavelengths")),
        (lambda: Spectrum((-500,), (1,)), ErrorCode.OUT_OF_RANGE, ([-500.0],)),
        (lambda: Spectrum((float("nan"),), (1,)), ErrorCode.OUT_OF_RANGE, ([float("nan")],)),
        (lambda: Spectrum((500, 600), (1, -1)), ErrorCode.OUT_OF_RANGE, ([1.0, -1.0],)),
        (lambda: Spectrum((500,), (0,)), ErrorCode.OUT_OF_RANGE, ([0.0],)),
        (lambda: flat_band(640, 530), ErrorCode.OUT_OF_RANGE, ("640 to 530",)),
        (lambda: flat_band(530, 640, 0), ErrorCode.OUT_OF_RANGE, ("sample", " 0.")),
        (lambda: lines(530, 640).sampled(-3), ErrorCode.OUT_OF_RANGE, ("sample", " -3.")),
    ],
)
def test_impossible_spectra_are_refused(build, code, values):
    with refused(code, *values):
        build()
