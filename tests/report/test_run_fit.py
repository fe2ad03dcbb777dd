"""Whether all frames of a run together fit as well as noise allows."""

import numpy as np
import pytest

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
