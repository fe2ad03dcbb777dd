"""What effects do to a separation, to first order: against refits, known answers and laws."""

import math
from dataclasses import replace

import equinox as eqx
import numpy as np
import pytest
from refusals import refused

from jitterkit.errors import ErrorCode
from jitterkit.forecast import forecast, systematic_errors
from jitterkit.forecast.bound import expected_data
from jitterkit.forecast.effects import Effect, effects_of
from jitterkit.forecast.modelled import Modelled
from jitterkit.forecast.systematics import FitResponse, _assess
from jitterkit.forward import GRADIENT, Parameters, expected_image
from jitterkit.instruments import Instrument
from jitterkit.loci import Linear, Mvn
from jitterkit.optics import Spectrum, obstructed_circle
from jitterkit.refit import FitOptions, fit_frame
from jitterkit.scene import Binary, Star

SEPARATION = 5.0


@pytest.fixture(scope="module")
def parameters():
    return Parameters(Binary(SEPARATION, 30.0, 0.1, -0.2, 3e6, 3.0), Linear.of(0.3, 20.0), np.zeros(2))


@pytest.fixture(scope="module")
def model(telescope, parameters):
    return Modelled.of(telescope, parameters)


@pytest.fixture(scope="module")
def budget(telescope, parameters):
    error, errors = systematic_errors(telescope, parameters)
    return {"error": error} | {one.name: one for one in errors}


def refitted(model, change, hold):
    """Bias and chi-squared of a fit to the expected image with a change."""
    data = expected_data(model.parameters, model.otf, model.telescope.detector)
    data = eqx.tree_at(lambda d: d.electrons, data, np.where(data.used, data.electrons + change, 0.0))
    fit = fit_frame(data, model.optics, model.parameters, model.otf, FitOptions(hold=hold))
    again = model.optics.otf(fit.parameters.aberrations)
    fit = fit_frame(data, model.optics, fit.parameters, again, FitOptions(hold=hold))
    return fit.of_scene("separation") - SEPARATION, fit.chi2


@pytest.mark.parametrize(
    ("name", "size"),
    [
        ("plate_scale", 1e-5),
        ("background", 0.3),
        pytest.param("gradient", 0.3, marks=pytest.mark.slow),
        ("coma_b", 0.3),
        ("focus_change", 2.0),
        ("noll9", 0.3),
        ("skewness", 0.1),
        ("brighter_fatter", 2e-8),
        ("coupling", 2e-4),
        ("nonlinearity", 1e-3),
        ("shear", 1e-5),
        ("roll", 100.0),
    ],
)
def test_the_bias_is_that_of_a_refit_of_the_changed_image(model, telescope, parameters, name, size):
    (effect,) = (one for one in effects_of(model, {name: size}) if one.name == name)
    response = FitResponse.of(model)
    one = _assess(response, effect, 1e-6)
    hold = tuple(name for name in effect.hold if name in response.names)
    biases, chi2 = np.transpose([refitted(model, change, hold) for change in effect.changes])
    error = math.sqrt(response.covariance()[0, 0])
    # what is left is second order: a hundredth where chi-squared grows by one
    assert abs(one.bias) == pytest.approx(np.linalg.norm(biases), rel=0.02, abs=1e-4 * error)
    assert one.chi2 == pytest.approx(chi2.sum(), rel=0.02, abs=1e-6)
    if len(biases) == 1:
        assert one.bias * biases[0] > 0


def changes_of(model, name, size):
    (effect,) = (one for one in effects_of(model, {name: size}) if one.name == name)
    return effect.changes


def test_a_pixel_grid_stretched_along_both_axes_has_another_plate_scale(model):
    both, scale = changes_of(model, "stretch", 1e-6).sum(axis=0), changes_of(model, "plate_scale", 1e-6)[0]
    # pixels of another scale are also wider: a twelfth of the second derivative, which moves no star
    np.testing.assert_allclose(both, scale, atol=0.04 * np.abs(scale).max())
    rows = FitResponse.of(model)
    biases = [rows.covariance() @ (rows.slopes * rows.weights @ change.ravel()) for change in (both, scale)]
    slot = rows.names.index("separation")
    assert biases[0][slot] == pytest.approx(biases[1][slot], rel=0.01)
    # the size of the stars' images changes too, which weighs little
    assert biases[0][slot] == pytest.approx(-1e-6 * SEPARATION, rel=0.03)


@pytest.fixture(scope="module")
def round_blur(telescope, parameters):
    """Behind a round pupil, so that the image turns as the pair does."""
    return Modelled.of(telescope, parameters.with_locus(Mvn.of(0.1, 0.1)))


