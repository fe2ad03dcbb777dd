"""Errors of the model: found where they are, of the size they have, and not made of stars or cosmic rays."""

import equinox as eqx
import numpy as np
import pytest
from refusals import refused

from jitterkit.errors import ErrorCode
from jitterkit.forward import Parameters, expected_image
from jitterkit.likelihood import Data, pearson
from jitterkit.locate import allow_for_model, check_model_error, relative_error
from jitterkit.loci import Mvn
from jitterkit.scene import Binary, Star

NOISE = 2.4
PAIR = Binary(5.0, 140.0, 0.3, -0.2, 3e6, 3.0)
_image = eqx.filter_jit(expected_image)


def truth(scene=PAIR):
    return Parameters(scene, Mvn.of(0.12, 0.06, 30.0), np.zeros(2))


def drawn(rng, image, response=1.0):
    counts = rng.poisson(np.maximum(image, 0) * response) + rng.normal(0, NOISE, image.shape)
    return Data(counts / response, NOISE**2, response=None if response == 1 else response)


def allowed(data, image, otf, parameters=None, error="auto"):
    return allow_for_model(data, truth() if parameters is None else parameters, image, otf, error)


@pytest.fixture(scope="module")
def otf(optics):
    return optics.nominal


@pytest.fixture(scope="module")
def image(otf):
    return np.asarray(_image(truth(), otf))


@pytest.mark.parametrize("response", [1.0, 0.5])
def test_a_given_error_is_a_share_of_the_light(image, otf, response, rng):
    data = allowed(drawn(rng, image, response), image, otf, error=0.03)
    assert relative_error(data, image, 0.0) == pytest.approx(0.03)
    # chi-squared counts it once a pixel, and the likelihood as often as a resolution element has pixels
    counts = np.asarray(data.electrons)
    light = np.maximum(image, 0)
    own = image / response + NOISE**2 / response**2 + (0.03 * light) ** 2
    assert pearson(image, data).chi2 == pytest.approx(np.sum((counts - image) ** 2 / own), rel=1e-3)
    extra = np.asarray(data.offset) - NOISE**2 / response
    many = extra[light > 1e4] / (0.03 * light[light > 1e4]) ** 2 / response
    assert np.ptp(many) < 1e-6 * many[0]
    assert many[0] > 1


def test_frames_without_an_error_have_none(image, otf, rng):
    for _ in range(30):
        assert allowed(drawn(rng, image), image, otf).model_variance is None


def test_an_error_of_each_pixel_is_found_as_large_as_it_is(image, otf, rng):
    image = 30 * image  # so that many pixels show it
    for size in (0.02, 0.05):
        wrong = image * (1 + size * rng.normal(size=image.shape))
        data = allowed(drawn(rng, wrong), image, otf)
        assert relative_error(data, image, 0.0) == pytest.approx(size, rel=0.2)
        assert float(data.model_area) < 2
        assert pearson(image, data).chi2 / image.size == pytest.approx(1, abs=0.05)


def test_speckles_are_alike_over_a_resolution_element(image, optics, rng):
    lost = []
    for _ in range(4):
        # what the fit does not know: both comas, whose first-order images are as fine as the resolution
        seen = np.asarray(_image(Parameters(PAIR, truth().locus, rng.normal(0, 12, 2)), optics.nominal))
        lost.append(float(allowed(drawn(rng, seen), image, optics.nominal).model_area))
    assert np.mean(lost) > 3


@pytest.mark.parametrize("position", [(-4.0, 4.5), (1.0, -6.0)])
def test_a_star_that_the_model_lacks_is_no_error_of_the_model(image, otf, position, rng):
    third = np.asarray(_image(truth(Star(*position, 3e4)), otf))
    data = drawn(rng, image + third)
    assert pearson(image, data).chi2 / image.size > 1.5
    assert pearson(image, allowed(data, image, otf)).chi2 / image.size > 1.5


def test_a_pair_that_is_taken_for_one_star_is_no_error_of_the_model(image, otf, rng):
    (x, _), (y, _), (flux, _) = PAIR.sources()
    star = truth(Star(x, y, flux))
    lone = np.asarray(_image(star, otf))
    data = allowed(drawn(rng, image), lone, otf, star)
    assert pearson(lone, data).chi2 / image.size > 1.5


def test_cosmic_rays_are_no_error_of_the_model(image, otf, rng):
    taken = 0
    for _ in range(20):
        electrons = np.array(drawn(rng, image).electrons)
        electrons.flat[rng.choice(image.size, 20, replace=False)] += 5e3
        taken += allowed(Data(electrons, NOISE**2), image, otf).model_variance is not None
    assert taken <= 2  # of 120 such frames 3 were taken for frames with an error


def test_what_is_no_share_is_refused():
    for wrong in (-0.01, 1.0, float("nan"), "some"):
        with refused(ErrorCode.OUT_OF_RANGE, repr(wrong)):
            check_model_error(wrong)
