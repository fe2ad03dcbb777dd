"""Loci made of others, against products written with scipy."""

import numpy as np
import pytest
import scipy.special

from jitterkit.loci import Linear, Mvn, Smear, Tones

FX, FY = np.meshgrid(np.linspace(-1.3, 1.3, 14), np.linspace(-1.1, 1.1, 11))


def along(angle):
    return FX * np.cos(np.radians(angle)) + FY * np.sin(np.radians(angle))


def test_two_tones_are_a_product_of_bessel_functions():
    expected = scipy.special.j0(np.pi * 0.6 * along(15)) * scipy.special.j0(np.pi * 0.4 * along(80))
    found = np.asarray(Tones.of(0.6, 15.0, 0.4, 80.0).transfer(FX, FY))
    assert found == pytest.approx(expected, abs=4e-14)


def test_a_smear_under_random_motion_is_a_sinc_times_a_gaussian():
    gaussian = np.exp(-2 * np.pi**2 * (0.01 * along(70) ** 2 + 0.0025 * along(160) ** 2))
    found = np.asarray(Smear.of(0.5, 30.0, 0.1, 0.05, 70.0).transfer(FX, FY))
    assert found == pytest.approx(np.sinc(0.5 * along(30)) * gaussian, abs=1e-14)


def test_the_moments_of_both_motions_add():
    locus = Smear.of(0.5, 30.0, 0.1, 0.05, 70.0)
    parts = np.asarray(Linear.of(0.5, 30.0).moments()) + np.asarray(Mvn.of(0.1, 0.05, 70.0).moments())
    assert np.asarray(locus.moments()) == pytest.approx(parts, abs=1e-17)


def test_what_one_axis_has_more_than_the_other_is_smear_and_the_rest_is_round():
    near = Smear.near(np.asarray(Mvn.of(0.2, 0.1, 30.0).moments()))
    expected = {"length": np.sqrt(12 * 0.03), "angle": 30.0, "sigma_major": 0.1, "sigma_minor": 0.1}
    found = near.describe()
    assert {name: found[name] for name in expected} == pytest.approx(expected, rel=1e-7)


def test_tones_start_along_the_principal_axes_and_neither_from_nothing():
    near = Tones.near(np.asarray(Mvn.of(0.2, 0.1, 30.0).moments())).describe()
    expected = {"length1": 0.2 * np.sqrt(8), "angle1": 30.0, "length2": 0.1 * np.sqrt(8), "angle2": 120.0}
    assert near == pytest.approx(expected, rel=1e-9)
    thin = Tones.near(np.asarray(Linear.of(0.5, 30.0).moments())).describe()
    assert thin["length2"] == pytest.approx(0.1 * thin["length1"])
