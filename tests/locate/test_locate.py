"""Finding the pair: any angle, place, distance and contrast, and nothing where there is nothing."""

import equinox as eqx
import numpy as np
import pytest

from jitterkit.conventions import offsets
from jitterkit.forward import Parameters, expected_image
from jitterkit.likelihood import Data
from jitterkit.locate import Residual, find_pairs, locate_binary, locate_star, resolution
from jitterkit.loci import Linear, Mvn, Stable
from jitterkit.optics import flat_band, grid_for, obstructed_circle
from jitterkit.optics.system import OpticalSystem
from jitterkit.scene import Binary, Star

_image = eqx.filter_jit(expected_image)


@pytest.fixture(scope="module")
def optics(toliman):
    band = flat_band(530, 640, 13)
    return OpticalSystem(toliman, band, grid_for(toliman, band, (128, 128), 0.375))


def frame(optics, scene, locus, aberrations, rng):
    otf = optics.otf(aberrations, derivatives=False)
    image = np.asarray(_image(Parameters(scene, locus, aberrations), otf))
    return Data(rng.poisson(np.maximum(image, 0)) + rng.normal(0, 2.4, image.shape), 2.4**2)


def positions(scene):
    """Offsets of both stars, the brighter first (2, 2)."""
    half = float(scene.separation) / 2
    angle = np.radians(float(scene.theta))
    middle, arm = np.array([scene.x, scene.y]), half * np.array([np.cos(angle), np.sin(angle)])
    return np.array([middle - arm, middle + arm], float)


SCENES = [
    # separation, theta, x, y, contrast: distances and contrasts at their limits, stars near the edges
    (2.0, 10.0, 0.0, 0.0, 1.05),
    (2.0, 30.0, 1.0, -2.0, 100.0),
]
MORE = [
    (20.0, 120.0, 5.0, 2.0, 30.0),
    (10.0, 200.0, -17.0, 15.0, 3.37),
    (2.0, 250.0, 3.0, -8.0, 30.0),
    (5.0, 330.0, 20.5, -20.5, 10.0),
    (10.0, 80.0, -3.0, 2.5, 100.0),
    (10.0, 290.0, 4.0, 1.0, 100.0),
    (20.0, 200.0, -2.0, -1.0, 100.0),
]


def test_a_flat_of_one_value_leaves_a_pair_as_significant(plain_otf, rng):
    """The chi-squared explained is that of the counts themselves."""
    otf = plain_otf
    scene = Binary(5.0, 40.0, 0.1, 0.05, 1e6, 3.37)
    image = np.asarray(expected_image(Parameters(scene, Stable.of()), otf))
    counts = rng.poisson(np.maximum(image, 0)) + rng.normal(0, 2.4, image.shape)
    (one, *_), (other, *_) = (
        find_pairs(data, otf) for data in (Data(counts, 2.4**2), Data(counts / 0.3, 2.4**2, response=0.3))
    )
    assert other.gain == pytest.approx(one.gain, rel=1e-6)
    assert float(other.scene.flux) == pytest.approx(float(one.scene.flux) / 0.3, rel=1e-6)


@pytest.mark.parametrize(
    "values", [*SCENES, *(pytest.param(scene, marks=pytest.mark.slow) for scene in MORE)]
)
def test_the_pair_is_found_through_jitter_and_aberrations(values, optics, rng):
    separation, theta, x, y, contrast = values
    truth = Binary(separation, theta, x, y, 9.53e6, contrast)
    data = frame(optics, truth, Linear.of(0.5, 70.0), rng.normal(0, 5, 7), rng)
    found = locate_binary(data, optics).parameters.scene
    ordered = positions(found) if contrast > 1.2 else sorted(positions(found).tolist())
    expected = positions(truth) if contrast > 1.2 else sorted(positions(truth).tolist())
    # a twentieth of a pixel, far inside the half resolution element (0.5 arcsec) that a fit needs
    np.testing.assert_allclose(ordered, expected, atol=0.02)


def test_equal_stars_are_two_stars(optics, rng):
    truth = Binary(2.0, 45.0, 1.0, 1.0, 9.53e6, 1.0)
    pairs = find_pairs(frame(optics, truth, Stable.of(), np.zeros(7), rng), optics.nominal)
    assert float(pairs[0].scene.separation) == pytest.approx(2.0, abs=0.1)


@pytest.mark.parametrize("noise", [0.0, 5.0])
def test_an_empty_frame_has_no_star(noise, optics, rng):
    empty = Data(rng.normal(0, 1, (128, 128)) * noise + 100.0, noise**2)
    assert find_pairs(empty, optics.nominal) == []
    assert locate_binary(empty, optics) is None


def test_masked_pixels_do_not_mislead(optics, rng):
    truth = Binary(10.0, 45.0, 1.0, 1.0, 9.53e6, 3.37)
    data = frame(optics, truth, Mvn.of(0.1), np.zeros(7), rng)
    counts, used = np.array(data.electrons), np.ones((128, 128), bool)
    used[40:50, 60:90] = False
    counts[~used] = 1e7
    found = locate_binary(Data(counts, 2.4**2, used), optics).parameters.scene
    np.testing.assert_allclose(positions(found), positions(truth), atol=0.02)


