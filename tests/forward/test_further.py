"""What else an instrument may have free: transmission, plate scale, and a wavefront of B of its own.

Images are the direct integral's, which knows nothing of modes: other pupils, another pixel, each star alone.
"""

import re
from dataclasses import replace

import equinox as eqx
import numpy as np
import pytest

from jitterkit.batch import FrameProcessor
from jitterkit.errors import ConfigurationError
from jitterkit.forward import Parameters, expected_image, image_and_jacobian, parameter_names, to_vector
from jitterkit.frames import RawFrame
from jitterkit.likelihood import Data
from jitterkit.loci import Mvn
from jitterkit.optics import Anchor, Colours, Pupil
from jitterkit.refit import fit_frame
from jitterkit.scene import Binary, Star

PAIR = Binary(4.0, 30.0, 0.4, -0.3, 1e6, 2.5)
STATE = np.array([12.0, -8.0])
STILL = np.zeros((1, 2)), np.ones(1)
BY, SHIFT = np.array([0.03, -0.02]), 3.0  # of the transmission along x and the radius; nm of B
FREE = {"transmission": ("x", "r"), "modes_of_b": ("noll8",), "plate_scale_free": True}


@pytest.fixture(scope="module")
def telescope(telescope):
    return replace(telescope, colours=Colours())


@pytest.fixture(scope="module")
def free(telescope):
    return replace(telescope, **FREE)


@pytest.fixture(scope="module")
def image_of(telescope, direct_stars):
    """Image of the pair, with a pupil of another transmission, more of B's astigmatism and a wider pixel."""

    def image(by=(0.0, 0.0), shift=0.0, scale=0.0):
        axis = np.linspace(-1, 1, len(telescope.pupil.opd) + 1)[:-1] + 1 / len(telescope.pupil.opd)
        x, y = np.meshgrid(axis, axis)
        light = np.asarray(telescope.pupil.transmission)
        exponent = np.zeros_like(x)
        for size, mode in zip(by, (x, x**2 + y**2), strict=True):
            mode = mode - np.sum(mode * light**2) / np.sum(light**2)
            exponent += size * mode / np.sqrt(np.sum(mode**2 * light**2) / np.sum(light**2))
        changed = light * np.exp(exponent)
        pupil = eqx.tree_at(lambda p: p.transmission, telescope.pupil, changed)
        pairs = list(zip(telescope.spectrum.wavelengths, telescope.spectrum.weights, strict=True))
        pixel = telescope.plate_scale * (1 + scale)
        a, b = (tuple(map(float, star)) for star in zip(*PAIR.sources(), strict=True))
        rest = pairs, telescope.shape, pixel
        both = direct_stars(pupil, STATE, *rest, [a], STILL, 4)
        both = both + direct_stars(pupil, STATE + np.array([0.0, shift]), *rest, [b], STILL, 4)
        return both

    return image


def state_of(otf, by=(0.0, 0.0), shift=0.0, scale=0.0):
    values = dict.fromkeys(otf.names, 0.0) | dict(zip(("noll7", "noll8"), STATE, strict=True))
    values |= {"transmission_x": by[0], "transmission_r": by[1], "noll8_b": shift, "plate_scale_shift": scale}
    return np.array([values[name] for name in otf.names])


@pytest.mark.parametrize(
    "change",
    [
        pytest.param({"by": BY}, marks=pytest.mark.slow),
        pytest.param({"shift": SHIFT}, marks=pytest.mark.slow),
        pytest.param({"scale": 2e-4}, marks=pytest.mark.slow),
        {"by": BY, "shift": SHIFT, "scale": 1e-4},
    ],
)
def test_the_image_is_the_direct_integrals(free, image_of, change):
    system = free.system()
    state = state_of(system.nominal, **change)
    still = Parameters(PAIR, Mvn.of(0.0), state)
    otf, truth = system.otf(state), image_of(**change)
    anchored = Anchor.at(system, state_of(system.nominal, by=BY / 2, shift=2.0)).otf(state)
    nothing = expected_image(Parameters(PAIR, Mvn.of(0.0), state_of(otf)), otf=system.otf(state_of(otf)))
    off = [np.sum((image - truth) ** 2 / (truth + 1)) for image in (expected_image(still, otf), nothing)]
    assert off[0] < 0.01  # sigmas of the frame, squared; light that wraps around is left
    assert off[0] < 0.01 * off[1]
    assert np.sum((expected_image(still, anchored) - expected_image(still, otf)) ** 2 / (truth + 1)) < 1e-2


@pytest.mark.parametrize(
    "scene", [PAIR.coloured([0.3, 0.7]), Star(0.2, -0.4, 1e5, [0.5])], ids=["pair", "star"]
)
def test_slopes_are_those_of_the_image(free, scene):
    otf = free.optics(state_of(free.optics(), by=BY, shift=SHIFT))
    parameters = Parameters(scene, Mvn.of(0.15, 0.1, 20.0), otf.state, 2.0)
    vector, unravel = to_vector(parameters)
    names = parameter_names(parameters, otf.names)
    chosen = tuple(n for n, name in enumerate(names) if name in (*otf.varied(scene), "separation", "x"))
    _, rows = image_and_jacobian(parameters, otf, chosen)
    assert len(chosen) >= 7
    for slot, row in zip(chosen, rows, strict=True):
        step = np.zeros(len(vector))
        step[slot] = 1e-4
        up, down = (expected_image(unravel(vector + sign * step), otf) for sign in (1, -1))
        np.testing.assert_allclose(
            row, (up - down) / 2e-4, atol=1e-5 * np.abs(row).max(), err_msg=names[slot]
        )


