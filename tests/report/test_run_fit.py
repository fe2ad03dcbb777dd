"""Whether all frames of a run together fit as well as noise allows."""

import numpy as np
import pytest

from jitterkit.report.residual_stack import ResidualStack
from jitterkit.report.sequence import assess_run_fit, describe_run_fit

DOF = 16000


def run(rng, count, excess=0.0, error=5e-4):
    """Chi-squared per degree of freedom by its law, with so much added to each frame's chi-squared."""
    return assess_run_fit(
        (rng.chisquare(DOF, count) + excess) / DOF, np.full(count, DOF), np.full(count, error)
    )


def test_frames_that_fit_are_let_alone(rng):
    sigmas = np.array([run(rng, 60)["sigmas"] for _ in range(300)])
    # normal, but for the scatter of 60 frames, which the law of chi-squared keeps from being too small
    assert abs(sigmas.mean()) < 3.5 / np.sqrt(300)
    assert 0.8 < sigmas.std() < 1.1
    assert describe_run_fit(run(rng, 60)) == ""


def test_a_misfit_that_no_frame_shows_is_seen_in_many(rng):
    """A tenth of a percent: 0.09 of one frame's standard deviation of 179, 9 of those of 10,000 frames."""
    fit = run(rng, 10_000, excess=16.0)
    assert fit["sigmas"] == pytest.approx(16 / np.sqrt(2 * DOF) * 100, abs=3.5)
    # a bias of 0.2 of an error of 5e-4 arcsec for each root of the chi-squared of 16 +- 1.8
    assert fit["may_hide"] == pytest.approx(0.2 * 4 * 5e-4, rel=0.25)
    assert "10,000" in describe_run_fit(fit)
    assert "µas" in describe_run_fit(fit)


def test_frames_without_a_separation_say_so_too(rng):
    fit = run(rng, 1000, excess=500.0, error=np.nan)
    assert fit["sigmas"] > 5
    assert np.isnan(fit["may_hide"])
    assert "separation" not in describe_run_fit(fit)


def test_a_better_fit_than_noise_is_no_misfit(rng):
    assert describe_run_fit(run(rng, 1000, excess=-500.0)) == ""


def test_few_frames_and_frames_without_a_fit_say_nothing(rng):
    assert describe_run_fit(run(rng, 7, excess=1e4)) == ""
    values = np.append(rng.chisquare(DOF, 20) / DOF, [np.nan, 7.0])
    fit = assess_run_fit(values, np.append(np.full(20, DOF), [DOF, 0]), np.full(22, 1e-3))
    assert fit["frames"] == 20


def stack_of(rng, frames, excess=0.0):
    """A stack of 128 x 128 pixels by its law; a pattern adds so much to the chi-squared of each frame."""
    shape = (128, 128)
    pattern = rng.normal(size=shape)
    pattern *= np.sqrt(excess / np.sum(pattern**2))
    total = 256 * (frames * pattern + np.sqrt(frames) * rng.normal(size=shape))
    squares = 256**2 * frames * (DOF + excess) * np.array([1.0, 9.0])
    return ResidualStack(0.375, frames, np.rint(total).astype(int), np.full(shape, frames), squares)


def test_the_stack_shows_what_the_mean_does_not(rng):
    """Chi-squared of 9 a frame of 1,000: 1.6 errors of the mean, 50 standard deviations of the stack."""
    values = (rng.chisquare(DOF, 1000) + 9) / DOF
    fit = assess_run_fit(values, np.full(1000, DOF), np.full(1000, 5e-4), stack_of(rng, 1000, 9.0))
    assert fit["sigmas"] < 5 < 40 < fit["structure_sigmas"]
    assert fit["stack_frames"] == 1000
    assert fit["may_hide"] == pytest.approx(0.2 * 3 * 5e-4, rel=0.1)
    said = describe_run_fit(fit)
    assert "1,000" in said
    assert "µas" in said
    assert "mean chi-squared" not in said


def test_the_bias_is_that_of_the_larger_misfit(rng):
    values = (rng.chisquare(DOF, 1000) + 400) / DOF
    fit = assess_run_fit(values, np.full(1000, DOF), np.full(1000, 5e-4), stack_of(rng, 1000, 9.0))
    assert min(fit["sigmas"], fit["structure_sigmas"]) > 5
    assert fit["may_hide"] == pytest.approx(0.2 * 20 * 5e-4, rel=0.1)
    assert {"mean", "stacked"} < set(describe_run_fit(fit).split())


def test_a_stack_of_noise_says_nothing(rng):
    fit = assess_run_fit(*(np.full(100, value) for value in (1.0, DOF, 5e-4)), stack_of(rng, 100))
    assert abs(fit["structure_sigmas"]) < 3.5
    assert np.isnan(fit["may_hide"])
    assert describe_run_fit(fit) == ""


def test_duplicates_do_not_count_as_frames(rng):
    fit = assess_run_fit(*(np.full(50, value) for value in (1.0, DOF, 5e-4)), stack_of(rng, 100), 2.0)
    assert fit["stack_frames"] == 50