def test_a_large_telescope_finds_a_close_pair(rng):
    # a telescope of its own: that one is ten times as large, with pixels a ninth as wide, is what is tested
    pupil, band = obstructed_circle(1.25, 0.4, samples=64, noll=()), flat_band(530, 640, 3)
    optics = OpticalSystem(pupil, band, grid_for(pupil, band, (64, 64), 0.04, pad=32))
    truth = Binary(0.5, 45.0, 0.02, 0.01, 3e6, 3.37)
    image = np.asarray(expected_image(Parameters(truth, Stable.of()), optics.nominal))
    start = locate_binary(Data(rng.poisson(image), 1.0), optics)
    assert float(start.parameters.scene.separation) == pytest.approx(0.5, abs=0.002)
    assert resolution(optics.nominal) < 0.15


def test_the_blur_of_the_template_has_the_direction_that_it_is_given(plain_otf):
    scene, drift = Binary(5.0, 40.0, 0.1, 0.05, 1e6, 3.37), Linear.of(1.5, 0.0)
    data = Data(np.asarray(_image(Parameters(scene, drift, np.zeros(0)), plain_otf)), 2.4**2)
    along, across = (find_pairs(data, plain_otf, Linear.of(1.5, angle))[0] for angle in (0.0, 90.0))
    assert along.gain > across.gain  # no template explains more than the true one


@pytest.mark.parametrize("position", [(0.31, -0.22), (-17.0, 15.0)])
def test_one_star_is_found_through_jitter_and_aberrations(position, optics, rng):
    data = frame(optics, Star(*position, 9.53e6), Linear.of(0.5, 70.0), rng.normal(0, 5, 7), rng)
    start = locate_star(data, optics)
    scene = start.parameters.scene
    assert (float(scene.x), float(scene.y)) == pytest.approx(position, abs=0.02)
    assert float(scene.flux) == pytest.approx(9.53e6, rel=2e-3)
    moments = np.asarray(start.parameters.locus.moments())
    np.testing.assert_allclose(moments, np.asarray(Linear.of(0.5, 70.0).moments()), atol=1e-3)


def test_an_empty_frame_has_not_one_star(optics, rng):
    assert locate_star(Data(rng.normal(0, 5, (128, 128)), 25.0), optics) is None


def test_a_star_in_the_residual_explains_the_chi_squared_of_its_light(plain_otf):
    """Of white noise that is its flux squared times the sum of the squared PSF over the variance."""
    otf, variance = plain_otf, 30.0
    dark = np.zeros(otf.grid.shape)
    one = np.asarray(expected_image(Parameters(Star(3 * 0.375, -2 * 0.375, 100.0), Stable.of()), otf))
    star, gain = Residual(Data(one, variance), dark, otf).star()
    positions = offsets(one.shape[1], 0.375), offsets(one.shape[0], 0.375)
    nearest = [axis[np.argmin(np.abs(axis - v))] for axis, v in zip(positions, (1.125, -0.75), strict=True)]
    assert (float(star.x), float(star.y)) == pytest.approx(nearest)
    there = np.asarray(expected_image(Parameters(Star(*nearest, 1.0), Stable.of()), otf))
    assert gain == pytest.approx(np.sum(one * there) ** 2 / np.sum(there**2) / variance, rel=1e-6)
    assert float(star.flux) == pytest.approx(np.sum(one * there) / np.sum(there**2), rel=1e-6)


def test_the_signs_of_focus_and_astigmatism_are_those_that_fit_best():
    """A pupil that is nearly its own mirror image has a wrong hill, 480 lower, which chi-squared hides.

    A telescope of its own: the wrong hill takes all seven modes.
    """
    band, rng = flat_band(530, 640, 3), np.random.default_rng(14)
    pupil = obstructed_circle(0.125, 0.04, struts=3, strut_width=0.004, samples=64, noll=range(4, 11))
    optics = OpticalSystem(pupil, band, grid_for(pupil, band, (48, 44), 0.375, pad=16))
    state = rng.normal(0, 10, 7)
    truth = Parameters(Star(0.3, -0.2, 3e5), Mvn.of(0.15, 0.08, 30.0), state)
    image = np.asarray(_image(truth, optics.otf(state)))
    data = Data(rng.poisson(image) + rng.normal(0, 2.4, image.shape), 2.4**2)
    start = locate_star(data, optics)
    found = np.asarray(start.parameters.aberrations)
    assert np.sum(found * state) > 0.95 * np.linalg.norm(found) * np.linalg.norm(state)
    moments = np.asarray(start.parameters.locus.moments()) - np.asarray(truth.locus.moments())
    assert moments @ np.linalg.solve(start.covariance, moments) < 16.3  # once in a thousand, three moments
