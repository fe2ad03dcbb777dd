"""The laws every jitter locus keeps; a new one is held to them by its line in the registry."""

import jax
import numpy as np
import pytest

from jitterkit.loci import LOCI, Linear, Mvn, Shm, Stable, principal_axes, rasterise

EXAMPLES = {
    "stable": lambda size=1.0, turn=0.0: Stable.of(),
    "linear": lambda size=1.0, turn=0.0: Linear.of(0.75 * size, 20.0 + turn),
    "shm": lambda size=1.0, turn=0.0: Shm.of(0.6 * size, 110.0 + turn),
    "mvn": lambda size=1.0, turn=0.0: Mvn.of(0.2 * size, 0.1 * size, 65.0 + turn),
}
FX, FY = (f.ravel() for f in np.meshgrid(np.linspace(-1.2, 1.2, 13), np.linspace(-1.1, 1.1, 12)))


@pytest.fixture(params=list(LOCI))
def example(request):
    """Builds one locus of a kind, at a relative size, turned counter-clockwise by some degrees."""
    return EXAMPLES[request.param]


def matrix(moments):
    sxx, sxy, syy = np.asarray(moments)
    return np.array([[sxx, sxy], [sxy, syy]])


def test_the_transfer_function_is_one_at_zero_frequency(example):
    assert float(example().transfer(np.float64(0), np.float64(0))) == pytest.approx(1.0, abs=1e-15)


def test_the_transfer_function_never_exceeds_one(example):
    assert np.all(np.abs(example().transfer(5 * FX, 5 * FY)) <= 1 + 4e-16)


def test_one_name_stands_for_each_coordinate(example):
    locus = example()
    assert locus.coords.shape == (len(locus.names),)


def test_the_curvature_of_the_transfer_function_gives_the_second_moments(example):
    # M = 1 - 2 pi^2 f'Sf + ..., the first terms of the characteristic function of any density.
    locus = example()
    curvature = jax.hessian(lambda f: locus.transfer(f[0], f[1]))(np.zeros(2))
    assert np.asarray(curvature) == pytest.approx(
        -4 * np.pi**2 * matrix(locus.moments()), rel=1e-12, abs=1e-15
    )


def test_the_transfer_function_is_the_mean_phasor_over_the_points(example):
    locus = example()
    x, y = locus.points(65536).T
    phasors = np.exp(-2j * np.pi * (np.multiply.outer(FX, x) + np.multiply.outer(FY, y)))
    # The 256 quantiles of a normal axis miss 2.5 % of its fourth moment 3 s^4; at (2 pi f s) = 1.6 that
    # is 3 * 0.025 * 1.6^4 / 24 = 0.02 before the decay of M.  Streaks are ten thousand times closer.
    tolerance = 1e-2 if isinstance(locus, Mvn) else 1e-9
    assert np.abs(phasors.mean(axis=1) - locus.transfer(FX, FY)).max() < tolerance


def test_the_points_have_the_second_moments(example):
    locus = example()
    points = locus.points(65536)
    assert points.mean(axis=0) == pytest.approx(np.zeros(2), abs=1e-12)
    # The midpoint rule is short of an integral of x^2 by 1/n^2 = 2e-10 of it.
    assert points.T @ points / len(points) == pytest.approx(matrix(locus.moments()), rel=1e-9, abs=1e-14)


def test_kernels_have_the_moments_of_the_locus_and_of_the_pixel(example):
    # Over all positions within a pixel, rounding to its centre adds an independent p^2/12.  A Fibonacci
    # lattice of n positions leaves its own correlation of x with y, 3 % of p^2/12.
    locus, p, n = example(), 0.1, 89
    total = np.zeros((2, 2))
    for k in range(n):
        centre = p * (np.array([k + 0.5, (55 * k + 0.5) % n]) / n - 0.5)
        kernel = rasterise(locus, p, centre=tuple(centre))
        assert kernel.sum() == pytest.approx(1.0, abs=1e-12)
        row, column = np.indices(kernel.shape)
        x = (column - (kernel.shape[1] - 1) / 2) * p - centre[0]
        y = (row - (kernel.shape[0] - 1) / 2) * p - centre[1]
        total += np.array([[np.sum(kernel * a * b) for a in (x, y)] for b in (x, y)]) / n
    expected = matrix(locus.moments()) + p**2 / 12 * np.eye(2)
    assert total == pytest.approx(expected, abs=0.04 * p**2 / 12)


def test_turning_a_locus_by_17_degrees_turns_its_moments_and_its_spectrum(example):
    c, s = np.cos(np.radians(17)), np.sin(np.radians(17))
    rotation = np.array([[c, -s], [s, c]])
    locus, turned = example(), example(turn=17.0)
    expected = rotation @ matrix(locus.moments()) @ rotation.T
    assert matrix(turned.moments()) == pytest.approx(expected, abs=1e-15)
    fx, fy = rotation @ np.stack([FX, FY])
    assert np.asarray(turned.transfer(fx, fy)) == pytest.approx(np.asarray(locus.transfer(FX, FY)), abs=1e-14)


def test_values_and_derivatives_are_finite_at_no_size_and_at_tiny_sizes(example):
    kind = type(example())

    def total(coords):
        return jax.numpy.sum(kind(coords).transfer(FX, FY))

    derivatives = jax.jit(lambda c: (total(c), jax.grad(total)(c), jax.hessian(total)(c)))
    for size in (0.0, 1e-80, 1e-9, 1e-3):
        coords = example(size).coords
        value, *orders = derivatives(coords)
        assert float(value) == pytest.approx(FX.size, rel=1e-4)
        assert all(np.all(np.isfinite(order)) for order in orders)
        assert np.all(np.isfinite(jax.jacfwd(lambda c: kind(c).moments())(coords)))


def test_the_locus_nearest_to_its_own_moments_is_itself(example):
    locus = example()
    again = type(locus).near(locus.moments())
    # A streak's minor variance is a difference of nearly equal numbers: rounding, 1e-16 / S.
    assert np.asarray(again.coords) == pytest.approx(np.asarray(locus.coords), abs=1e-14)


def test_near_accepts_moments_that_are_noise_about_zero(example):
    locus = type(example()).near(np.array([-1e-4, 2e-5, -3e-5]))
    assert np.all(np.isfinite(np.asarray(locus.transfer(FX, FY))))


def test_a_description_rebuilds_the_locus(example):
    locus = example()
    described = {k: v for k, v in locus.describe().items() if k != "shear"}
    again = type(locus).of(**described)
    assert np.asarray(again.coords) == pytest.approx(np.asarray(locus.coords), abs=1e-15)


def test_principal_axes_agree_with_an_eigenvalue_solver(example):
    moments = example().moments()
    minor, major = np.sqrt(np.maximum(np.linalg.eigvalsh(matrix(moments)), 0))
    found = principal_axes(moments)
    # The square root turns rounding of 1e-17 about a zero minor axis into 3e-9.
    assert found[:2] == pytest.approx((major, minor), abs=2e-8)
    assert 0 <= found[2] < 180
