"""What is particular to one locus, against formulae written with scipy."""

import jax
import numpy as np
import pytest
import scipy.special
from refusals import refused

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.loci import LOCI, Linear, Mvn, Shm, Stable, locus_class, rasterise
from jitterkit.loci.special import j0_of_square, sinc_of_square

F = np.linspace(-3, 3, 61)


def test_a_linear_smear_along_x_is_a_sinc_of_its_full_length():
    locus = Linear.of(0.75)
    assert np.asarray(locus.transfer(F, 0.0)) == pytest.approx(np.sinc(0.75 * F), abs=2e-15)
    assert np.asarray(locus.transfer(0.0, F)) == pytest.approx(np.ones(F.size), abs=1e-15)
    assert np.asarray(locus.moments()) == pytest.approx([0.75**2 / 12, 0, 0], abs=1e-17)


def test_harmonic_motion_is_a_bessel_function_of_its_peak_to_peak_length():
    locus = Shm.of(0.75, 90.0)
    assert np.asarray(locus.transfer(0.0, F)) == pytest.approx(scipy.special.j0(np.pi * 0.75 * F), abs=2e-14)
    assert np.asarray(locus.moments()) == pytest.approx([0, 0, 0.75**2 / 8], abs=1e-17)


def test_random_motion_is_a_gaussian_of_its_covariance():
    locus = Mvn.of(0.2, 0.1, 30.0)
    c, s = np.cos(np.radians(30)), np.sin(np.radians(30))
    along, across = F * c - 0.4 * s, -F * s - 0.4 * c
    expected = np.exp(-2 * np.pi**2 * (0.04 * along**2 + 0.01 * across**2))
    assert np.asarray(locus.transfer(F, -0.4)) == pytest.approx(expected, abs=1e-15)


def test_a_stable_telescope_passes_everything():
    assert np.array_equal(Stable.of().transfer(F[None, :], F[:, None]), np.ones((61, 61)))


def test_a_shear_is_one_minus_the_ratio_of_the_sigmas():
    # Not of the variances: the paper's text has it both ways (SCIENCE 8.2), its figures this way.
    locus = Mvn.sheared(0.2, 0.3, 40.0)
    assert np.asarray(locus.coords) == pytest.approx(np.asarray(Mvn.of(0.2, 0.14, 40.0).coords), rel=1e-14)
    assert locus.describe() == pytest.approx(
        {"sigma_major": 0.2, "sigma_minor": 0.14, "shear": 0.3, "angle": 40.0}, rel=1e-13
    )
    root_det = np.sqrt(np.linalg.det(np.array(locus.coords)[[0, 1, 1, 2]].reshape(2, 2)))
    assert root_det / (1 - 0.3) == pytest.approx(0.2**2, rel=1e-13)


def test_an_indefinite_covariance_is_kept_as_it_is():
    locus = Mvn.near([1e-4, 0.0, -2e-4])
    assert float(locus.transfer(0.0, 1.0)) == pytest.approx(np.exp(2 * np.pi**2 * 2e-4), rel=1e-14)
    assert locus.describe()["sigma_minor"] == 0.0


@pytest.mark.parametrize("name", list(LOCI))
def test_every_locus_is_found_by_its_name(name):
    assert locus_class(name) is LOCI[name]


def test_an_unknown_locus_is_refused_with_the_list_of_those_there_are():
    with refused(ErrorCode.UNKNOWN_NAME, "'circle'", *LOCI, error=ConfigurationError):
        locus_class("circle")


@pytest.mark.parametrize(
    ("build", "code", "values"),
    [
        (lambda: Linear.of(-0.1), ErrorCode.OUT_OF_RANGE, ["length", "got -0.1"]),
        (lambda: Linear.of(float("nan")), ErrorCode.OUT_OF_RANGE, ["length", "got nan"]),
        (lambda: Shm.of(-0.2), ErrorCode.OUT_OF_RANGE, ["length", "got -0.2"]),
        (lambda: Mvn.of(0.1, -0.1), ErrorCode.OUT_OF_RANGE, ["0.1 and -0.1"]),
        (lambda: Mvn.sheared(0.1, 1.2), ErrorCode.OUT_OF_RANGE, ["shear", "got 1.2"]),
        (lambda: rasterise(Stable.of(), 0.1, (4, 5)), ErrorCode.WRONG_SHAPE, [(4, 5)]),
        (lambda: rasterise(Linear.of(1.0), 0.1, (3, 3)), ErrorCode.WRONG_SHAPE, [(3, 3), (11, 11)]),
    ],
)
def test_impossible_sizes_are_refused(build, code, values):
    with refused(code, *values, error=ConfigurationError):
        build()


def test_a_linear_kernel_along_x_is_one_row_of_equal_pixels():
    kernel = rasterise(Linear.of(0.5), 0.1)
    assert kernel.shape == (5, 5)
    assert kernel[2] == pytest.approx(np.full(5, 0.2), abs=2e-5)  # 65536 points, each in one pixel
    assert kernel.sum() == pytest.approx(1.0)


def test_a_kernel_along_y_grows_with_the_row_index():
    kernel = rasterise(Linear.of(0.5, 90.0), 0.1, (9, 9), centre=(0.0, 0.2))
    assert np.flatnonzero(kernel.sum(axis=1)).tolist() == [4, 5, 6, 7, 8]
    assert np.flatnonzero(kernel.sum(axis=0)).tolist() == [4]


W = np.concatenate([[0.0], np.geomspace(1e-12, 2500, 400)])


def test_sinc_of_a_square_agrees_with_numpy():
    assert np.asarray(sinc_of_square(W)) == pytest.approx(np.sinc(np.sqrt(W)), abs=1e-15)


def test_j0_of_a_square_agrees_with_scipy():
    # Below 625, rounding of the series' argument (1e-16 of 625) times the slope 1/4; above, Hankel's terms.
    assert np.asarray(j0_of_square(W)) == pytest.approx(scipy.special.j0(np.sqrt(W)), abs=2e-14)


def test_j0_of_a_square_is_continuous_where_the_expansions_meet():
    below, above = j0_of_square(np.array([625 - 1e-12, 625 + 1e-12]))
    assert float(below) == pytest.approx(float(above), abs=2e-14)


def test_derivatives_of_j0_of_a_square_agree_with_scipy():
    w = np.geomspace(1e-6, 2000, 60)
    found = jax.vmap(jax.grad(j0_of_square))(w)
    root = np.sqrt(w)
    # Differentiating the Chebyshev series multiplies its rounding by up to 31^2 / 312.
    assert np.asarray(found) == pytest.approx(-scipy.special.j1(root) / (2 * root), abs=1e-13)


@pytest.mark.parametrize(
    ("function", "series"),
    [(sinc_of_square, (1.0, -(np.pi**2) / 6, np.pi**4 / 60)), (j0_of_square, (1.0, -1 / 4, 1 / 32))],
)
def test_the_functions_of_a_square_have_their_taylor_series_at_zero(function, series):
    derivatives = (function(0.0), jax.grad(function)(0.0), jax.grad(jax.grad(function))(0.0))
    assert np.array(derivatives) == pytest.approx(np.array(series), rel=1e-10)
