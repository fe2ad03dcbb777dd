"""The laws every jitter locus keeps; a new one is held to them by its line in the registry."""

import os
import re
import subprocess
import sys

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from refusals import refused

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.loci import (
    LOCI,
    Ellipse,
    Linear,
    Lissajous,
    Mvn,
    PartialShm,
    Path,
    Product,
    Shaped,
    Shm,
    Skewed,
    Smear,
    Stable,
    Tones,
    Trace,
    locus_name,
    principal_axes,
    rasterise,
)
from jitterkit.loci.base import moments_of
from jitterkit.loci.simple import AnySimple

KNOTS = np.array([[0.0, 0.0], [0.4, 0.1], [0.5, 0.4], [0.3, 0.6]])
TIMES = np.array([0.0, 0.07, 0.2, 0.26, 0.4, 0.55, 0.6, 0.83, 0.9, 1.0])
SAMPLES = np.stack([0.3 * np.sin(9 * TIMES), 0.5 * TIMES**2], axis=1)


def rotation(angle):
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    return np.array([[c, -s], [s, c]])


def matrix(moments):
    sxx, sxy, syy = np.asarray(moments)
    return np.array([[sxx, sxy], [sxy, syy]])


def turned_lissajous(size, turn):
    """A phase between axes is of these axes, so that a turned one is built from its moments."""
    moments = rotation(turn) @ matrix(Lissajous.of(0.3, 0.2, 50.0).moments()) @ rotation(turn).T
    return Lissajous.near(size**2 * moments[[0, 0, 1], [0, 1, 1]])


def skewed(size, turn):
    """A skewness of 0.4 along the major axis, 0.2 by 0.1 arcsec at 65 degrees."""
    c, s = np.cos(np.radians(65.0 + turn)), np.sin(np.radians(65.0 + turn))
    third = 0.4 * (0.2 * size) ** 3 * np.array([c**3, c * c * s, c * s * s, s**3])
    names = ("cumulant_xxx", "cumulant_xxy", "cumulant_xyy", "cumulant_yyy")
    return Skewed.of(0.2 * size, 0.1 * size, 65.0 + turn, **dict(zip(names, third, strict=True)))


def from_moments(kind):
    """Builds a locus of any kind, as EXAMPLES do; by default 0.2 by 0.1 arcsec at 65 degrees."""
    moments = matrix(Mvn.of(0.2, 0.1, 65.0).moments())

    def example(size=1.0, turn=0.0):
        turned = rotation(turn) @ moments @ rotation(turn).T
        return kind.near(size**2 * turned[[0, 0, 1], [0, 1, 1]])

    return example


EXAMPLES = {
    "stable": lambda size=1.0, turn=0.0: Stable.of(),
    "linear": lambda size=1.0, turn=0.0: Linear.of(0.75 * size, 20.0 + turn),
    "shm": lambda size=1.0, turn=0.0: Shm.of(0.6 * size, 110.0 + turn),
    "mvn": lambda size=1.0, turn=0.0: Mvn.of(0.2 * size, 0.1 * size, 65.0 + turn),
    "ellipse": lambda size=1.0, turn=0.0: Ellipse.of(0.4 * size, 0.15 * size, 140.0 + turn),
    "lissajous": lambda size=1.0, turn=0.0: turned_lissajous(size, turn),
    "tones": lambda size=1.0, turn=0.0: Tones.of(0.6 * size, 15.0 + turn, 0.4 * size, 105.0 + turn),
    "partial": lambda size=1.0, turn=0.0: PartialShm.of(0.8 * size, 40.0 + turn, 0.7, 25.0),
    "smear": lambda size=1.0, turn=0.0: Smear.of(
        0.5 * size, 30.0 + turn, 0.1 * size, 0.05 * size, 70.0 + turn
    ),
    "shaped": lambda size=1.0, turn=0.0: Shaped.of(0.2 * size, 0.1 * size, 65.0 + turn, 1.0),
    "skewed": lambda size=1.0, turn=0.0: skewed(size, turn),
    "path": lambda size=1.0, turn=0.0: Path.of(size * KNOTS @ rotation(turn).T),
    "shaped, light": lambda size=1.0, turn=0.0: Shaped.of(0.2 * size, 0.1 * size, 65.0 + turn, -1.2),
    "product": lambda size=1.0, turn=0.0: Product(
        Linear.of(0.3 * size, 160.0 + turn), Mvn.of(0.1 * size, 0.05 * size, 20.0 + turn)
    ),
    "any simple, a streak": lambda size=1.0, turn=0.0: AnySimple.instead_of(Shm.of(0.6 * size, 110.0 + turn)),
    "any simple, elliptic": lambda size=1.0, turn=0.0: AnySimple.instead_of(
        Mvn.of(0.2 * size, 0.1 * size, 65.0 + turn)
    ),
    "trace": lambda size=1.0, turn=0.0: Trace.of(TIMES, *(size * SAMPLES @ rotation(turn).T).T),
}
OTHERS = tuple(name for name in LOCI if name not in EXAMPLES)
"""New loci, without an example above: built from moments and held to the tolerances of random ones."""
EXAMPLES |= {name: from_moments(LOCI[name]) for name in OTHERS}
# their points are a grid of quantiles
GRIDS = ("mvn", "any simple, elliptic", "smear", "skewed", "product", *OTHERS)
UNNAMED = ("product", "trace", "any simple")  # built from loci or samples, not from sizes
RANDOM = (*GRIDS, "shaped", "shaped, light")
ALONG_X, ALONG_Y = np.linspace(-1.2, 1.2, 13), np.linspace(-1.1, 1.1, 12)
FX, FY = (f.ravel() for f in np.meshgrid(ALONG_X, ALONG_Y))


