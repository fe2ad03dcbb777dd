"""The paper's appendix B: the density of simple harmonic motion, its integral, and a histogram of it."""

import itertools

import numpy as np
import pytest
from arcsine import arcsine_density, arcsine_shares
from refusals import refused
from scipy.integrate import quad
from scipy.stats import chi2

from jitterkit.errors import ErrorCode
from jitterkit.loci import Shm


def test_the_integral_over_a_cell_is_that_of_the_density():
    edges = [-0.29, -0.1, 0.05, 0.299]
    expected = [
        quad(lambda x: 1 / np.pi / np.sqrt(0.3**2 - x**2), *cell)[0] for cell in itertools.pairwise(edges)
    ]
    np.testing.assert_allclose(arcsine_shares(edges, 0.3), expected, rtol=1e-9)
    np.testing.assert_allclose(arcsine_density(0.1, 0.3), 1 / np.pi / np.sqrt(0.08), rtol=1e-12)


def test_nothing_is_beyond_the_ends_and_everything_between():
    assert arcsine_shares([-5.0, 5.0], 0.3) == pytest.approx(1)
    np.testing.assert_array_equal(arcsine_density([-0.31, 0.31], 0.3), 0)
    assert arcsine_density(0.3, 0.3) == np.inf


def test_a_histogram_of_random_times_is_the_arcsine_law(rng):
    draws, edges = 200_000, np.linspace(-0.7, 0.7, 41)
    counts, _ = np.histogram(0.7 * np.sin(rng.uniform(0, 2 * np.pi, draws)), edges)
    expected = draws * arcsine_shares(edges, 0.7)
    # between the 1st and 99.9th percentile; a density flat over cells fails by thousands
    assert chi2.ppf(0.01, 39) < np.sum((counts - expected) ** 2 / expected) < chi2.ppf(0.999, 39)


def test_the_locus_of_a_vibration_has_the_same_law():
    edges = np.linspace(-0.3, 0.3, 21)
    counts, _ = np.histogram(Shm.of(0.6).points(100_000)[:, 0], edges)
    np.testing.assert_allclose(
        counts / 100_000, arcsine_shares(edges, 0.3), atol=3e-5
    )  # a point or two a cell


@pytest.mark.parametrize("amplitude", [0.0, -1.0, np.nan])
def test_no_amplitude_has_no_density(amplitude):
    with refused(ErrorCode.OUT_OF_RANGE, f"{amplitude:g}"):
        arcsine_density(0.0, amplitude)


def test_the_cells_of_a_vibration_of_one_share_its_time_alike():
    np.testing.assert_allclose(arcsine_shares([-1.0, -0.5, 0.5, 1.0], 1.0), 1 / 3)
    assert arcsine_density(0.0, 2.0) * 2 * np.pi == 1.0