def turned(model, degrees):
    pair, angle = model.parameters.binary, math.radians(degrees)
    x, y = float(pair.x), float(pair.y)
    middle = math.cos(angle) * x - math.sin(angle) * y, math.sin(angle) * x + math.cos(angle) * y
    return model.of_scene(Binary(SEPARATION, 30.0 + degrees, *middle, 3e6, 3.0, indices=pair.indices))


def test_two_shears_are_a_turn(round_blur):
    along_rows, along_columns = changes_of(round_blur, "shear", 1e-6)
    step = turned(round_blur, math.degrees(1e-6)) - turned(round_blur, 0.0)
    np.testing.assert_allclose(along_columns - along_rows, step, atol=5e-3 * np.abs(step).max())


def test_a_roll_is_the_mean_over_its_angles(round_blur):
    """By three nodes of Gauss and Hermite, at angles that the effect does not use."""
    (change,) = changes_of(round_blur, "roll", 300.0)
    ends = sum(turned(round_blur, by * math.sqrt(3) * 300 / 3600) for by in (1, -1))
    mean = ends / 6 + 2 * turned(round_blur, 0.0) / 3
    np.testing.assert_allclose(change, mean - turned(round_blur, 0.0), atol=2e-3 * np.abs(change).max())


def test_what_scales_the_sky_biases_by_as_much_and_is_never_seen(budget):
    moving, orbit = budget["velocity_aberration"], budget["orbit"]
    assert moving.bias == pytest.approx(-1e-4 * SEPARATION, rel=1e-4)
    assert orbit.bias == pytest.approx(orbit.size, rel=1e-4)
    for one in (moving, orbit):
        assert one.frames == one.cost == math.inf
        assert one.shown_by(10**9) == "nothing"
    assert orbit.needed == pytest.approx(1e-6, rel=1e-3)
    assert moving.needed == pytest.approx(1e-6 / SEPARATION, rel=1e-3)


def test_what_an_effect_costs_is_what_forecasts_with_it_and_without_say(budget, model):
    free, flat, held = (
        forecast(model.parameters, model.otf, model.telescope.detector, FitOptions(hold=hold))
        for hold in ((), GRADIENT, ("background",))
    )
    one = budget["background"]
    assert one.fitted
    assert not budget["flat"].fitted
    assert budget["error"] == pytest.approx(free.error("separation"), rel=1e-6)
    assert one.cost == pytest.approx(flat.error("separation") / held.error("separation"), rel=1e-6)


def test_a_mode_costs_what_a_forecast_of_a_telescope_that_fits_it_says(budget, telescope, parameters):
    both = replace(telescope, pupil_from=obstructed_circle(0.125, 0.04, samples=64, noll=(7, 8, 9)))
    wider = Parameters(parameters.scene, parameters.locus, np.zeros(3))
    more = forecast(wider, both.optics(), telescope.detector).error("separation")
    _, errors = systematic_errors(telescope, parameters, sizes={"noll9": 0.01})  # so small: its derivative
    (one,) = (one for one in errors if one.name == "noll9")
    assert one.cost**2 - 1 == pytest.approx((more / budget["error"]) ** 2 - 1, rel=0.01)


def test_an_error_of_each_pixel_is_the_sum_of_changes_of_single_pixels(model):
    response = FitResponse.of(model)
    image = np.zeros(model.image.shape)
    image[20, 20], image[25, 30] = 30.0, -40.0
    single = np.zeros((2, *image.shape))
    single[0, 20, 20], single[1, 25, 30] = 30.0, -40.0
    random = _assess(response, Effect("a", 1.0, "", image[None], per_pixel=True), 1e-6)
    several = _assess(response, Effect("b", 1.0, "", single), 1e-6)
    assert random.bias == pytest.approx(several.bias, rel=1e-9)
    assert random.chi2 == pytest.approx(several.chi2, rel=1e-6)
    assert math.isnan(random.cost)
    one_of = _assess(response, Effect("c", 1.0, "", single, together=False), 1e-6)
    assert one_of.bias == pytest.approx(several.bias / math.sqrt(2), rel=1e-9)


def test_errors_of_pixels_as_large_as_their_noise_bias_and_fit_as_noise_does(telescope, parameters):
    # an error of a pixel as large as its noise is noise
    model = Modelled.of(telescope, parameters)
    response = FitResponse.of(model)
    noise = np.where(response.weights > 0, response.weights, np.inf) ** -0.5
    effect = Effect("noise", 1.0, "", noise.reshape(1, *model.image.shape), per_pixel=True)
    one = _assess(response, effect, 1e-6)
    assert one.bias == pytest.approx(math.sqrt(response.covariance()[0, 0]), rel=1e-9)
    assert one.chi2 == pytest.approx(np.sum(response.weights > 0) - len(response.names), rel=1e-9)


