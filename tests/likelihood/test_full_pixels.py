"""Pixels at their ceiling and pixels divided by a flat: against Poisson laws summed term by term."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest
from scipy import special, stats

from jitterkit.forward import Parameters, expected_image, parameter_names
from jitterkit.frames import Frame
from jitterkit.likelihood import Data, deviance, normal_equations, pearson
from jitterkit.likelihood.data import ceiling_distance, mean_counts
from jitterkit.loci import Mvn
from jitterkit.optics import expand, flat_band, grid_for, obstructed_circle
from jitterkit.scene import Binary, Star

LEVEL = 2000.0


@pytest.fixture(scope="module")
def truth():
    return Parameters(Binary(3.0, 40.0, 0.2, -0.1, 2e4, 2.0), Mvn.of(0.1, 0.05, 30.0), [3.0, -2.0], 5.0)


@pytest.fixture(scope="module")
def free(truth, otf):
    return tuple(range(len(parameter_names(truth, otf.names))))


def clipped(truth, otf, rng, level=600.0):
    """A frame whose brightest pixels are full, with a flat of 5 % and read noise."""
    flat = 1 + 0.05 * rng.standard_normal(otf.grid.shape)
    counts = rng.poisson(np.asarray(expected_image(truth, otf)) * flat) + rng.normal(0, 3, flat.shape)
    full = counts / flat >= level
    electrons = np.where(full, level, counts / flat)
    return Frame(electrons, np.full(flat.shape, 9.0), mask=full, response=flat, ceiling=level, full=full)


def test_dividing_by_a_flat_changes_nothing(truth, otf, rng):
    flat = 1 + 0.2 * rng.uniform(-1, 1, otf.grid.shape)
    image = np.asarray(expected_image(truth, otf))
    counts = rng.poisson(image * flat)
    saturated = np.where(counts > 0, stats.poisson.logpmf(counts, np.maximum(counts, 1)), 0.0)
    reference = -2 * (stats.poisson.logpmf(counts, image * flat) - saturated).sum()
    assert float(deviance(truth, otf, Data(counts / flat, response=flat))) == pytest.approx(
        reference, rel=1e-10
    )


@pytest.mark.parametrize("censored", [False, True])
def test_the_score_is_the_slope_of_the_deviance(truth, otf, free, rng, censored):
    data = Data.of(clipped(truth, otf, rng), censored=censored)
    score = np.asarray(normal_equations(truth, otf, data, free).score)
    for slot, name, change in ((0, "separation", 1e-4), (4, "flux", 1.0), (5, "contrast", 1e-4)):
        ends = []
        for sign in (1, -1):
            scene = {n: float(getattr(truth.scene, n)) for n in Binary.own}
            scene[name] += sign * change
            moved = Parameters(Binary(**scene), truth.locus, truth.aberrations, truth.background)
            ends.append(float(deviance(moved, otf, data)))
        assert score[slot] == pytest.approx(-(ends[0] - ends[1]) / (4 * change), rel=1e-5)


def bright_pixel(mean: float, reading: float, *, level: float = LEVEL):
    """Score and information of a background in one pixel that fills at a level."""
    pupil, band = obstructed_circle(0.1, 0.0, samples=32, noll=()), flat_band(599, 601, 1)
    dark = expand(pupil, band, grid_for(pupil, band, (1, 1), 0.375, pad=8))
    parameters = Parameters(Star(0.0, 0.0, 0.0), Mvn(jnp.zeros(3)), [], mean)
    full = np.array([[reading >= level]])
    frame = Frame(np.array([[min(reading, level)]]), 0.0, mask=full, ceiling=level, full=full)
    names = parameter_names(parameters, ())
    return normal_equations(parameters, dark, Data.of(frame, censored=True), (names.index("background"),))


@pytest.mark.parametrize("sigmas", [-3, -1, 0, 1, 3])
def test_information_is_the_mean_square_of_the_score_of_a_poisson_count_that_may_be_full(sigmas):
    mean = LEVEL + sigmas * np.sqrt(LEVEL)
    counts = np.arange(int(LEVEL))  # below the ceiling; it is full from LEVEL counts on
    chance = stats.poisson.pmf(counts, mean)
    full = stats.poisson.sf(LEVEL - 1, mean)
    slope = stats.poisson.pmf(LEVEL - 1, mean) / full  # d/dm log P(N >= C) = p(C - 1)/P
    expected = chance @ ((counts - mean) / mean) ** 2 + full * slope**2
    found = bright_pixel(mean, LEVEL + 1)
    # a count is whole and the law of the ceiling continuous: half a count is 0.011 sigma, which at
    # three sigmas is 3 % of the density; the same of an information that is 2 % there of what it is below
    assert float(found.information[0, 0]) == pytest.approx(expected, rel=0.02, abs=0.002 / mean)
    assert float(found.score[0]) == pytest.approx(slope, rel=0.01 + 0.011 * abs(sigmas))


def test_far_below_the_ceiling_nothing_changes():
    mean = LEVEL - 8 * np.sqrt(LEVEL)
    found = bright_pixel(mean, mean + 10)
    assert float(found.information[0, 0]) == pytest.approx(1 / mean, rel=1e-9)
    assert float(found.score[0]) == pytest.approx(10 / mean, rel=1e-9)


def test_what_the_model_brings_near_the_ceiling_is_left_out_whatever_it_reads(truth, otf, rng):
    frame = clipped(truth, otf, rng)
    image = np.asarray(expected_image(truth, otf))
    data = Data.of(frame).clear(image)
    reach = np.asarray(frame.response) * (frame.ceiling - image) < 4 * np.sqrt(frame.response * image)
    used = np.asarray(data.used)
    assert not np.any(used & reach)
    # Wilson and Hilferty's sigmas are stretched by skewness: a few pixels beyond four of the plain ones
    assert np.sum(~used & ~reach & ~frame.full) <= 2
    assert np.sum(~used) > np.sum(frame.full) > 5
    assert data.ceiling is None


@pytest.mark.parametrize("level", [300, 3000, 15000])
def test_a_count_is_clear_until_its_chance_to_be_full_is_that_beyond_four_sigmas(level):
    means = np.linspace(level - 6 * np.sqrt(level), level, 20001)
    row = Data(means[None], ceiling=np.full((1, len(means)), float(level)))
    clear = row.clear(means[None]).used[0]
    last = clear.sum() - 1
    assert np.all(clear[: last + 1])
    # the chance of a Poisson count to reach half a count more, a hundredth of it off for the cube root
    assert special.gammainc(level + 0.5, means[last]) == pytest.approx(stats.norm.sf(4.0), rel=0.01)


def test_what_is_clear_is_four_sigmas_from_its_ceiling_whatever_that_is(rng):
    levels = np.array([np.nan, -50.0, 0.0, 1.0, 30.0, 1e3, 1e5, np.inf])[:, None]
    flat, means = rng.uniform(0.5, 1.5, (8, 4000)), rng.uniform(0.01, 1.2, (8, 4000))
    image = means * np.where(np.isfinite(levels) & (levels > 0), levels, 1e4)
    data = Data(image, 9.0, response=flat, ceiling=np.broadcast_to(levels, image.shape))
    distance, _ = ceiling_distance(mean_counts(image, data), data)
    clear = data.clear(image).used
    np.testing.assert_array_equal(clear, np.asarray(distance) < -4)
    assert not clear[:3].any()
    assert clear[-1].all()
    assert 0.3 < clear[6].mean() < 0.9


def test_a_frame_without_anything_near_its_ceiling_has_none(truth, otf):
    frame = Frame(np.asarray(expected_image(truth, otf)), 9.0, ceiling=1e6)
    assert Data.of(frame).ceiling is None
    assert Data.of(frame, censored=True).full is None


def test_one_pixel_near_its_own_ceiling_is_enough_and_one_without_a_ceiling_hides_none(truth, otf):
    electrons = np.asarray(expected_image(truth, otf)).clip(0)
    ceiling = np.full(electrons.shape, 1e6)
    faintest = np.unravel_index(electrons.argmin(), electrons.shape)
    ceiling[faintest] = np.nan
    assert Data.of(Frame(electrons, 9.0, ceiling=ceiling)).ceiling is None
    ceiling[faintest] = electrons[faintest] + 10.0
    ceiling[0, 0], ceiling[0, 1] = np.nan, -50.0
    bad = ceiling < 0  # a hot pixel that is full in the dark
    assert Data.of(Frame(electrons, 9.0, bad, ceiling=ceiling)).ceiling is not None


def test_chi_squared_leaves_out_what_may_be_full(truth, otf, rng):
    frame = clipped(truth, otf, rng)
    image = np.asarray(expected_image(truth, otf))
    whole, cleared = (pearson(image, d) for d in (Data.of(frame, censored=True), Data.of(frame).clear(image)))
    assert whole.pixels == cleared.pixels < frame.mask.size - frame.full.sum()
    assert whole.chi2 == pytest.approx(cleared.chi2, rel=1e-12)
    assert abs(whole.chi2 - whole.pixels) < 4 * whole.spread
