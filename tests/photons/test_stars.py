"""Starlight at a V magnitude, against Planck's law and Bessell's mean taken by another quadrature."""

import builtins
import socket

import numpy as np
import pytest
from refusals import refused
from scipy.constants import Boltzmann, Planck, speed_of_light
from scipy.integrate import simpson

from jitterkit.errors import ErrorCode
from jitterkit.photons import Curve, blackbody, flat_curve, tabulated

pytest.importorskip("synphot")

V_NM = np.arange(470.0, 701.0, 10.0)
V_WEIGHT = [
    0,
    30,
    163,
    458,
    780,
    967,
    1000,
    973,
    898,
    792,
    684,
    574,
    461,
    359,
    270,
    197,
    135,
    81,
    45,
    25,
    17,
    13,
    9,
    0,
]
V_ZERO = 3.631e-8  # erg/s/cm²/nm, Bessell, Castelli and Plez (1998)


def planck(nm, temperature):
    """Energy per wavelength, in any unit."""
    metres = nm * 1e-9
    return metres**-5 / np.expm1(Planck * speed_of_light / (metres * Boltzmann * temperature))


def photon_energy(nm):
    """erg."""
    return Planck * speed_of_light / (nm * 1e-9) * 1e7


def mean_in_v(nm, energy):
    """Bessell's mean of energy per wavelength: weighted by energy, straight lines between his rows."""
    fine = np.linspace(470, 700, 4601)
    weight = np.interp(fine, V_NM, V_WEIGHT)
    return simpson(np.interp(fine, nm, energy) * weight, x=fine) / simpson(weight, x=fine)


@pytest.mark.parametrize(("temperature", "magnitude"), [(5790, 0.01), (5260, 1.33), (12000, -1.0)])
def test_a_blackbody_has_planck_s_shape_and_its_magnitude(temperature, magnitude):
    star = blackbody(temperature, magnitude)
    nm = np.linspace(450, 700, 2501)
    energy = planck(nm, temperature)
    energy *= V_ZERO * 10 ** (-0.4 * magnitude) / mean_in_v(nm, energy)
    # a trapezoid on 1 nm of a curve as narrow as the passband errs by (1 nm / 60 nm)² / 12 = 2e-5
    assert star(nm) == pytest.approx(energy / photon_energy(nm), rel=4e-5)


def test_a_star_of_v_zero_gives_a_thousand_photons_per_angstrom_at_550_nm():
    # the rule of thumb: 3.631e-9 erg/s/cm²/Å over 3.61e-12 erg; V's mean wavelength of 545 nm is 5 nm off
    assert blackbody(9500, 0.0)(550.0) / 10 == pytest.approx(1000, rel=0.02)


def test_five_magnitudes_are_a_hundred_times_the_photons():
    ratio = blackbody(5000, 1.0)(600.0) / blackbody(5000, 6.0)(600.0)
    assert ratio == pytest.approx(100, rel=1e-12)


def test_a_tabulated_blackbody_is_the_blackbody_whatever_its_unit():
    nm = np.arange(400.0, 801.0, 1.0)
    star = tabulated(Curve(nm, 1e30 * planck(nm, 5260) * nm), 1.33)
    # straight lines over 1 nm instead of 0.5 nm: 1e-6
    assert star(nm[1:-1]) == pytest.approx(blackbody(5260, 1.33)(nm[1:-1]), rel=5e-6)


def test_a_star_flat_in_photons_is_scaled_by_the_mean_energy():
    nm = np.linspace(470, 700, 4601)
    expected = V_ZERO / mean_in_v(nm, photon_energy(nm))
    assert tabulated(flat_curve(400, 800, 7.0), 0.0)(600.0) == pytest.approx(expected, rel=4e-5)


def test_no_star_asks_the_network(monkeypatch):
    def refuse(*_args, **_kwargs):
        raise AssertionError("the network was asked")

    monkeypatch.setattr(socket.socket, "connect", refuse)
    monkeypatch.setattr(socket, "getaddrinfo", refuse)
    blackbody(5790, 0.0)
    tabulated(flat_curve(400, 800), 0.0)


def test_without_synphot_a_sentence_names_the_extra(monkeypatch):
    original = builtins.__import__

    def without(name, *args, **kwargs):
        if name.split(".")[0] == "synphot":
            raise ImportError(name)
        return original(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without)
    with refused(ErrorCode.MISSING_PACKAGE, "synphot", "jitterkit[spectra]"):
        blackbody(5790, 0.0)


@pytest.mark.parametrize(
    ("make", "code", "values"),
    [
        (lambda: blackbody(10, 0), ErrorCode.OUT_OF_RANGE, ("10 K", "1000 to 100000 K")),
        (lambda: blackbody(float("nan"), 0), ErrorCode.OUT_OF_RANGE, ("nan K", "1000 to 100000 K")),
        (lambda: blackbody(5000, float("inf")), ErrorCode.OUT_OF_RANGE, ("V = inf",)),
        (lambda: tabulated(flat_curve(480, 800), 0), ErrorCode.SAMPLING, ("480 to 800 nm", "470 to 700 nm")),
        (lambda: tabulated(flat_curve(400, 690), 0), ErrorCode.SAMPLING, ("400 to 690 nm", "470 to 700 nm")),
    ],
)
def test_what_is_no_star_is_refused(make, code, values):
    with refused(code, *values):
        make()
