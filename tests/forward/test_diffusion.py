"""Charge diffusion: the detector's own, in the OTF, and the part of it that is fitted."""

import numpy as np
import pytest

from jitterkit.forward import Parameters, expected_image, image_and_jacobian, parameter_names
from jitterkit.loci import Linear, Stable
from jitterkit.optics import FixedOptics, Grid, OpticalSystem, empirical_otf, lines, obstructed_circle
from jitterkit.scene import Star

SPECTRUM = lines(550.0)


@pytest.fixture(scope="module")
def pupil():
    # a telescope of its own, with one aberration: its transfer function is computed by hand
    return obstructed_circle(0.12, 0.04, noll=(4,), samples=128)


def image(otf, **options):
    parameters = Parameters(Star(0.1, -0.3, 1.0), Linear.of(0.3, 20.0), otf.state, **options)
    return np.asarray(expected_image(parameters, otf))


def moments(image):
    x = (np.arange(400) - 199.5) * 0.375
    return np.array([np.sum(image * x**2), np.sum(image * np.outer(x, x)), np.sum(image * x[:, None] ** 2)])


@pytest.mark.parametrize("variance", [0.04, -0.01])
def test_it_adds_its_variance_along_both_axes_and_keeps_the_light(pupil, variance):
    otf = OpticalSystem(pupil, SPECTRUM, Grid((400, 400), 0.375, 0)).nominal
    sharp, soft = image(otf), image(otf, diffusion=variance)
    assert soft.sum() == pytest.approx(sharp.sum(), rel=1e-12)
    # Rings at the edge of the frame move in and out by the blur: 75^2 arcsec^2 times 1e-7 of the light.
    added = moments(soft) - moments(sharp)
    assert added == pytest.approx(sharp.sum() * variance * np.array([1, 0, 1]), abs=2e-4)


def test_what_the_detector_has_and_what_is_fitted_beyond_it_add_up(pupil):
    grid = Grid((36, 30), 0.375, 20)
    bare, soft = OpticalSystem(pupil, SPECTRUM, grid), OpticalSystem(pupil, SPECTRUM, grid, diffusion=0.15)
    for state in (np.zeros(1), np.array([20.0])):
        whole = image(bare.otf(state), diffusion=0.15**2 + 0.01)
        assert image(soft.otf(state), diffusion=0.01) == pytest.approx(whole, rel=1e-10)
        assert image(soft.otf(state)) == pytest.approx(image(bare.otf(state), diffusion=0.15**2), rel=1e-10)
    assert image(soft.nominal) == pytest.approx(image(soft.otf(np.zeros(1))), rel=1e-12)


def test_the_derivatives_by_the_aberrations_are_blurred_too(pupil):
    system = OpticalSystem(pupil, SPECTRUM, Grid((36, 30), 0.375, 20), diffusion=0.2)
    otf = system.otf(np.array([20.0]))
    parameters = Parameters(Star(0.1, -0.3, 1e6), Stable.of(), otf.state, diffusion=0.0)
    k = parameter_names(parameters, otf.names).index("noll4")
    _, jacobian = image_and_jacobian(parameters, otf, (k,))
    high, low = (
        expected_image(parameters, system.otf(np.array([20.0 + step]), derivatives=False))
        for step in (0.05, -0.05)
    )
    measured = np.asarray(high - low) / 0.1
    assert np.asarray(jacobian[0]) == pytest.approx(measured, abs=1e-5 * np.abs(measured).max())


def test_a_measured_star_holds_the_diffusion_already():
    star = np.exp(-(np.hypot(*np.indices((21, 21)) - 10.0) ** 2) / 8)
    otf = FixedOptics(empirical_otf(star, 0.375, (36, 30))).nominal
    sharp, soft = image(otf), image(otf, diffusion=0.0)
    assert soft == pytest.approx(sharp, rel=1e-12)


def test_without_it_there_is_no_such_parameter():
    parameters = Parameters(Star(0.0, 0.0, 1.0), Stable.of())
    assert parameter_names(parameters, ())[-1] == "background_y"
    assert parameters.diffusion is None
