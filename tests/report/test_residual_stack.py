"""The stack of residuals: what noise does to its tests, and what they find.

References are drawn noise and the laws of normal deviates, not the formulas of the package.
"""

import functools

import numpy as np
import pytest
from scipy import stats

from jitterkit.forward import Parameters
from jitterkit.loci import Stable
from jitterkit.refit import FitResult, Status
from jitterkit.report.plots import plot_residual
from jitterkit.report.residual_stack import (
    ResidualStack,
    count_copies,
    join_stacks,
    most_stacked,
    stack_residuals,
)
from jitterkit.scene import Binary, Star

SHAPE, SCALE = (48, 44), 0.375
PIXELS = SHAPE[0] * SHAPE[1]


@functools.cache
def _pair(x, y):
    return Parameters(Binary(8.0, 30.0, x, y, 1e5, 3.0), Stable.of(), np.zeros(0), 0.0)


def result(residual, x=0.0, y=0.0, status=Status.OK):
    return FitResult(status, "", parameters=_pair(x, y), residual=residual)


def stacked(results, shape=SHAPE, scale=SCALE):
    return most_stacked(stack_residuals(((one, scale, 4.0) for one in results), shape))


def white(rng):
    return rng.normal(size=SHAPE)


def overestimated(rng):
    """Noise that is larger than the fits take it for: by chi-squared, 20 standard deviations of a frame."""
    return 1.3 * rng.normal(size=SHAPE)


def dark(rng):
    """One photon in ten pixels."""
    return (rng.poisson(0.1, SHAPE) - 0.1) / np.sqrt(0.1)


def masked(rng):
    return np.where(rng.random(SHAPE) < 0.3, np.nan, rng.normal(size=SHAPE))


@functools.cache
def _taken():
    """Forty smooth images, orthonormal, that a fit takes out of its residual (pixels, 40)."""
    y, x = (np.linspace(-1, 1, n) for n in SHAPE)
    waves = [np.outer(y**i, x**j).ravel() for i in range(9) for j in range(9) if i + j < 9][:40]
    return np.linalg.qr(np.array(waves).T)[0]


def fitted(rng):
    noise, taken = rng.normal(size=PIXELS), _taken()
    return (noise - taken @ (taken.T @ noise)).reshape(SHAPE)


@pytest.mark.parametrize("noise", [white, overestimated, dark, masked, fitted])
def test_noise_gives_false_alarms_at_the_promised_rate_at_most(noise, rng):
    runs = 300
    found = [stacked(result(noise(rng)) for _ in range(12)).structure() for _ in range(runs)]
    sigmas, chi2_dof = (np.array([one[k] for one in found]) for k in (1, 0))
    for limit in (1.0, 2.0):
        chance = stats.norm.sf(limit)
        # two tests that were one would have the significance of one for two: fewer alarms, half at most
        assert stats.binom.sf(np.sum(sigmas > limit) - 1, runs, chance) > 1e-4, limit
        assert stats.binom.cdf(np.sum(sigmas > limit), runs, chance / 2) > 1e-4, limit
    # the sum over pixels of N(N-1)/2 products has a variance of 2 (1 - 1/N) of its mean square
    spread = np.sqrt(2 / PIXELS * 11 / 12)
    assert abs(chi2_dof.mean() - 1) < 3.5 * spread / np.sqrt(runs)
    assert chi2_dof.std() == pytest.approx(spread, rel=3.5 / np.sqrt(2 * runs))


def test_small_frames_give_no_more_false_alarms(rng):
    """Of 120 pixels the tests' laws are far from normal: without their skewness, six times as many."""
    shape, runs, many = (12, 10), 4000, 10**6
    y, x = (axis.ravel() for axis in np.indices(shape))
    boxes = (np.abs(y[:, None] - y) <= 1) & (np.abs(x[:, None] - x) <= 1)  # pixels in the box about another
    squares = np.array([120, np.count_nonzero(boxes)]) * 256**2 * many
    counts = np.full(shape, many)
    alarms = 0
    for _ in range(runs):
        total = np.rint(256 * np.sqrt(many) * rng.normal(size=shape)).astype(np.int64)
        alarms += ResidualStack(SCALE, many, total, counts, squares).structure().sigmas > 3
    assert stats.binom.sf(alarms - 1, runs, stats.norm.sf(3)) > 1e-4


