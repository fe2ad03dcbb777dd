"""What holds of image and derivatives for every scene, locus and wavefront there can be."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from jitterkit.forward import Parameters, expected_image, image_and_jacobian, to_vector
from jitterkit.likelihood import Data, deviance
from jitterkit.loci import (
    LOCI,
    Ellipse,
    Linear,
    Lissajous,
    Mvn,
    PartialShm,
    Path,
    Shaped,
    Shm,
    Skewed,
    Smear,
    Stable,
    Tones,
)
from jitterkit.optics import OTF, Grid, expand, lines, obstructed_circle
from jitterkit.scene import Binary

STATE = np.array([10.0, -5.0])
GRID = Grid((14, 12), 0.375, 8)
FINEST = 2 * np.pi * np.sqrt(2) * GRID.nyquist
"""The highest frequency of the grid, at its corner, in radians per arcsec."""

FEW = settings(
    max_examples=8,
    derandomize=True,
    deadline=None,
    database=None,
    suppress_health_check=[
        HealthCheck.function_scoped_fixture,
        HealthCheck.too_slow,
        HealthCheck.filter_too_much,
    ],
)

SCENES = st.fixed_dictionaries(
    {
        "separation": st.one_of(st.just(0.0), st.floats(1e-9, 30.0)),
        "theta": st.floats(-360.0, 720.0),
        "x": st.floats(-4.0, 4.0),
        "y": st.floats(-4.0, 4.0),
        "flux": st.floats(0.0, 12.0).map(lambda decades: 10.0**decades),
        "contrast": st.floats(0.0, 6.0).map(lambda decades: 10.0**decades),
    }
)
SIZES = st.fixed_dictionaries(
    {
        "size": st.one_of(st.sampled_from([0.0, 1e-12, 0.375, 3.75, 12.0]), st.floats(1e-3, 3.0)),
        "share": st.one_of(st.sampled_from([0.0, 1e-9, 1.0]), st.floats(0.0, 1.0)),
        "angle": st.floats(-180.0, 360.0),
        "other": st.floats(0.0, 1.0),
    }
)
WAVEFRONTS = st.tuples(st.floats(-600.0, 600.0), st.floats(-600.0, 600.0))
SKIES = st.floats(0.0, 1e4)

BUILD = {
    "stable": lambda size, share, angle, other: Stable.of(),
    "linear": lambda size, share, angle, other: Linear.of(size, angle),
    "shm": lambda size, share, angle, other: Shm.of(size, angle),
    "mvn": lambda size, share, angle, other: Mvn.sheared(size / 4, share, angle),
    "ellipse": lambda size, share, angle, other: Ellipse.of(size / 2, share * size / 2, angle),
    "lissajous": lambda size, share, angle, other: Lissajous.of(size / 2, share * size / 2, angle),
    "tones": lambda size, share, angle, other: Tones.of(size, angle, share * size, angle + 180 * other),
    "partial": lambda size, share, angle, other: PartialShm.of(size, angle, 0.05 + 2.95 * other, 90 * share),
    "smear": lambda size, share, angle, other: Smear.of(
        size, angle, share * size / 4, share**2 * size / 4, other
    ),
    "skewed": lambda size, share, angle, other: Skewed.of(
        size / 4, share * size / 4, angle, *(other - 0.5) * (size / 4) ** 3 * np.ones(4)
    ),
    "shaped": lambda size, share, angle, other: Shaped.of(
        size / 4, share * size / 4, angle, 4.5 * other - 1.5
    ),
    "path": lambda size, share, angle, other: Path.of(
        size * np.array([[-0.5, 0.0], [-0.1, share], [0.2, other], [0.5, angle / 360]])
    ),
}


@pytest.fixture(scope="module")
def otf():
    pupil = obstructed_circle(0.12, 0.04, strut_width=0.004, struts=3, noll=(5, 7), samples=64)
    return expand(pupil, lines(550.0, 600.0), GRID, STATE)


WAYS = ["mvn", "partial", "shaped", "path"]
"""A locus for each way in which a transfer function is computed: formula, nodes, series, spline."""


@pytest.fixture(params=[k if k in WAYS else pytest.param(k, marks=pytest.mark.slow) for k in LOCI])
def kind(request):
    """Any locus; those of one way differ by their transfer functions, which have a test of their own."""
    return request.param


@pytest.fixture(params=WAYS)
def way(request):
    return request.param


@pytest.fixture
def nothing_compiled():
    """A program that JAX keeps of 64 bits may meet constants of 32, where a process changes them."""
    jax.clear_caches()


def parameters(kind, scene, sizes, change=(0.0, 0.0), sky=0.0):
    return Parameters(Binary(**scene), BUILD[kind](**sizes), STATE + np.asarray(change), sky)


def every(p):
    return tuple(range(to_vector(p)[0].size))


slope_of_the_deviance = eqx.filter_jit(eqx.filter_grad(deviance))


@FEW
@given(scene=SCENES, sizes=SIZES, change=WAVEFRONTS, sky=SKIES)
def test_image_and_every_derivative_are_finite(kind, otf, scene, sizes, change, sky):
    p = parameters(kind, scene, sizes, change, sky)
    image, jacobian = image_and_jacobian(p, otf, every(p))
    data = Data(np.full(GRID.shape, scene["flux"] / image.size), 4.0)
    assert np.all(np.isfinite(image))
    assert np.all(np.isfinite(jacobian))
    assert np.all(np.isfinite(to_vector(slope_of_the_deviance(p, otf, data))[0]))


@settings(FEW, max_examples=1)
@given(scene=SCENES, sizes=SIZES, change=WAVEFRONTS, sky=SKIES)
def test_compiled_and_eager_images_are_equal_to_rounding(way, otf, scene, sizes, change, sky):
    p = parameters(way, scene, sizes, change, sky)
    compiled = np.asarray(expected_image(p, otf))
    with jax.disable_jit():
        eager = np.asarray(expected_image(p, otf))
    assert compiled == pytest.approx(eager, rel=0, abs=bound(p, otf, np.finfo(float).eps / 2))


@settings(FEW, max_examples=4)
@given(scenes=st.lists(SCENES, min_size=3, max_size=3), sizes=st.lists(SIZES, min_size=3, max_size=3))
def test_a_batch_gives_what_its_members_give(way, otf, scenes, sizes):
    members = [parameters(way, *pair) for pair in zip(scenes, sizes, strict=True)]
    _, unravel = to_vector(members[0])
    vectors = jnp.stack([to_vector(p)[0] for p in members])
    images, jacobians = jax.vmap(lambda v: image_and_jacobian(unravel(v), otf, every(members[0])))(vectors)
    for p, image, jacobian in zip(members, images, jacobians, strict=True):
        alone, slopes = (np.asarray(array) for array in image_and_jacobian(p, otf, every(p)))
        assert np.asarray(image) == pytest.approx(alone, rel=0, abs=bound(p, otf, np.finfo(float).eps / 2))
        # the root of a partial's even share near one has a slope of 1/sqrt(eps), which rounding meets
        loose = 1e-7 if way == "partial" else 1e-11
        size = np.abs(slopes).max(axis=(1, 2), keepdims=True)
        assert np.all(np.abs(np.asarray(jacobian) - slopes) <= loose * (size + float(p.scene.flux))), way


@FEW
@given(scene=SCENES, sizes=SIZES)
def test_32_bits_give_the_image_of_64_to_their_rounding(nothing_compiled, way, otf, scene, sizes):
    p = parameters(way, scene, sizes)
    assume(p.locus.exact_to() > FINEST / (2 * np.pi))
    double = np.asarray(expected_image(p, otf))
    with jax.enable_x64(False):
        small = (otf.value, otf.slopes, otf.state)
        single_otf = OTF(*(jnp.asarray(np.asarray(part)) for part in small), GRID, otf.names)
        q = parameters(way, scene, sizes)
        assume(q.locus.exact_to() > FINEST / (2 * np.pi))
        single = expected_image(q, single_otf)
        assert single.dtype == np.float32
        single = np.asarray(single)
    assert single == pytest.approx(double, rel=0, abs=bound(p, otf, np.finfo(np.float32).eps / 2))


def bound(p, otf, unit):
    """Most that rounding by ``unit`` of every operation does to a pixel of an image without sky.

    A pixel is a sum over frequencies, so that it is off by no more than the sum of what each is off by:
    ``flux B d``, where ``B = sum |OTF|/N`` is the share of a star's light in the peak of a perfect image
    (each frequency counted with its mirror) and ``d`` the greatest relative error of the factors.  With
    ``F`` the highest frequency in radians per arcsec:

    * A star's phase ``F r``, r its distance from the first sample, is a product of five rounded numbers and
      holds a direction that is rounded too, in radians: ``(5 + theta) F r``.
    * A locus is a smooth function of ``w``, a sum of three products in f, of slope one half at most at none;
      the three cancel where f lies across a streak: off by ``8 F² tr Σ`` at most, and by the rounding of
      its operations; a series or a sum of nodes has up to a hundred of them: ``100``.
    * The transform is off by two roundings a stage, the products by a few: ``2 log2 N + 10``.
    """
    x, y, _ = (np.asarray(part) for part in p.scene.sources())
    cy, cx = GRID.centre
    far = float(np.max(np.hypot(np.abs(x) + cx, np.abs(y) + cy)))
    sxx, _, syy = (float(s) for s in p.locus.moments())
    stars = (5 + abs(np.radians(float(p.scene.theta)))) * FINEST * far
    locus = 8 * FINEST**2 * max(sxx + syy, 0.0) + 100
    passed = np.abs(np.asarray(otf.at(p.aberrations)))
    share = 2 * float(passed.sum()) / np.prod(GRID.fine_shape)
    steps = stars + locus + 2 * np.log2(np.prod(GRID.fine_shape)) + 10
    return unit * (float(p.scene.flux) * share * steps + 2 * float(p.background))


def test_a_star_a_million_times_fainter_keeps_its_light_in_32_bits():
    with jax.enable_x64(False):
        _, _, fluxes = Binary(4.0, 0.0, 0.0, 0.0, 1e12, 1e6).sources()
        faint = float(fluxes[1])
    assert faint == pytest.approx(1e12 / (1e6 + 1), rel=4 * 6e-8)
