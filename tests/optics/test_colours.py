"""The spectral index of a star: in the optics, against spectra that are tilted by hand."""

import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from refusals import refused

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.instruments import load_instrument
from jitterkit.optics import Anchor, Colours, Grid, OpticalSystem, Spectrum, expand, flat_band, lines
from jitterkit.optics.colours import blackbody_index, colours_of

BAND = flat_band(500.0, 600.0, 5)
STATE = np.array([10.0, -6.0])


@pytest.fixture(scope="module")
def system(telescope):
    return OpticalSystem(telescope.pupil, BAND, Grid((32, 32), 0.375, 8), colours=Colours())


def tilted(spectrum: Spectrum, index: float) -> Spectrum:
    """Photons times ``1 + index (1 - mean/wavelength)``."""
    nm, weights = np.array(spectrum.wavelengths), np.array(spectrum.weights)
    return Spectrum(tuple(nm), tuple(weights * (1 + index * (1 - 1 / (weights @ (1 / nm)) / nm))))


def largest(array) -> float:
    return float(np.abs(np.asarray(array)).max())


@pytest.mark.parametrize("index", [-3.0, 0.5, 4.0])
def test_a_transfer_function_and_its_slopes_are_linear_in_the_index(system, index):
    red, pupil = tilted(BAND, index), system.pupil
    exact, here = expand(pupil, red, system.grid, STATE), system.otf(STATE)
    assert largest(here.value + index * here.chromatic[0] - exact.value) < 1e-14
    slopes = here.jacobian + index * here.chromatic[1:]
    # which are computed in 32 bits
    assert largest(slopes[: len(STATE)] - exact.jacobian) < 1e-6 * largest(exact.jacobian)
    assert largest(here.chromatic[0]) > 1e-4


def test_colour_moves_no_light_in_or_out_of_the_band(system):
    # at zero frequency the transfer function is the share of light in the grid, which hardly knows colours
    assert abs(complex(system.otf(STATE).chromatic[0, 0, 0])) < 1e-3


def test_an_anchor_knows_colours_to_third_order_of_the_wavefront(system):
    anchor, change = Anchor.at(system, STATE), np.array([1.0, 2.0])

    def error(size):
        exact = system.otf(STATE + size * change).chromatic[0]
        return largest(anchor.otf(STATE + size * change).chromatic[0] - exact)

    assert error(0.0) < 1e-9  # it keeps them in 32 bits
    assert error(20.0) / error(10.0) == pytest.approx(8, rel=0.2)


def test_diffused_charge_and_slopes_nearby_hold_for_colours_too(system):
    blurred, step = replace(system, diffusion=0.2), np.array([1.0, -1.0])
    exact = blurred.otf(STATE + step)
    near = blurred.near(STATE + step, blurred.otf(STATE))
    assert largest(near.chromatic[0] - exact.chromatic[0]) < 1e-14
    assert largest(near.chromatic[1:] - exact.chromatic[1:]) < 0.1 * largest(exact.chromatic[1:])
    fy, fx = system.grid.frequencies
    blur = np.exp(-2 * np.pi**2 * 0.2**2 * (fx**2 + fy**2))
    assert largest(exact.chromatic - system.otf(STATE + step).chromatic * blur) < 1e-14
    anchored = Anchor.at(blurred, STATE).otf(STATE)
    assert largest(anchored.chromatic[0] - blurred.otf(STATE).chromatic[0]) < 1e-9


@pytest.mark.parametrize("kelvin", [3000.0, 5790.0, 30000.0])
def test_the_index_of_a_blackbody_is_planck_s_slope_in_a_narrow_band(kelvin):
    # photons are as x^4/(e^x - 1) in x = hc/(wavelength k T): d ln N/d ln wavelength = x/(1 - e^-x) - 4
    x = 1.438777e7 / (585.0 * kelvin)
    index = blackbody_index(kelvin, flat_band(584.0, 586.0, 3))
    assert index == pytest.approx(x / (1 - np.exp(-x)) - 4, abs=1e-4)


def test_the_index_keeps_the_mean_wavenumber_of_the_blackbody():
    band, kelvin = flat_band(400.0, 800.0, 21), 4000.0
    nm, weights = np.array(band.wavelengths), np.array(band.weights)
    photons = weights * nm**-4.0 / np.expm1(1.438777e7 / (nm * kelvin))
    red = tilted(band, blackbody_index(kelvin, band))
    assert np.dot(red.weights, 1 / nm) == pytest.approx(photons @ (1 / nm) / photons.sum(), rel=1e-6)


def test_one_star_has_the_mean_of_two_and_two_have_that_of_one():
    assert Colours((0.2, 0.6)).of(1) == (0.4,)
    assert Colours((0.3,)).of(2) == (0.3, 0.3)


def test_temperatures_give_a_mean_spectrum_and_indices_about_it():
    known, nm = colours_of([6000.0, 5000.0], BAND), np.array(BAND.wavelengths)
    planck = {kelvin: nm**-4.0 / np.expm1(1.438777e7 / (nm * kelvin)) for kelvin in (5000.0, 5500.0, 6000.0)}
    assert known.temperature == 5500.0
    np.testing.assert_allclose(
        np.array(known.seen(BAND).weights) / BAND.weights, planck[5500.0] / (BAND.weights @ planck[5500.0])
    )
    base = known.seen(BAND)
    for kelvin, index in zip((6000.0, 5000.0), known.indices, strict=True):
        ratio = np.array(tilted(base, index).weights) / BAND.weights / planck[kelvin]
        alone = np.array(tilted(BAND, blackbody_index(kelvin, BAND)).weights) / BAND.weights / planck[kelvin]
        assert np.ptp(ratio) / ratio.mean() < 1e-3 < 0.4 * np.ptp(alone) / alone.mean()
    assert Colours().seen(BAND) is BAND