def test_a_misfit_is_seen_in_the_stack_that_no_mean_chi_squared_shows(rng):
    """Chi-squared of 12 in each frame: 0.18 of a frame's standard deviation of 65, 1.8 of the mean of 100."""
    pattern = rng.normal(size=SHAPE)
    pattern *= np.sqrt(12 / np.sum(pattern**2))
    found = stacked(result(pattern + rng.normal(size=SHAPE)) for _ in range(100)).structure()
    # products of 100 frames: 1,200 in the stack, of which noise makes 65 and its product with the pattern 69
    assert found.sigmas == pytest.approx(12 * 100 / np.sqrt(2 * PIXELS), abs=5)
    assert found.excess == pytest.approx(12, abs=3.5 * 0.95)
    assert found.chi2_dof == pytest.approx(1 + 1200 / PIXELS, abs=3.5 * 95 / PIXELS)


def test_speckles_are_seen_sooner_than_single_pixels(rng):
    y, x = np.indices(SHAPE)
    wave = np.sin(2 * np.pi * x / 12) * np.sin(2 * np.pi * y / 12)
    pattern = wave * np.sqrt(4 / np.sum(wave**2))
    noises = rng.normal(size=(100, *SHAPE))
    # both tests see chi-squared of 4 a frame: 6 standard deviations of pixels, more of their boxes
    smooth = stacked(result(pattern + noise) for noise in noises).structure()
    mixed = rng.permutation(pattern.ravel()).reshape(SHAPE)
    rough = stacked(result(mixed + noise) for noise in noises).structure()
    assert smooth.sigmas > rough.sigmas + 5
    for found in (smooth, rough):
        assert 1.5 < found.excess < 7


def test_bad_frames_with_nothing_in_common_have_no_structure(rng):
    found = stacked(result(rng.normal(size=SHAPE) * (5 if n == 3 else 1)) for n in range(50)).structure()
    assert abs(found.sigmas) < 4


PLACES = [(0.0, 0.0), (1.4, -2.3), (-3.8, 0.7), (0.2, 3.1)]
"""Arcsec, of the midpoint of the pair."""


@pytest.mark.parametrize("shapes", [[SHAPE], [SHAPE, (41, 61), (64, 33)]])
def test_stars_come_to_one_place_wherever_they_are_in_whatever_frame(shapes):
    results = []
    for shape in shapes:
        for x, y in PLACES:
            # a bright spot 2.25 arcsec right of the midpoint and 1.5 above it, in its nearest pixel
            row, column = ((n - 1) / 2 + at / SCALE for n, at in zip(shape, (y + 1.5, x + 2.25), strict=True))
            residual = np.zeros(shape)
            residual[round(row), round(column)] = 100.0
            results.append(result(residual, x, y))
    stack = stacked(results)
    assert stack.frames == len(results)
    image = plot_residual(stack.sigmas(), stack.plate_scale).images[0]
    left, right, bottom, top = image.get_extent()
    rows, columns = np.nonzero(np.nan_to_num(np.asarray(image.get_array())))
    assert stack.total.sum() == 256 * 100 * len(results)  # no spot has been lost
    # frame and stack round half a pixel each
    assert np.abs(left + (columns + 0.5) * (right - left) / SHAPE[1] - 2.25).max() <= SCALE * 1.01
    assert np.abs(bottom + (rows + 0.5) * (top - bottom) / SHAPE[0] - 1.5).max() <= SCALE * 1.01


def test_stars_that_stand_still_keep_a_fixed_pattern_sharp(rng):
    spot = np.zeros(SHAPE)
    spot[20, 30] = 1.0
    stack = stacked(result(spot, *rng.uniform(-0.18, 0.18, 2)) for _ in range(50))
    assert np.count_nonzero(stack.total) == 1


