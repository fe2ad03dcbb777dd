"""The laws of three noises, against explicit sums over weights and quadrature of their spectra."""

import numpy as np
import pytest
from refusals import refused

from jitterkit.errors import ErrorCode
from jitterkit.series.laws import (
    NOISES,
    contrast_covariance,
    degrees_of_freedom,
    difference_correlation,
    difference_variance,
)

DENSITY = {"white": 2.0, "flicker": 1 / (2 * np.log(2)), "walk": 1.5 / np.pi**2}
"""One-sided spectra h f^-k whose Allan variance is one at length one (Barnes et al. 1971)."""
POWER = {"white": 0, "flicker": 1, "walk": 2}


def by_quadrature(noise, first, second, distance, lag=None):
    """Mean product of two differences of block means, ``lag`` apart, over the spectrum."""
    f = np.geomspace(1e-7, 3e3, 1_000_001)  # above it 1/f³ is left at most: 1e-4 of white noise
    transfer = np.sinc(f * second) * np.exp(2j * np.pi * f * distance) - np.sinc(f * first)
    shift = 1.0 if lag is None else np.cos(2 * np.pi * f * lag)
    integrand = DENSITY[noise] * f ** (1.0 - POWER[noise]) * np.abs(transfer) ** 2 * shift
    return np.trapezoid(integrand, np.log(f))


@pytest.mark.parametrize("noise", NOISES)
def test_differences_of_unlike_blocks_have_the_variance_of_the_spectrum(noise):
    cases = ((1.0, 1.0, 1.0), (2.0, 0.5, 1.7), (1.0, 3.0, 9.0))
    found = [difference_variance(*case, noise) for case in cases]
    expected = [by_quadrature(noise, *case) for case in cases]
    np.testing.assert_allclose(found, expected, rtol=2e-3)  # the ends of the quadrature


def test_flicker_is_flat_white_noise_falls_and_a_walk_grows():
    m = np.array([1.0, 4.0, 64.0])
    for noise, law in (("white", 2 / m), ("flicker", 2 + 0 * m), ("walk", 2 * m)):
        np.testing.assert_allclose(difference_variance(m, m, m, noise), law, rtol=1e-12)


@pytest.mark.parametrize("noise", ["flicker", "walk"])
def test_correlations_of_differences_are_those_of_the_spectrum(noise):
    lags = (0.5, 1.0, 2.0)
    expected = [by_quadrature(noise, 1.0, 1.0, 1.0, lag) / 2 for lag in lags]
    np.testing.assert_allclose(difference_correlation(lags, noise), expected, atol=2e-3)


def test_correlations_of_white_differences_are_overlaps_of_weights():
    m = 6
    weights = np.r_[-np.ones(m), np.ones(m), np.zeros(3 * m)]
    overlaps = [weights @ np.roll(weights, lag) / (2 * m) for lag in range(3 * m)]
    np.testing.assert_allclose(difference_correlation(np.arange(3 * m) / m, "white"), overlaps, atol=1e-12)


@pytest.mark.parametrize("m", [3, 10, 100])
def test_degrees_of_freedom_are_those_published(m):
    # Howe, Allan & Barnes (1981), exact for white noise but for the ends, approximations for the others
    points = 20_001
    count = points - 2 * m
    white = (3 * (points - 1) / (2 * m) - 2 * (points - 2) / points) * 4 * m**2 / (4 * m**2 + 5)
    flicker = 5 * points**2 / (4 * m * (points + 3 * m))
    walk = (points - 2) / m * ((points - 1) ** 2 - 3 * m * (points - 1) + 4 * m**2) / (points - 3) ** 2
    assert degrees_of_freedom(count, m, "white") == pytest.approx(white, rel=2e-3)
    assert degrees_of_freedom(count, m, "flicker") == pytest.approx(flicker, rel=0.08)
    assert degrees_of_freedom(count, m, "walk") == pytest.approx(walk, rel=0.08)


@pytest.mark.parametrize("noise", NOISES)
def test_a_contrast_of_blocks_is_their_difference(noise):
    contrasts = np.zeros((3000, 2))
    contrasts[:2, 0] = -1, 1
    contrasts[10:15, 1], contrasts[2500:2530, 1] = -1 / 5, 1 / 30
    found = np.diag(contrast_covariance(contrasts, noise))
    expected = [2.0, difference_variance(5, 30, 2514.5 - 12, noise)]
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_an_unknown_noise_is_named():
    with refused(ErrorCode.UNKNOWN_NAME, "'pink'", *NOISES):
        difference_correlation(1.0, "pink")
    with refused(ErrorCode.UNKNOWN_NAME, "'brown'"):
        degrees_of_freedom(10, 1, "brown")
