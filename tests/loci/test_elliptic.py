"""Ellipses and shaped blurs, against scipy and against their definitions."""

import jax
import numpy as np
import pytest
import scipy.integrate
import scipy.special
from refusals import refused

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.loci import Ellipse, Linear, Lissajous, Mvn, Shaped, Shm
from jitterkit.loci.special import j0_of_square, log1p_over

FX, FY = np.meshgrid(np.linspace(-1.3, 1.3, 14), np.linspace(-1.1, 1.1, 11))


def over_time(x, y, fx, fy):
    """The definition: the mean phasor over one period of a path, by adaptive quadrature."""
    return scipy.integrate.quad(
        lambda t: np.cos(2 * np.pi * (fx * x(t) + fy * y(t))), 0, 1, epsabs=1e-12, limit=200
    )[0]


def test_an_ellipse_is_the_time_average_over_its_turn():
    a, b, c, s = 0.4, 0.15, np.cos(np.radians(140)), np.sin(np.radians(140))
    locus = Ellipse.of(a, b, 140.0)

    def x(t):
        return a * np.cos(2 * np.pi * t) * c - b * np.sin(2 * np.pi * t) * s

    def y(t):
        return a * np.cos(2 * np.pi * t) * s + b * np.sin(2 * np.pi * t) * c

    for fx, fy in [(0.8, 0.3), (-0.5, 1.1), (0.0, 0.9)]:
        assert float(locus.transfer(fx, fy)) == pytest.approx(over_time(x, y, fx, fy), abs=1e-11)


def test_a_circle_is_a_bessel_function_of_its_radius():
    expected = scipy.special.j0(2 * np.pi * 0.3 * np.hypot(FX, FY))
    assert np.asarray(Ellipse.of(0.3, 0.3).transfer(FX, FY)) == pytest.approx(expected, abs=2e-14)


def test_an_ellipse_without_a_minor_axis_is_harmonic_motion_of_twice_its_semi_axis():
    ellipse, shm = Ellipse.of(0.3, 0.0, 70.0), Shm.of(0.6, 70.0)
    assert np.asarray(ellipse.transfer(FX, FY)) == pytest.approx(np.asarray(shm.transfer(FX, FY)), abs=2e-14)
    assert np.asarray(ellipse.moments()) == pytest.approx(np.asarray(shm.moments()), abs=1e-16)


@pytest.mark.parametrize("phase", [0.0, 50.0, 90.0, 130.0])
def test_two_axes_at_one_frequency_are_averaged_over_time(phase):
    locus, shift = Lissajous.of(0.3, 0.2, phase), np.radians(phase)

    def x(t):
        return 0.3 * np.cos(2 * np.pi * t)

    def y(t):
        return 0.2 * np.cos(2 * np.pi * t + shift)

    for fx, fy in [(0.8, 0.3), (-0.5, 1.1)]:
        assert float(locus.transfer(fx, fy)) == pytest.approx(over_time(x, y, fx, fy), abs=1e-11)


def test_in_phase_the_axes_draw_a_line_between_them_and_a_quarter_cycle_apart_an_upright_ellipse():
    line, upright = Lissajous.of(0.3, 0.3, 0.0), Lissajous.of(0.3, 0.2, 90.0)
    assert np.asarray(line.transfer(FX, FY)) == pytest.approx(
        np.asarray(Shm.of(0.6 * np.sqrt(2), 45.0).transfer(FX, FY)), abs=2e-14
    )
    assert np.asarray(upright.coords) == pytest.approx(np.asarray(Ellipse.of(0.3, 0.2).coords), abs=1e-16)
    assert Lissajous.of(0.3, 0.2, -50.0).describe()["phase"] == pytest.approx(50.0)


def test_an_indefinite_ellipse_grows_as_a_modified_bessel_function():
    locus = Ellipse.near([1e-4, 0.0, -2e-3])
    expected = scipy.special.i0(np.sqrt(8 * np.pi**2 * 2e-3 * 1.2**2))
    assert float(locus.transfer(0.0, 1.2)) == pytest.approx(expected, rel=1e-14)
    assert locus.describe()["semi_minor"] == 0.0