def test_a_frame_far_outside_counts_with_what_is_left_of_it():
    stack = stacked([result(np.ones(SHAPE), x=44 * SCALE), result(np.ones(SHAPE), y=-30 * SCALE)])
    assert stack.frames == 2
    assert stack.counts.sum() == (48 - 30) * 44


def test_the_order_and_the_parts_of_a_run_do_not_matter(rng):
    results = [result(masked(rng), *rng.normal(size=2)) for _ in range(20)]
    whole = stacked(results).pack()
    fitted = [(one, SCALE, 4.0) for one in results]
    parts = [stack_residuals(fitted[k:end], SHAPE) for k, end in ((13, 20), (0, 13))]
    assert most_stacked(join_stacks(*parts)).pack() == whole
    again = {name: ResidualStack.unpack(one.pack()) for name, one in parts[0].items()}
    assert most_stacked(join_stacks(parts[1], again)).pack() == whole
    assert stacked(rng.permutation(np.array(results, object))).pack() == whole


@pytest.mark.parametrize("shape", [(40, 44), (41, 43)])
def test_the_place_of_the_scene_is_that_of_its_pixel_in_the_stack(shape):
    """A pixel at the scene's place, wherever that is, and whether sides are even or odd."""
    for row, column in ((20, 20), (17, 25), (24, 19)):
        residual = np.zeros(shape)
        residual[row, column] = 1.0
        y, x = ((at - (n - 1) / 2 + 0.25) * SCALE for at, n in zip((row, column), shape, strict=True))
        stack = stacked([result(residual, x, y)], (40, 44))
        (found,) = np.argwhere(stack.total)
        np.testing.assert_allclose(found - np.array([19.5, 21.5]) + 0.25, stack.position, atol=1e-4)
        assert stack.read_noise == 2.0


def test_only_usable_frames_of_the_most_common_scene_and_scale_are_stacked(rng):
    good = [(result(white(rng)), 0.37501 + 1e-5 * n) for n in range(9)]
    failed = [(result(white(rng), status=Status.POOR_FIT), SCALE), (FitResult(Status.NO_STAR, ""), SCALE)]
    binned = [(result(white(rng)), 2 * SCALE) for _ in range(3)]
    star = Parameters(Star(0.0, 0.0, 1.0), Stable.of(), np.zeros(0), 0.0)
    stars = [(FitResult(Status.OK, "", parameters=star, residual=white(rng)), SCALE) for _ in range(4)]
    stacks = stack_residuals([(*one, 4.0) for one in (*stars, *failed, *good, *binned)], SHAPE)
    assert most_stacked(stacks).frames == 9
    assert sorted(one.frames for one in stacks.values()) == [3, 4, 9]
    assert most_stacked({}) is None


def test_duplicates_change_nothing(rng):
    """A night and its compressed copy are as significant as the night, not 22 sigmas of noise."""
    noises = [white(rng) for _ in range(20)]
    once, twice = stacked(map(result, noises)), stacked(map(result, noises * 2))
    assert twice.structure(2.0).sigmas == pytest.approx(once.structure().sigmas, rel=1e-9)
    assert twice.structure(2.0).excess == pytest.approx(once.structure().excess, rel=1e-9)
    assert twice.sigmas(2.0) == pytest.approx(once.sigmas())
    assert twice.structure().sigmas > 15  # the number of copies is not idle
    # nine of a frame in a hundred, of which each other is alone
    status = ["ok"] * 91 + ["duplicate"] * 9 + ["no_star", "ok"]
    digests = [f"{n}" for n in range(90)] + ["x"] * 10 + ["x", ""]
    assert count_copies({"status": status, "digest": digests}) == pytest.approx((90 + 100) / 100)
    assert count_copies({"status": [], "digest": []}) == 1


def test_few_frames_and_frames_without_a_pixel_say_nothing(rng):
    assert np.isnan(stacked(result(white(rng)) for _ in range(7)).structure().sigmas)
    assert np.isnan(stacked(result(white(rng)) for _ in range(14)).structure(2.0).sigmas)
    assert np.isnan(stacked(result(np.full(SHAPE, np.nan)) for _ in range(20)).structure().sigmas)
