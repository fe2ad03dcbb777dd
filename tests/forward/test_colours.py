"""Stars of different colours: images against the direct integral, slopes, and what a fit makes of them."""

from dataclasses import replace

import jax
import numpy as np
import pytest

from jitterkit.forward import Parameters, expected_image, image_and_jacobian, parameter_names, to_vector
from jitterkit.likelihood import Data, deviance, normal_equations
from jitterkit.loci import Linear, Mvn
from jitterkit.optics import Colours
from jitterkit.optics.colours import colours_of
from jitterkit.refit import fit_frame
from jitterkit.scene import Binary, FurtherStars, Star, Stars

PAIR = Binary(4.0, 30.0, 0.4, -0.3, 1e6, 2.5)
FURTHER = FurtherStars([2.0], [-3.0], [2e4])
STATE = np.array([12.0, -8.0])


def blackbody(kelvin, nm):
    return nm**-4.0 / np.expm1(1.438777e7 / (nm * kelvin))


@pytest.fixture(scope="module")
def telescope(telescope):
    return replace(telescope, colours=Colours())


@pytest.fixture(scope="module")
def image_of(telescope, direct_stars):
    """Image of stars ``(x, y, electrons)``, each with its own photons by wavelength, and a drift along x."""
    t, share = np.polynomial.legendre.leggauss(4)
    drift = 0.15 * np.stack([t, 0 * t], axis=1), share / 2
    spectrum = telescope.spectrum
    nm, weights = np.array(spectrum.wavelengths), np.array(spectrum.weights)

    def image(stars, photons):
        each = []
        for star, of_star in zip(stars, photons, strict=True):
            light = weights * of_star(nm)
            pairs = list(zip(nm, light / light.sum(), strict=True))
            rest = telescope.shape, telescope.plate_scale, [star], drift, 4
            each.append(direct_stars(telescope.pupil, STATE, pairs, *rest))
        return sum(each)

    return image


def test_each_star_has_its_own_spectrum(telescope, image_of):
    nm, indices = np.array(telescope.spectrum.wavelengths), (0.7, -1.1)
    mean = 1 / float(np.dot(1 / nm, telescope.spectrum.weights))
    scene = PAIR.joined(FURTHER).coloured(indices)
    stars = [tuple(map(float, star)) for star in zip(*scene.sources(), strict=True)]
    photons = [lambda nm, index=index: 1 + index * (1 - mean / nm) for index in (*indices, 0.0)]
    image = expected_image(Parameters(scene, Linear.of(0.3, 0.0), STATE), telescope.optics(STATE))
    truth = image_of(stars, photons)
    white = expected_image(
        Parameters(PAIR.joined(FURTHER), Linear.of(0.3, 0.0), STATE), telescope.optics(STATE)
    )
    # light that wraps around the padded frame is left: less than a tenth of a sigma of the whole frame
    assert np.sum((image - truth) ** 2 / (truth + 1)) < 0.01
    assert np.sum((white - truth) ** 2 / (truth + 1)) > 10


def test_the_stars_of_a_field_have_one_colour(telescope):
    otf, (x, y, flux) = telescope.optics(), ([0.0, 2.0], [1.0, -2.0], [1e5, 4e4])
    field = expected_image(Parameters(Stars.of(x, y, flux, [0.9]), Mvn.of(0.1), np.zeros(2)), otf)
    each = [
        expected_image(Parameters(Star(*star, [0.9]), Mvn.of(0.1), np.zeros(2)), otf)
        for star in zip(x, y, flux, strict=True)
    ]
    np.testing.assert_allclose(field, sum(each), atol=1e-8)


@pytest.mark.parametrize(
    "scene", [Star(0.2, -0.4, 1e5, [0.5]), PAIR.joined(FURTHER).coloured([0.3, 0.7])], ids=["star", "pair"]
)
def test_slopes_are_those_of_the_image(telescope, scene):
    """By central differences: the image is linear in the indices, and the rest is exact to 1e-7."""
    otf = telescope.optics(STATE)
    parameters = Parameters(scene, Mvn.of(0.15, 0.1, 20.0), STATE, 2.0)
    vector, unravel = to_vector(parameters)
    names = parameter_names(parameters, otf.names)
    chosen = tuple(
        n for n, name in enumerate(names) if name.startswith(("spectral", "noll", "x", "sxx", "flux"))
    )
    _, rows = image_and_jacobian(parameters, otf, chosen)
    for slot, row in zip(chosen, rows, strict=True):
        step = np.zeros(len(vector))
        step[slot] = 1e-4 * max(abs(float(vector[slot])), 1.0)
        up, down = (expected_image(unravel(vector + sign * step), otf) for sign in (1, -1))
        np.testing.assert_allclose(row, (up - down) / (2 * step[slot]), atol=1e-5 * np.abs(row).max())


def test_two_blackbodies_do_not_bias_the_separation(telescope, image_of):
    """The image is the direct integral's.  One spectrum for both is the mistake that this undoes."""
    stars = [tuple(map(float, star)) for star in zip(*PAIR.sources(), strict=True)]
    image = image_of(stars, [lambda nm: blackbody(5790.0, nm), lambda nm: blackbody(5260.0, nm)])
    bias, told = {}, colours_of([5790.0, 5260.0], telescope.spectrum)
    for known in (None, Colours(), told):
        optics = replace(telescope, colours=known).system()
        fit = fit_frame(Data(image), optics, Parameters(PAIR, Linear.of(0.3, 0.0), STATE))
        bias[known] = (fit.of_scene("separation") - 4.0) / fit.error("separation")
    assert abs(bias[None]) > 0.01
    assert abs(bias[Colours()]) < 0.05 * abs(bias[None])
    assert abs(bias[told]) < 0.002 * abs(bias[None])