SECOND = "any simple, a streak"
"""Has the values and derivatives of the streak that it stands for (test_simple)."""


@pytest.fixture(
    params=[
        *LOCI,
        *(kind for kind in EXAMPLES if kind not in (*LOCI, SECOND)),
        pytest.param(SECOND, marks=pytest.mark.slow),
    ]
)
def kind(request):
    return request.param


@pytest.fixture
def example(kind):
    """Builds one locus of a kind, at a relative size, turned counter-clockwise by some degrees."""
    return EXAMPLES[kind]


def mean_phasor(offsets):
    """At FX, FY; of offsets along x and along y the phasors multiply."""
    pairs = zip((ALONG_X, ALONG_Y), np.asarray(offsets).T, strict=True)
    along_x, along_y = (np.exp(-2j * np.pi * np.multiply.outer(f, some)) for f, some in pairs)
    return (along_y @ along_x.T).ravel() / len(offsets)


def test_the_transfer_function_is_one_at_zero_frequency(example):
    assert complex(example().transfer(np.float64(0), np.float64(0))) == pytest.approx(1.0, abs=4e-15)


def test_the_transfer_function_never_exceeds_one(example):
    assert np.all(np.abs(example().transfer(5 * FX, 5 * FY)) <= 1 + 4e-16)


def test_opposite_frequencies_have_conjugate_values(example):
    # The density is real.
    locus = example()
    there, back = (np.asarray(locus.transfer(sign * FX, sign * FY)) for sign in (1, -1))
    assert there == pytest.approx(back.conj(), abs=1e-15)


def test_an_open_grid_gives_what_single_frequencies_give(example):
    locus = example()
    grid = np.asarray(locus.transfer(ALONG_X[None, :], ALONG_Y[:, None]))
    assert grid.ravel() == pytest.approx(np.asarray(locus.transfer(FX, FY)), abs=1e-14)


def test_one_name_stands_for_each_coordinate(example):
    locus = example()
    assert locus.coords.shape == (len(locus.names),)
    assert len(set(locus.names)) == len(locus.names)


def test_every_locus_of_the_registry_knows_its_coordinates_before_it_is_built():
    for name, kind in LOCI.items():
        assert tuple(kind.names) == EXAMPLES[name]().names
        assert locus_name(EXAMPLES[name]()) == name


def test_no_two_kinds_share_the_name_of_a_coordinate():
    names = [name for kind in LOCI.values() for name in kind.names]
    assert len(names) == len(set(names))


def test_the_first_derivatives_vanish_because_the_mean_offset_does(example):
    locus = example()
    slope = jax.jit(jax.jacfwd(lambda f: locus.transfer(f[0], f[1])))(np.zeros(2))
    assert np.abs(slope) == pytest.approx(np.zeros(2), abs=1e-14)


