"""The excess kurtosis: of known paths, how well a frame tells it, and what it does to the moments."""

import numpy as np
import pytest

from jitterkit.estimators import ESTIMATORS
from jitterkit.forward import Parameters, expected_image
from jitterkit.likelihood import Data
from jitterkit.loci import Linear, Mvn, Shm, Stable
from jitterkit.optics import expand, flat_band, grid_for
from jitterkit.scene import Binary


@pytest.fixture(scope="module")
def otf(toliman):
    band = flat_band(530, 640, 3)
    return expand(toliman, band, grid_for(toliman, band, (128, 128), 0.375, pad=32))


def estimate(name, locus, otf, flux=9.53e6, **options):
    scene = Binary(10.0, 33.0, 0.4, -0.3, flux, 3.37)
    image = np.asarray(expected_image(Parameters(scene, locus, np.zeros(7)), otf))
    return ESTIMATORS[name](Data(image), Parameters(scene, Stable.of(), np.zeros(7)), otf, **options)


@pytest.mark.parametrize(("length", "sigma"), [(0.225, 6.7), (0.375, 1.0)])
def test_a_frame_tells_the_shape_as_well_as_the_science_says(length, sigma, otf):
    # SCIENCE.md section 6, derived from the quartic term; given to two figures at best
    assert estimate("score", Linear.of(length, 27.0), otf).shape_err == pytest.approx(sigma, rel=0.2)


def test_four_times_the_light_halves_the_error_of_the_shape(otf):
    faint, bright = (estimate("score", Linear.of(0.3, 27.0), otf, flux).shape_err for flux in (5e6, 2e7))
    assert faint == pytest.approx(2 * bright, rel=0.02)


@pytest.mark.parametrize("name", ["mtf", "score"])
@pytest.mark.parametrize(("locus", "kurtosis"), [(Linear.of(0.375, 70.0), -1.2), (Shm.of(0.3, 70.0), -1.5)])
def test_drift_and_vibration_have_their_own_kurtosis(name, locus, kurtosis, otf):
    found = estimate(name, locus, otf, 1e8)
    # w = 4 pi² f² s is below 1.5 in the band; the sixth cumulant adds a quarter to the fourth at most
    assert found.shape == pytest.approx(kurtosis, abs=0.25 * abs(kurtosis) + 0.5 * found.shape_err)


@pytest.mark.parametrize("name", ["mtf", "score"])
def test_a_normal_has_none(name, otf):
    found = estimate(name, Mvn.of(0.12, 0.05, 20.0), otf, 4e7)
    # the MTF ratio subtracts the power of photon noise that is not there
    assert abs(found.shape) < 0.5 * found.shape_err


@pytest.mark.parametrize("name", ["mtf", "score"])
def test_the_shape_of_nothing_is_not_a_number(name, otf):
    found = estimate(name, Stable.of(), otf)
    assert np.isnan(found.shape)
    assert np.isnan(found.shape_err)


@pytest.mark.parametrize("name", ["mtf", "score"])
def test_once_the_shape_is_told_it_no_longer_biases_the_moments(name, otf):
    locus = Linear.of(0.5, 27.0)
    found, truth = estimate(name, locus, otf), np.asarray(locus.moments())
    assert found.shape_err < 1.2
    # a normal in its place is 4 (mtf) to 6 (score) of these errors off
    np.testing.assert_array_less(np.abs(found.moments - truth), found.errors)