def test_j0_of_a_negative_square_is_i0_with_its_derivative():
    # Terms of one sign leave rounding times their number; the series is cut off at 1e-13 of I0(10).
    w = -np.geomspace(1e-6, 100, 60)
    root = np.sqrt(-w)
    assert np.asarray(j0_of_square(w)) == pytest.approx(scipy.special.i0(root), rel=1e-13)
    slope = -scipy.special.i1(root) / (2 * root)
    assert np.asarray(jax.jit(jax.vmap(jax.grad(j0_of_square)))(w)) == pytest.approx(slope, rel=2e-13)
    assert np.all(np.isfinite(j0_of_square(np.array([-1e3, -1e5]))))


def test_the_logarithm_over_its_argument_agrees_with_numpy_and_has_its_series_at_zero():
    z = np.concatenate([-np.geomspace(1e-9, 0.5, 20), np.geomspace(1e-9, 50, 40)])
    assert np.asarray(log1p_over(z)) == pytest.approx(np.log1p(z) / z, rel=1e-14)
    slopes = [log1p_over(0.0), jax.grad(log1p_over)(0.0), jax.grad(jax.grad(log1p_over))(0.0)]
    assert np.array(slopes) == pytest.approx([1.0, -1 / 2, 2 / 3], rel=1e-13)


@pytest.mark.parametrize("kurtosis", [-1.5, -1.2, -0.3, 0.0, 0.5, 3.0])
@pytest.mark.parametrize("angle", [20.0, 65.0, 110.0])
def test_the_fourth_cumulant_along_every_axis_is_the_kurtosis(kurtosis, angle):
    # ln M = -(2 pi f)^2 s^2/2 + (2 pi f)^4 k s^4/24 + ...: the fourth derivative in 2 pi f is k s^4.
    locus = Shaped.of(0.2, 0.1, 65.0, kurtosis)
    n = np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
    k = 2 * np.pi * np.linspace(0.02, 0.3, 29)
    f = k / (2 * np.pi)
    log = np.log(np.asarray(locus.transfer(f * n[0], f * n[1])))
    sxx, sxy, syy = np.asarray(locus.moments())
    variance = n @ np.array([[sxx, sxy], [sxy, syy]]) @ n
    # A fit in powers of k² to the tenth leaves what the twelfth cumulant does: 1e-5 here.
    powers = np.polynomial.polynomial.polyfit(k**2 * variance, log, 6)
    assert powers[:3] == pytest.approx([0.0, -1 / 2, kurtosis / 24], abs=2e-5)


@pytest.mark.parametrize("kurtosis", [-1.5, -1.2, -1.0, -0.3, 0.0, 0.5, 2.0])
def test_the_points_have_the_kurtosis_along_every_axis(kurtosis):
    points = Shaped.of(0.2, 0.1, 65.0, kurtosis).points(2**20)
    for angle in (20.0, 65.0, 120.0):
        along = points @ [np.cos(np.radians(angle)), np.sin(np.radians(angle))]
        found = np.mean(along**4) / np.mean(along**2) ** 2 - 3
        # 65536 rings cut off the tail of an exponential's square at 1e-3 of it, a gamma's at some more.
        assert found == pytest.approx(kurtosis, abs=1e-2 * max(1.0, 3 * kurtosis))