def test_the_curvature_of_the_transfer_function_gives_the_second_moments(example):
    # M = 1 - 2 pi^2 f'Sf + ..., the first terms of the characteristic function of any density.
    locus = example()
    slope = jax.jacfwd(lambda f: jnp.real(locus.transfer(f[0], f[1])))
    curvature = jax.jit(jax.jacfwd(slope))(np.zeros(2))
    assert np.asarray(curvature) == pytest.approx(
        -4 * np.pi**2 * matrix(locus.moments()), rel=1e-12, abs=1e-14
    )


def test_the_transfer_function_is_the_mean_phasor_over_the_points(kind, example):
    locus = example()
    # The 256 quantiles of a normal axis, or 40 in a product, miss 2.5 % of its fourth moment 3 s^4, or
    # 7 %; at (2 pi f s) = 1.6 that is 3 * 0.025 * 1.6^4 / 24 = 0.02 before the decay of M.  Rings do so
    # once; of a trace's straight pieces, 0.1 arcsec, three nodes leave 5e-7 (2 pi f 0.1)^6 = 5e-7.  The
    # others are a thousand times closer.
    tolerance = {**dict.fromkeys(GRIDS, 2e-2), "shaped": 1e-3, "shaped, light": 1e-3, "trace": 1e-6}
    difference = mean_phasor(locus.points(65536)) - locus.transfer(FX, FY)
    assert np.abs(difference).max() < tolerance.get(kind, 1e-9)


def test_the_transfer_function_is_the_mean_phasor_over_a_trace(kind, example, rng):
    locus, n = example(), 16384
    difference = mean_phasor(locus.trace(n, rng)) - locus.transfer(FX, FY)
    # The mean of n phasors drawn at random is off by 1/sqrt(n) at most; four times that, 156 frequencies.
    assert np.abs(difference).max() < (4 / np.sqrt(n) + 1e-3 if kind in RANDOM else 1e-6)


def test_the_points_have_the_second_moments(kind, example):
    locus = example()
    points = locus.points(65536)
    # Straight pieces of a trace meet between two points: a share of 1/n^2 of each.
    assert points.mean(axis=0) == pytest.approx(np.zeros(2), abs=1e-10)
    # The midpoint rule is short of an integral of x^2 by 1/n^2 of it, n = 65536, or 256 in a product.
    short = 256**-2 if isinstance(locus, Product) else 1e-9
    expected = matrix(locus.moments())
    assert points.T @ points / len(points) == pytest.approx(expected, abs=short * np.trace(expected) + 1e-14)


@pytest.mark.parametrize("angle", [0.0, 1.0, 30.0, 90.0])
@pytest.mark.parametrize("kind", [Linear, Shm])
def test_errors_of_moments_are_the_scatter_of_drawn_motions_along_an_axis_too(kind, angle, rng):
    locus = kind.of(0.8, angle)
    covariance = 0.01**2 * np.array([[1.0, 0.3], [0.3, 0.8]])
    coords = rng.multivariate_normal(np.asarray(locus.coords), covariance, 40_000)
    drawn = np.asarray(jax.vmap(lambda c: locus.at(c).moments())(jnp.asarray(coords)))
    _, told = moments_of(locus, locus.names, covariance)
    # Errors of standard deviations: 0.5 % of 40,000 draws; what is of third order, (0.01/0.4)^2 and less.
    assert np.sqrt(np.diag(told)) == pytest.approx(drawn.std(axis=0), rel=0.02)


def test_a_motion_no_longer_than_its_error_has_errors_to_first_order(rng):
    locus, covariance = Linear.of(0.05, 30.0), 0.02**2 * np.eye(2)
    slope = np.asarray(jax.jacfwd(lambda c: locus.at(c).moments())(jnp.asarray(locus.coords)))
    first = slope @ covariance @ slope.T
    np.testing.assert_allclose(moments_of(locus, locus.names, covariance)[1], first, atol=1e-15)


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
    turn = rotation(17.0)
    locus, turned = example(), example(turn=17.0)
    expected = turn @ matrix(locus.moments()) @ turn.T
    assert matrix(turned.moments()) == pytest.approx(expected, abs=1e-15)
    fx, fy = turn @ np.stack([FX, FY])
    assert np.asarray(turned.transfer(fx, fy)) == pytest.approx(np.asarray(locus.transfer(FX, FY)), abs=2e-14)


