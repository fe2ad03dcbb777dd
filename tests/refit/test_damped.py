"""Fits of faint frames through a segmented pupil, which shows some aberrations to second order first."""

from __future__ import annotations

import equinox as eqx
import numpy as np
import pytest

from jitterkit.forward import Parameters, expected_image, free_parameters, to_vector
from jitterkit.likelihood import Data
from jitterkit.loci import Mvn
from jitterkit.optics import Anchor, OpticalSystem
from jitterkit.optics.expansion import grid_for
from jitterkit.optics.observatories import jwst_pupil
from jitterkit.optics.pupil import open_pupil
from jitterkit.optics.spectrum import flat_band
from jitterkit.refit import FitOptions, Priors, Status, fit_frame
from jitterkit.refit.damped import _limited, _products, damped_scoring
from jitterkit.scene import Star

READ_NOISE = 2.4


@pytest.fixture(scope="module")
def segmented():
    """A pupil of 18 hexagons behind three struts, in 64 samples, with all modes from focus to spherical."""
    wide = jwst_pupil()
    light = np.asarray(wide.transmission).reshape(64, 4, 64, 4).mean(axis=(1, 3))
    pupil, band = open_pupil(light, wide.diameter, range(4, 12)), flat_band(4500.0, 5100.0, 3)
    return OpticalSystem(pupil, band, grid_for(pupil, band, (48, 48), 0.0656, pad=12))


def exact_cost(data, system, parameters, sigma):
    """Deviance, up to a constant, with optics computed for these very aberrations; and the prior's."""
    image = np.asarray(expected_image(parameters, system.otf(parameters.aberrations)))
    counts = np.asarray(data.electrons) + READ_NOISE**2
    level = image + READ_NOISE**2
    deviance = 2 * float(np.sum(level - counts * np.log(level)))
    return deviance + float(np.sum((np.asarray(parameters.aberrations) / (sigma or np.inf)) ** 2))


@pytest.mark.parametrize(
    ("seed", "flux", "sigma"),
    [(0, 2e3, None), (5, 2e3, None), (6, 2e3, None), (6, 6e3, None), (7, 2e3, 300.0), (6, 6e3, 300.0)],
)
def test_a_fit_settles_where_aberrations_are_hardly_seen(segmented, seed, flux, sigma):
    """Expansions went to and fro between wavefronts of hundreds of nm, or farther and farther away."""
    rng = np.random.default_rng([3, seed])
    star, blur = Star(0.01, -0.02, flux), Mvn.of(0.06, 0.03, 20.0)
    truth = Parameters(star, blur, rng.normal(0.0, 5.0, 8))
    image = np.asarray(expected_image(truth, segmented.otf(truth.aberrations)))
    data = Data(rng.poisson(image) + rng.normal(0.0, READ_NOISE, image.shape), READ_NOISE**2)
    known = FitOptions(priors=Priors.alike(segmented.nominal.names, sigma))
    result = fit_frame(data, segmented, truth, options=known)
    assert result.status is Status.OK
    moments, covariance = result.moments()
    assert np.all(np.abs(moments - np.asarray(blur.moments())) < 4 * np.sqrt(np.diag(covariance)))
    # the maximum itself: no neighbour along an axis of the errors is better
    vector, unravel = to_vector(result.parameters)
    names, free = free_parameters(result.parameters, segmented.nominal)
    assert names == result.names
    least = exact_cost(data, segmented, result.parameters, sigma)
    values, axes = np.linalg.eigh(result.covariance)
    for direction in (axes * np.sqrt(values)).T:
        for step in (0.3, -0.3):
            beside = unravel(vector.at[np.array(free)].add(step * direction))
            assert exact_cost(data, segmented, beside, sigma) > least


def test_what_a_frame_shows_well_is_not_damped(segmented, monkeypatch):
    """A bright frame settles without."""
    monkeypatch.setattr("jitterkit.refit.fit.damped_scoring", None)
    truth = Parameters(Star(0.01, -0.02, 1e6), Mvn.of(0.06, 0.03, 20.0), np.full(8, 8.0))
    image = np.asarray(eqx.filter_jit(expected_image)(truth, segmented.otf(truth.aberrations)))
    start = Parameters(Star(0.012, -0.018, 9e5), Mvn.of(0.05), np.full(8, 6.0))
    result = fit_frame(Data(image, READ_NOISE**2), segmented, start)
    assert result.status is Status.OK
    np.testing.assert_allclose(result.parameters.aberrations, 8.0, atol=0.01)


def test_what_the_second_order_adds_to_the_curvature_is_that_of_differences_of_exact_images(segmented):
    """Sum over pixels of 1 - n/m times the second derivative of m, by images at nine wavefronts."""
    star, blur, state = Star(0.01, -0.02, 4e3), Mvn.of(0.06, 0.03, 20.0), np.linspace(-9.0, 12.0, 8)

    def image(aberrations):
        exact = Parameters(star, blur, np.asarray(aberrations))
        return np.asarray(expected_image(exact, segmented.otf(exact.aberrations, derivatives=False)))

    here, rng = image(state), np.random.default_rng(5)
    data = Data(rng.poisson(image(state + 20.0)) + rng.normal(0.0, READ_NOISE, here.shape), READ_NOISE**2)
    weights = 1 - (np.asarray(data.electrons) + READ_NOISE**2) / (here + READ_NOISE**2)
    for i, j in [(0, 0), (1, 1), (0, 4), (7, 7), (2, 5)]:
        a, b = 2.0 * np.eye(8)[i], 2.0 * np.eye(8)[j]
        mixed = image(state + a + b) - image(state + a - b) - image(state - a + b) + image(state - a - b)
        by_differences = np.sum(weights * mixed) / 16
        second = Anchor.at(segmented, state).second
        found = _products(Parameters(star, blur, state), segmented.otf(state), data, second)[i, j]
        assert float(found) == pytest.approx(by_differences, rel=2e-3, abs=1e-5)


def test_a_frame_that_says_little_about_its_wavefront_takes_few_steps(segmented, monkeypatch):
    """Six on the average; with the curvature of the first order alone it took 15."""
    took = []

    def counted(*args, **limits):
        found = damped_scoring(*args, **limits)
        took.append(found)
        return found

    monkeypatch.setattr("jitterkit.refit.fit.damped_scoring", counted)
    steps = []
    monkeypatch.setattr("jitterkit.refit.damped._limited", lambda *a: steps.append(1) or _limited(*a))
    for seed in (0, 5, 6):
        rng = np.random.default_rng([3, seed])
        truth = Parameters(Star(0.01, -0.02, 2e3), Mvn.of(0.06, 0.03, 20.0), rng.normal(0.0, 5.0, 8))
        image = np.asarray(expected_image(truth, segmented.otf(truth.aberrations)))
        data = Data(rng.poisson(image) + rng.normal(0.0, READ_NOISE, image.shape), READ_NOISE**2)
        assert fit_frame(data, segmented, truth).status is Status.OK
    assert len(took) == 3
    assert None not in took
    assert len(steps) < 3 * 12