def test_what_is_known_of_a_colour_counts_once_in_deviance_score_and_information(telescope):
    parameters = Parameters(PAIR.coloured([0.3, 0.9]), Mvn.of(0.1), STATE)
    every = parameter_names(parameters, telescope.aberrations)
    free = tuple(range(len(every)))
    data = Data(np.asarray(expected_image(parameters, telescope.optics(STATE))))

    def at(sigma):
        otf = replace(telescope, colours=Colours((0.1, 0.5), sigma)).optics(STATE)
        return normal_equations(parameters, otf, data, free), deviance(parameters, otf, data)

    (known, value), (none, without) = at(0.2), at(1e9)
    slots = np.array([every.index(name) for name in Binary.colours])
    np.testing.assert_allclose(known.score[slots] - none.score[slots], [-0.2 / 0.04, -0.4 / 0.04])
    np.testing.assert_allclose(np.diag(known.information - none.information)[slots], 1 / 0.04)
    assert known.deviance - none.deviance == pytest.approx((0.2**2 + 0.4**2) / 0.04)
    assert value - without == pytest.approx((0.2**2 + 0.4**2) / 0.04)


def test_a_faint_star_keeps_the_colour_that_is_known(telescope, rng):
    optics = replace(telescope, colours=Colours((0.4,), 0.3)).system()
    truth = Parameters(Star(0.0, 0.0, 500.0, [0.4]), Mvn.of(0.1), np.zeros(2), 1.0)
    counts = rng.poisson(np.asarray(expected_image(truth, optics.nominal))).astype(float)
    fit = fit_frame(Data(counts, 1.0), optics, Parameters(Star(0.0, 0.0, 500.0), Mvn.of(0.1), np.zeros(2)))
    assert fit.of_scene("spectral_index_a") == pytest.approx(0.4, abs=0.1)
    assert fit.error("spectral_index_a") == pytest.approx(0.3, rel=0.02)


def test_an_exact_colour_is_not_fitted(telescope):
    optics = replace(telescope, colours=Colours((0.4, 0.8), 0.0)).system()
    start = Parameters(PAIR, Mvn.of(0.1), np.zeros(2))
    image = np.asarray(expected_image(start.completed(optics.nominal), optics.nominal))
    fit = fit_frame(Data(image), optics, start)
    assert not set(Binary.colours) & set(fit.names)
    np.testing.assert_array_equal(fit.parameters.scene.indices, [0.4, 0.8])
    assert fit.of_scene("separation") == pytest.approx(4.0, abs=1e-6)


def test_stars_that_change_names_take_their_colours_with_them():
    swapped = Binary(2.0, 10.0, 0.0, 0.0, 1e5, 0.5, indices=[0.1, 0.9]).canonical()
    assert float(swapped.contrast) == 2.0
    np.testing.assert_array_equal(swapped.indices, [0.9, 0.1])
    assert swapped.names[-2:] == Binary.colours
    assert jax.tree.structure(swapped) == jax.tree.structure(swapped.canonical())


def test_a_filter_that_is_off_by_a_nanometre_does_not_bias(telescope, direct_stars):
    """The image is the direct integral's, all wavelengths longer by 1e-3."""
    nm, stars = 1.001 * np.array(telescope.spectrum.wavelengths), zip(*PAIR.sources(), strict=True)
    pairs = list(zip(nm, telescope.spectrum.weights, strict=True))
    still = np.zeros((1, 2)), np.ones(1)
    stars = [tuple(map(float, star)) for star in stars]
    image = direct_stars(
        telescope.pupil, STATE, pairs, telescope.shape, telescope.plate_scale, stars, still, 4
    )
    start, bias = Parameters(PAIR, Mvn.of(0.01), STATE), {}
    for known in (None, replace(telescope.colours, wavelength_err=0.01)):
        optics = replace(telescope, colours=known).system()
        fit = fit_frame(Data(image), optics, start)
        bias[known is None] = fit.of_scene("separation") - 4.0
    assert abs(bias[False]) < 0.1 * abs(bias[True])
    assert fit.parameters.aberrations[-1] == pytest.approx(1e-3 * telescope.spectrum.mean, rel=0.1)


def test_a_faint_frame_keeps_the_wavelength_that_is_known(telescope):
    optics = replace(telescope, colours=Colours(wavelength_err=1e-3)).system()
    start = Parameters(Star(0.0, 0.0, 500.0), Mvn.of(0.1), np.zeros(2), 1.0)
    image = np.asarray(expected_image(start.completed(optics.nominal), optics.nominal))
    fit = fit_frame(Data(image, 1.0), optics, start)
    assert fit.error("wavelength_shift") == pytest.approx(1e-3 * telescope.spectrum.mean, rel=0.01)
    slot = parameter_names(fit.parameters, optics.nominal.names).index("wavelength_shift")
    equations = normal_equations(fit.parameters, optics.nominal, Data(image), (slot,))
    assert equations.information[0, 0] > (1e-3 * telescope.spectrum.mean) ** -2