@pytest.mark.parametrize(
    ("make", "code", "values"),
    [
        (lambda: Colours((0.1, 0.2, 0.3)), ErrorCode.OUT_OF_RANGE, [0.1, 0.2, 0.3]),
        (lambda: Colours((float("nan"),)), ErrorCode.OUT_OF_RANGE, ["nan"]),
        (lambda: Colours(sigma=-1.0), ErrorCode.OUT_OF_RANGE, [-1.0]),
        (lambda: blackbody_index(0.0, BAND), ErrorCode.OUT_OF_RANGE, [0.0]),
        (lambda: blackbody_index(1.0, BAND), ErrorCode.OUT_OF_RANGE, [1]),
        (lambda: blackbody_index(5000.0, lines(633.0)), ErrorCode.CONFLICT, []),
    ],
)
def test_impossible_colours_are_refused(make, code, values):
    with refused(code, *values, error=ConfigurationError):
        make()


def at_longer(system, nm: float, index: float = 0.0):
    """Optics of a star whose spectrum has an index, where all wavelengths are so much longer."""
    red = tilted(system.spectrum, index)
    return sum(
        w * expand(system.pupil, lines(nm + line), system.grid, STATE, derivatives=False).value
        for line, w in zip(red.wavelengths, red.weights, strict=True)
    )


def test_the_slope_by_the_wavelength_is_that_of_differences(system):
    step, otf = 0.01, system.otf(STATE)
    up, here, down = (at_longer(system, sign * step) for sign in (1, 0, -1))
    assert otf.names[-1] == "wavelength_shift"
    # central differences: their error is of third order in 2e-5 of the wavelength
    assert largest(otf.jacobian[-1] - (up - down) / (2 * step)) < 1e-6 * largest(otf.jacobian[-1])
    tinted = (at_longer(system, step, 0.7) - up - at_longer(system, -step, 0.7) + down) / (2 * step) / 0.7
    assert largest(otf.chromatic[-1] - tinted) < 1e-6 * largest(tinted)
    bend = (up - 2 * here + down) / step**2
    assert largest(otf.bend - bend) < 1e-4 * largest(bend)


IN_32_BITS = """
import sys
import numpy as np
from jitterkit.instruments import load_instrument

otf = load_instrument("smallsat").system().otf(None)
np.savez(sys.argv[1], slope=otf.jacobian[-1], bend=otf.bend)
"""


@pytest.mark.slow
def test_derivatives_by_the_wavelength_hold_in_32_bits(tmp_path):
    path, otf = tmp_path / "slopes.npz", load_instrument("smallsat").system().otf(None)
    command = [sys.executable, "-c", IN_32_BITS, str(path)]
    subprocess.run(command, env={**os.environ, "JAX_ENABLE_X64": "0"}, check=True)
    told, sigma = np.load(path), otf.sigmas[-1]
    assert told["bend"].dtype == np.complex64
    assert largest(told["slope"] - otf.jacobian[-1]) < 1e-3 * largest(otf.jacobian[-1])
    assert largest(told["bend"] - otf.bend) * sigma**2 / 2 < 1e-6  # of the transfer function, at one sigma


@pytest.mark.parametrize("index", [0.0, 3.0])
def test_a_shift_of_the_wavelength_is_right_to_second_order(system, index):
    """Left out are its third order, and of a coloured star its second."""
    otf = system.otf(STATE)

    def error(nm):
        shifted = np.array([*STATE, nm])
        return largest(otf.at(shifted) + index * otf.chromatic_at(shifted) - at_longer(system, nm, index))

    # steps that 32 bits of the slope do not hide
    assert error(1.0) / error(0.5) == pytest.approx(8 if index == 0 else 4, rel=0.05)


def test_optics_expand_at_no_shift_and_curve_with_it(system):
    shifted = np.array([*STATE, 0.3])
    otf, near = system.otf(shifted), system.near(shifted, system.otf(STATE))
    for one in (otf, near, Anchor.at(system, STATE).otf(shifted)):
        np.testing.assert_array_equal(one.state, [*STATE, 0.0])
        curved = system.otf(STATE).value + 0.3 * one.jacobian[-1] + 0.045 * one.bend
        assert largest(one.at(shifted) - curved) < 1e-12
        assert largest(one.bend - system.otf(STATE).bend) < 1e-6 * largest(one.bend)  # 32 bits
        assert largest(one.chromatic[-1] - system.otf(STATE).chromatic[-1]) < 1e-6 * largest(
            one.chromatic[-1]
        )
    assert system.phase(shifted) == system.phase(STATE)


def test_an_anchor_follows_the_wavelength_s_slope(system):
    anchor, change = Anchor.at(system, STATE), np.array([2.0, -1.0])

    def error(size):
        return largest(
            anchor.otf(STATE + size * change).jacobian[-1] - system.otf(STATE + size * change).jacobian[-1]
        )

    assert error(0.0) < 1e-13
    assert error(2.0) / error(1.0) == pytest.approx(4, rel=0.1)


def test_known_wavelengths_and_one_spectrum_leave_them_out(system):
    known = replace(system, colours=Colours(wavelength_err=0.0))
    assert known.otf(STATE).names == replace(system, colours=None).otf(STATE).names == system.pupil.names


def test_an_impossible_error_of_the_wavelength_is_refused():
    with refused(ErrorCode.OUT_OF_RANGE, -0.1, error=ConfigurationError):
        Colours(wavelength_err=-0.1)