def test_a_fit_that_frees_them_is_not_biased(free, telescope, image_of):
    image = image_of(by=[0.0, BY[1]], shift=SHIFT)
    start, bias = Parameters(PAIR, Mvn.of(0.01), STATE), {}
    for known in (telescope, replace(free, plate_scale_free=False)):
        fit = fit_frame(Data(image), known.system(), start)
        bias[known.name, known is telescope] = fit.of_scene("separation") - 4.0
    held, freed = bias[telescope.name, True], bias[telescope.name, False]
    error = fit.error("separation")
    assert abs(held) > error
    assert abs(freed) < 0.02 * error  # to which fits end
    told = dict(zip(fit.aberrations, fit.parameters.aberrations, strict=True))
    assert told["transmission_x"] == 0.0  # does not show: the pupil is its own mirror image, and so is coma
    assert told["transmission_r"] == pytest.approx(BY[1], rel=0.01)
    assert told["noll8_b"] == pytest.approx(SHIFT, rel=0.01)


def test_a_plate_scale_that_is_free_moves_the_separation_to_the_truth(free, telescope, image_of):
    """One pixel is 1e-4 wider than stated; the spectra are known, and so how large a star's image is."""
    image, start = image_of(scale=1e-4), Parameters(PAIR, Mvn.of(0.01), STATE)
    known = replace(telescope, colours=replace(telescope.colours, sigma=0.0, wavelength_err=0.0))
    held = fit_frame(Data(image), known.system(), start)
    fit = fit_frame(Data(image), replace(known, plate_scale_free=True).system(), start)
    assert held.of_scene("separation") - 4.0 == pytest.approx(-4e-4, rel=0.01)
    assert fit.of_scene("separation") == pytest.approx(4.0, abs=4e-6)
    assert dict(zip(fit.aberrations, fit.parameters.aberrations, strict=True))[
        "plate_scale_shift"
    ] == pytest.approx(1e-4, rel=0.01)
    assert fit.error("separation") > 1.1 * held.error("separation")
    # told to 1e-5 beforehand, the scale adds no more than that
    told = replace(known, plate_scale_free=True, plate_scale_err=1e-6)
    error = fit_frame(Data(image), told.system(), start).error("separation")
    assert error == pytest.approx(np.hypot(held.error("separation"), 4e-6), rel=1e-3)


@pytest.mark.parametrize(
    ("stated", "told"), [(None, True), pytest.param(1e-6, False, marks=pytest.mark.slow)]
)
def test_a_plate_scale_that_can_hardly_be_determined_is_reported(telescope, image_of, stated, told):
    """Held by what is known to 1e-6, the separation has an error close to that with a known scale."""
    errors, raw = {}, RawFrame.from_array(image_of(), unit="electron", read_noise=1.0)
    for name, more in {"held": {}, "free": {"plate_scale_free": True, "plate_scale_err": stated}}.items():
        processor = FrameProcessor(replace(telescope, **more), locus="mvn", scene="binary")
        result = processor.process(raw).result
        errors[name] = result.error("separation")
    factor = errors["free"] / errors["held"]
    assert (factor > 2) == told
    assert ("scale_degenerate" in result.flags) == told
    said = [float(number) for number in re.findall(r"([\d.]+) times", result.message)]
    assert said == ([pytest.approx(factor, rel=2e-3)] if told else [])


def test_a_plate_scale_that_is_known_exactly_is_not_fitted(telescope):
    exact = replace(telescope, plate_scale_free=True, plate_scale_err=0.0)
    assert exact.optics().names == telescope.optics().names


def test_a_star_has_no_wavefront_of_b(free):
    otf = free.optics()
    start = Parameters(Star(0.1, 0.2, 1e5), Mvn.of(0.1), np.zeros(2), 1.0).completed(otf)
    fit = fit_frame(Data(np.asarray(expected_image(start, otf)), 1.0), free.system(), start)
    assert "noll8_b" not in (*fit.names, *fit.aberrations)
    assert "transmission_r" in fit.names


def test_an_image_without_derivatives_is_the_same(free):
    otf = free.optics(state_of(free.optics(), by=BY, shift=SHIFT))
    fixed = free.optics(otf.state, derivatives=False)
    image, again = (expected_image(Parameters(PAIR, Mvn.of(0.1), otf.state), one) for one in (otf, fixed))
    np.testing.assert_allclose(image, again, rtol=1e-12)


def test_a_pupil_that_is_handed_on_keeps_its_modes(free):
    """Settings of a run hand the pupil of one instrument to another."""
    again = replace(free, pupil_from=free.pupil)
    assert again.system().nominal.names == free.system().nominal.names


def test_two_modes_of_one_name_are_refused(telescope):
    pupil = telescope.pupil
    with pytest.raises(ConfigurationError, match="called 'noll7'"):
        Pupil(pupil.transmission, pupil.diameter, pupil.opd, pupil.basis, ["noll7", "noll7"])


def test_modes_that_are_not_there_are_refused(telescope):
    with pytest.raises(ConfigurationError, match=r"modes_of_b names 'noll99'.*noll7, noll8"):
        replace(telescope, modes_of_b=("noll99",)).system()
    with pytest.raises(ConfigurationError, match="'z' is no mode of the transmission"):
        replace(telescope, transmission=("z",)).system()