def test_effects_of_charge_are_what_their_sizes_say(model):
    size = {"brighter_fatter": 1e-6, "coupling": 5e-3, "nonlinearity": 0.01}
    changes = {one.name: one.changes[0] for one in effects_of(model, size) if one.name in size}
    row, column = np.unravel_index(model.image.argmax(), model.image.shape)
    brightest = model.image[row, column]
    around = np.array([model.image[row + dy, column + dx] for dy, dx in ((0, 1), (1, 0), (0, -1), (-1, 0))])
    moved = size["brighter_fatter"] * (brightest - around)  # of each border, in pixels
    lost = {
        "brighter_fatter": np.sum(moved * (brightest + around) / 2),
        "coupling": size["coupling"] * np.sum(brightest - around),
        "nonlinearity": size["nonlinearity"] * brightest,
    }
    for name, share in lost.items():
        assert changes[name][row, column] == pytest.approx(-share, rel=1e-9)


@pytest.mark.parametrize(
    "name",
    ["flat", "third_star", "noll9", "noll4", "focus_change", "astigmatism_b", "amplitude", "roll"],
)
def test_an_effect_of_the_needed_size_biases_by_the_target(telescope, parameters, budget, name):
    _, errors = systematic_errors(telescope, parameters, sizes={name: budget[name].needed})
    (one,) = (one for one in errors if one.name == name)
    assert abs(one.bias) == pytest.approx(1e-6, rel=0.03)  # third order of a wavefront


def test_defocus_of_a_pupil_that_is_its_own_mirror_image_shows_by_its_square(telescope, parameters):
    biases = [
        next(one.bias for one in systematic_errors(telescope, parameters, sizes={"noll4": size})[1]
             if one.name == "noll4")
        for size in (1.0, 3.0)
    ]  # fmt: skip
    assert biases[1] / biases[0] == pytest.approx(9, rel=0.02)


def test_a_colour_is_the_light_of_a_star_at_other_weights_of_the_wavelengths(model, telescope, budget):
    assert telescope.colours is None
    assert not budget["index_b"].fitted
    (effect,) = (one for one in effects_of(model, {"index_b": 0.1}) if one.name == "index_b")
    band = telescope.spectrum
    wavenumbers = 1 / np.array(band.wavelengths)
    factors = 1 + 0.1 * (1 - wavenumbers / np.dot(band.weights, wavenumbers))
    other = Spectrum(band.wavelengths, tuple(np.array(band.weights) * factors))
    alone = Star(*(part[1] for part in model.parameters.scene.stars()))
    frame = Parameters(alone, model.parameters.locus, np.zeros(2))
    before, after = (
        np.asarray(expected_image(frame, replace(telescope, spectrum=one).optics())) for one in (band, other)
    )
    np.testing.assert_allclose(effect.changes[0], after - before, atol=1e-9 * before.max())


def test_a_measured_psf_has_no_effects_of_a_pupil(parameters):
    rows, columns = np.mgrid[-24:24, -22:22]
    psf = np.exp(-(rows**2 + columns**2) / (2 * 1.3**2))
    star = Instrument("star", 0.375, (48, 44), psf_from=psf, plate_scale_err=2e-6)
    still = Parameters(parameters.scene, Linear.of(0.0), ())
    _, errors = systematic_errors(star, still, FitOptions(hold=parameters.locus.names))
    found = {one.name: one for one in errors}
    assert {"plate_scale", "third_star", "flat"} <= found.keys()
    assert not {"band", "index_a", "coma_b", "focus_change", "amplitude", "noll4", "skewness"} & found.keys()
    assert found["plate_scale"].size == 2e-6
    assert found["plate_scale"].bias == pytest.approx(-2e-6 * SEPARATION, rel=1e-3)


@pytest.mark.parametrize(
    ("sizes", "code", "values"),
    [
        ({"plate_scal": 1e-5}, ErrorCode.UNKNOWN_NAME, ("plate_scal", "plate_scale")),
        ({"noll7": 1.0}, ErrorCode.UNKNOWN_NAME, ("noll7",)),  # it is fitted
        ({"flat": -1.0}, ErrorCode.OUT_OF_RANGE, ("flat", "-1.0")),
    ],
)
def test_an_effect_that_there_is_not_is_refused(telescope, parameters, sizes, code, values):
    with refused(code, *values):
        systematic_errors(telescope, parameters, sizes=sizes)
