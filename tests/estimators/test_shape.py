"""The excess kurtosis: of known paths, how well a frame tells it, and what it does to the moments."""

import re

import numpy as np
import pytest
from refusals import refused

from jitterkit.errors import ConfigurationError, ErrorCode, UndeterminedError
from jitterkit.estimators import ESTIMATORS
from jitterkit.estimators.mtf_ratio import _model
from jitterkit.forward import Parameters, expected_image
from jitterkit.likelihood import Data
from jitterkit.loci import Ellipse, Linear, Mvn, Shaped, Shm, Stable
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
@pytest.mark.slow
def test_a_frame_tells_the_shape_as_well_as_the_science_says(length, sigma, otf):
    # SCIENCE.md section 6, derived from the quartic term; given to two figures at best
    assert estimate("score", Linear.of(length, 27.0), otf).shape_err == pytest.approx(sigma, rel=0.2)


@pytest.mark.slow
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
def test_once_the_shape_is_determined_it_no_longer_biases_the_moments(name, otf):
    locus = Linear.of(0.5, 27.0)
    found, truth = estimate(name, locus, otf), np.asarray(locus.moments())
    assert found.shape_err < 1.2
    # a normal in its place is 4 (mtf) to 6 (score) of these errors off
    np.testing.assert_array_less(np.abs(found.moments - truth), found.errors)
    assert float(found.locus.coords[3]) == found.shape


@pytest.mark.parametrize("name", ["mtf", "score"])
def test_until_it_is_determined_the_errors_hold_what_it_might_do(name, otf):
    locus = Linear.of(0.34, 27.0)
    found, truth = estimate(name, locus, otf), np.asarray(locus.moments())
    assert found.shape_err > 1.2
    # a drift's -1.2 does no more than the 1.2 that the errors allow for; without those it is 1.7 of them off
    np.testing.assert_array_less(np.abs(found.moments - truth), 1.05 * found.errors)


@pytest.mark.parametrize("length", [0.1, 0.4, 3.0])
def test_a_known_shape_is_held_and_the_moments_are_exact(length, otf):
    locus = Linear.of(length, 27.0)
    found = estimate("score", locus, otf, shape=-1.2)
    # the fit ends within 1e-4 errors of the top
    np.testing.assert_allclose(found.moments, np.asarray(locus.moments()), atol=1e-3 * found.errors.min())
    assert float(found.locus.coords[3]) == -1.2
    assert np.isnan(found.shape)
    free = estimate("score", locus, otf)
    assert np.all(found.errors <= free.errors * 1.001)


@pytest.mark.parametrize("length", [0.1, 0.4, 0.75])
def test_the_ratio_with_a_known_shape_is_unbiased_and_surer(length, otf):
    locus = Linear.of(length, 27.0)
    found, free = (estimate("mtf", locus, otf, **known) for known in ({"shape": -1.2}, {}))
    # half an error is left of the photon noise's power, which is not there but is subtracted
    np.testing.assert_array_less(np.abs(found.moments - np.asarray(locus.moments())), 0.5 * found.errors)
    assert float(found.locus.coords[3]) == -1.2
    assert np.all(found.errors <= free.errors * 1.05)


@pytest.mark.parametrize("name", ["mtf", "score"])
@pytest.mark.parametrize("shape", [-12.0, np.nan])
def test_a_shape_that_no_density_has_is_refused(name, shape, otf):
    with refused(ErrorCode.OUT_OF_RANGE, "-2;", f"got {shape}", error=ConfigurationError):
        estimate(name, Linear.of(0.3, 27.0), otf, shape=shape)


@pytest.mark.parametrize("locus", [Shaped.of(0.2, 0.1, 20.0, 2.0), Shaped.of(0.2, kurtosis=3.0)])
def test_heavy_tails_are_measured(locus, otf, rng):
    scene = Binary(10.0, 33.0, 0.4, -0.3, 4e7, 3.37)
    image = rng.poisson(np.asarray(expected_image(Parameters(scene, locus, np.zeros(7)), otf)))
    found = ESTIMATORS["mtf"](Data(image), Parameters(scene, Stable.of(), np.zeros(7)), otf)
    assert found.shape == pytest.approx(float(locus.coords[3]), abs=3 * found.shape_err)
    np.testing.assert_array_less(np.abs(found.moments - np.asarray(locus.moments())), 3 * found.errors)


@pytest.mark.parametrize("locus", [Ellipse.of(1.0, 0.5, 20.0), Shm.of(3.0, 27.0)], ids=["ellipse", "shm"])
def test_the_ratio_refuses_a_blur_too_wide_for_its_series(locus, otf):
    with refused(ErrorCode.IMPLAUSIBLE, error=UndeterminedError) as caught:
        estimate("mtf", locus, otf, 4e7)
    assert float(re.findall(r"-[\d.]*\d", str(caught.value))[0]) < -1.5  # the excess kurtosis


@pytest.mark.parametrize("kurtosis", [-1.5, -1.2, -0.5, 0.5, 3.0])
def test_the_logarithm_of_the_transfer_function_is_that_of_the_shaped_locus(kurtosis):
    # f along x, of a unit variance: w = 4 pi² f²
    w = np.array([0.1, 0.2])
    f = np.sqrt(w) / (2 * np.pi)
    squares = np.stack([w, 0 * w, 0 * w])
    solution = np.array([0.3, 1.0, 0.0, 0.0, kurtosis])
    y, slopes = _model(solution, w, squares)
    exact = 2 * np.log(np.asarray(Shaped(np.array([1.0, 0.0, 0.0, kurtosis])).transfer(f, 0 * f)))
    left = y - 0.3 - exact
    if kurtosis > 0:
        np.testing.assert_allclose(left, 0, atol=1e-12)
    else:  # the eighth order is left: twice the w, sixteen times the rest
        assert left[1] / left[0] == pytest.approx(16, rel=0.05)
        assert abs(left[0]) < 1e-6
    for i in (0, 1, 4):
        step = np.eye(5)[i] * 1e-6
        ahead, behind = (_model(q, q[1] * w, squares)[0] for q in (solution + step, solution - step))
        np.testing.assert_allclose(slopes[i], (ahead - behind) / 2e-6, rtol=1e-6, atol=1e-9)