def test_light_tails_hold_the_streaks_the_ellipse_and_the_disc_exactly():
    def thin(kurtosis, variance):
        return Shaped.of(0.4 * np.sqrt(variance), 0.0, 25.0, kurtosis).transfer(FX, FY)

    # w reaches 12 here; the series loses a digit of sixteen on the way
    assert np.asarray(thin(-1.2, 1 / 12)) == pytest.approx(
        np.asarray(Linear.of(0.4, 25.0).transfer(FX, FY)), abs=1e-13
    )
    assert np.asarray(thin(-1.5, 1 / 8)) == pytest.approx(
        np.asarray(Shm.of(0.4, 25.0).transfer(FX, FY)), abs=1e-13
    )
    ring = Ellipse.of(0.3, 0.1, 40.0)
    shaped = Shaped.of(0.3 / np.sqrt(2), 0.1 / np.sqrt(2), 40.0, -1.5)
    assert np.asarray(shaped.transfer(FX, FY)) == pytest.approx(np.asarray(ring.transfer(FX, FY)), abs=1e-13)
    # a uniform disc of radius a has variance a^2/4 and the transform 2 J1(2 pi a f)/(2 pi a f)
    z = 2 * np.pi * 0.3 * np.hypot(FX, FY)
    disc = np.asarray(Shaped.of(0.15, 0.15, 0.0, -1.0).transfer(FX, FY))
    assert disc == pytest.approx(2 * scipy.special.j1(z) / z, abs=1e-13)


def test_a_fit_may_pass_through_shapes_that_no_density_has():
    for kurtosis in (-3.0, -10.0, 40.0):
        for moments in ([0.01, 0.0, 0.02], [0.01, 0.02, -0.01], [0.0, 0.0, 0.0]):
            coords = np.array([*moments, kurtosis])
            slope = jax.jacfwd(lambda c: Shaped(c).transfer(FX, FY))(coords)
            assert np.all(np.isfinite(slope))


def test_heavy_tails_are_the_mean_of_normals_whose_variance_is_a_gamma():
    k, w = 1.3, 4 * np.pi**2 * 0.04 * 0.7**2
    shape = 3 / k
    expected, _ = scipy.integrate.quad(
        lambda g: np.exp(-w * g / 2) * g ** (shape - 1) * np.exp(-g * shape), 0, np.inf, epsabs=1e-13
    )
    expected *= shape**shape / scipy.special.gamma(shape)
    assert float(Shaped.of(0.2, 0.2, 0.0, k).transfer(0.7, 0.0)) == pytest.approx(expected, rel=1e-10)


def test_without_kurtosis_a_shaped_blur_is_normal_and_the_change_through_it_is_smooth():
    normal = np.asarray(Mvn.of(0.2, 0.1, 65.0).transfer(FX, FY))
    assert np.asarray(Shaped.of(0.2, 0.1, 65.0).transfer(FX, FY)) == pytest.approx(normal, abs=1e-15)

    def at(k):
        return Shaped.of(0.2, 0.1, 65.0, k).transfer(FX, FY)

    below, above = (np.asarray(at(sign * 1e-6) - normal) / (sign * 1e-6) for sign in (-1, 1))
    assert below == pytest.approx(above, abs=1e-5)


@pytest.mark.parametrize(
    ("build", "values"),
    [
        (lambda: Ellipse.of(0.3, -0.1), ["Semi-axes", "0.3 and -0.1"]),
        (lambda: Lissajous.of(-0.3, 0.1), ["Amplitudes", "-0.3 and 0.1"]),
        (lambda: Shaped.of(0.2, 0.1, 0.0, -2.5), ["kurtosis", "below -2", "got -2.5"]),
        (lambda: Shaped.of(-0.2), ["Sigmas", "-0.2 and -0.2"]),
    ],
)
def test_impossible_sizes_are_refused(build, values):
    with refused(ErrorCode.OUT_OF_RANGE, *values, error=ConfigurationError):
        build()


def test_second_derivatives_of_a_shaped_blur_are_the_same_either_way():
    locus, fx, fy = Shaped.of(0.2, 0.1, 65.0, -1.2), np.linspace(-1, 1, 5), np.linspace(-0.8, 1.1, 5)

    def total(coords):
        return locus.at(coords).transfer(fx, fy).sum()

    coords = np.asarray(locus.coords)
    forward, backward = (jax.jit(outer(jax.jacfwd(total)))(coords) for outer in (jax.jacfwd, jax.jacrev))
    assert np.asarray(backward) == pytest.approx(np.asarray(forward), rel=1e-12, abs=1e-11)