@eqx.filter_jit
def orders(locus):
    """Value, gradient and Hessian of something made of the transfer function, and the moments' slope."""

    def total(coords):
        spectrum = locus.at(coords).transfer(FX, FY)
        return jnp.sum(jnp.real(spectrum) + FX * jnp.imag(spectrum))

    c = locus.coords
    slope = jax.jacfwd(lambda coords: locus.at(coords).moments())(c)
    hessian, gradient = jax.jacfwd(lambda coords: (jax.jacfwd(total)(coords),) * 2, has_aux=True)(c)
    return total(c), gradient, hessian, slope


def test_values_and_derivatives_are_finite_at_no_size_and_at_tiny_sizes(example):
    for size in (0.0, 1e-80, 1e-9, 1e-3):
        value, *derivatives = orders(example(size))
        assert float(value) == pytest.approx(FX.size, rel=1e-4)
        assert all(np.all(np.isfinite(order)) for order in derivatives)


BY_MOMENTS = ("stable", "linear", "shm", "mvn", "ellipse", "lissajous")


@pytest.mark.parametrize("name", LOCI)
def test_the_locus_nearest_to_given_moments_has_them(name):
    locus = EXAMPLES[name]()
    again = type(locus).near(locus.moments())
    assert np.asarray(again.moments()) == pytest.approx(np.asarray(locus.moments()), abs=1e-15)
    if name in BY_MOMENTS:
        # A streak's minor variance is a difference of nearly equal numbers: rounding, 1e-16 / S.
        assert np.asarray(again.coords) == pytest.approx(np.asarray(locus.coords), abs=1e-14)


@pytest.mark.parametrize("name", LOCI)
def test_near_accepts_moments_that_are_noise_about_zero(name):
    locus = LOCI[name].near(np.array([-1e-4, 2e-5, -3e-5]))
    assert np.all(np.isfinite(np.asarray(locus.transfer(FX, FY))))


@pytest.mark.parametrize("name", ["product", "trace"])
def test_what_moments_do_not_determine_is_not_made_of_them(name):
    with refused(ErrorCode.UNSUPPORTED, name, error=ConfigurationError):
        type(EXAMPLES[name]()).near([0.1, 0.0, 0.1])


@pytest.mark.parametrize("name", [name for name in EXAMPLES if name.split(",")[0] not in UNNAMED])
def test_a_description_rebuilds_the_locus(name):
    locus = EXAMPLES[name]()
    described = {k: v for k, v in locus.describe().items() if k != "shear"}
    if name == "path":
        described = {"knots": np.reshape(list(described.values()), (-1, 2))}
    again = type(locus).of(**described)
    assert again.describe() == pytest.approx(locus.describe(), abs=1e-7)
    assert np.asarray(again.transfer(FX, FY)) == pytest.approx(np.asarray(locus.transfer(FX, FY)), abs=1e-14)


def test_principal_axes_agree_with_an_eigenvalue_solver(example):
    moments = example().moments()
    minor, major = np.sqrt(np.maximum(np.linalg.eigvalsh(matrix(moments)), 0))
    found = principal_axes(moments)
    # The square root turns rounding of 1e-17 about a zero minor axis into 3e-9.
    assert found[:2] == pytest.approx((major, minor), abs=2e-8)
    assert 0 <= found[2] < 180


ADD = """
import re
from jitterkit.docs import read_page
from jitterkit.loci import LOCI
scope = {}
exec(re.search(r"```python\\n(.*?)```", read_page("extending"), re.S)[1], scope)
LOCI["laplace"] = scope["Laplace"]
"""


@pytest.mark.slow
def test_a_locus_added_as_the_handbook_says_is_held_to_the_contract(tmp_path):
    (tmp_path / "add_laplace.py").write_text(ADD, encoding="utf-8")
    command = [sys.executable, "-m", "pytest", "-q", "-p", "add_laplace", __file__, "-k", "laplace"]
    path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(command, env=os.environ | {"PYTHONPATH": path}, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout
    assert re.search(r"^1[0-9] passed", done.stdout, re.M), done.stdout
