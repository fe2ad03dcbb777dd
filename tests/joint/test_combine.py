"""The filter and the smoother against the same linear model solved at once, as one dense matrix."""

from __future__ import annotations

import numpy as np
import pytest

from jitterkit.joint.combine import combine
from jitterkit.joint.likelihood_summary import LikelihoodSummaries, LikelihoodSummary, eliminate
from jitterkit.joint.ornstein_uhlenbeck import fit_ornstein_uhlenbeck
from jitterkit.joint.time_models import Constant, OrnsteinUhlenbeck, Polynomial

FRAMES = 40


def every(summaries):
    """Count all frames."""
    return np.ones(len(summaries), bool)


def summarise(rng, truth, times, *, scatter=1.0):
    """Make summaries of frames that measure two correlated parameters (n, 2), at points near them."""
    summaries = LikelihoodSummaries(("separation", "focus"))
    noisy = []
    for time, true in zip(times, truth, strict=True):
        mix = rng.standard_normal((2, 2)) + 2 * np.eye(2)
        information = mix @ mix.T
        best = true + scatter * np.linalg.solve(mix.T, rng.standard_normal(2))
        at = best + rng.standard_normal(2)
        summaries.append(LikelihoodSummary(time, at, information @ (best - at), information))
        noisy.append((best, information))
    return summaries, noisy


def solved_at_once(noisy, prior):
    """Mean and covariance of all parameters of all frames (2n), given their prior covariance."""
    n = len(noisy)
    information = np.zeros((2 * n, 2 * n))
    right = np.zeros(2 * n)
    for i, (best, part) in enumerate(noisy):
        information[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = part
        right[2 * i : 2 * i + 2] = part @ best
    covariance = np.linalg.inv(np.linalg.inv(prior) + information)
    return covariance @ right, covariance


def prior_of(times, separation, focus):
    """Prior covariance (2n, 2n) of two independent parameters, each (n, n)."""
    n = len(times)
    prior = np.zeros((n, 2, n, 2))
    prior[:, 0, :, 0], prior[:, 1, :, 1] = separation, focus
    return prior.reshape(2 * n, 2 * n) + 1e-7 * np.eye(2 * n)


def test_constant_and_ornstein_uhlenbeck_are_the_dense_solution(rng):
    times = np.sort(rng.uniform(0, 100, FRAMES))
    truth = np.column_stack([np.full(FRAMES, 5.0), 3 * np.sin(times / 20)])
    summaries, noisy = summarise(rng, truth, times)
    found = combine(summaries, {"focus": OrnsteinUhlenbeck(3.0, 25.0)}, every(summaries))
    apart = np.abs(np.subtract.outer(times, times))
    wide = 1e4 * np.ones((FRAMES, FRAMES))
    mean, covariance = solved_at_once(noisy, prior_of(times, wide, wide + 9 * np.exp(-apart / 25)))
    shared = list(found.shared())
    assert np.allclose([s.values for s in shared], mean.reshape(-1, 2), atol=2e-4)
    assert np.allclose([s.errors for s in shared], np.sqrt(np.diag(covariance)).reshape(-1, 2), rtol=2e-4)
    assert found.value("separation") == pytest.approx(mean[0], abs=2e-4)
    assert found.error("separation") == pytest.approx(np.sqrt(covariance[0, 0]), rel=2e-4)


def test_a_polynomial_is_the_weighted_least_squares_one(rng):
    times = np.linspace(10, 50, FRAMES)
    u = (times - 30) / 20
    truth = np.column_stack([5 + 0.7 * u, np.full(FRAMES, -2.0)])
    summaries, noisy = summarise(rng, truth, times)
    found = combine(summaries, {"separation": Polynomial(1)}, every(summaries))
    design = np.zeros((2 * FRAMES, 3))
    design[::2, 0], design[::2, 1], design[1::2, 2] = 1, u, 1
    weight = np.zeros((2 * FRAMES, 2 * FRAMES))
    for i, (_, part) in enumerate(noisy):
        weight[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = part
    covariance = np.linalg.inv(design.T @ weight @ design)
    best = covariance @ design.T @ weight @ np.concatenate([b for b, _ in noisy])
    errors = np.sqrt(np.diag(covariance))
    assert found.value("separation") == pytest.approx(best[0], abs=1e-5)
    assert found.slopes[0] == pytest.approx(best[1], abs=1e-5)
    assert found.slope_errors[0] == pytest.approx(errors[1], rel=1e-5)
    assert found.error("focus") == pytest.approx(errors[2], rel=1e-5)


def test_evidence_prefers_the_law_that_is_true(rng):
    times = np.arange(200.0)
    still = np.column_stack([np.full(200, 5.0), np.zeros(200)])
    moving = still + np.column_stack([np.zeros(200), np.cumsum(rng.standard_normal(200)) * 0.5])
    for truth, better, worse in (
        (still, {"focus": Constant()}, {"focus": OrnsteinUhlenbeck(3.0, 20.0)}),
        (moving, {"focus": OrnsteinUhlenbeck(3.0, 20.0)}, {"focus": Constant()}),
    ):
        summaries, _ = summarise(rng, truth, times)
        assert (
            combine(summaries, better, every(summaries)).evidence
            > combine(summaries, worse, every(summaries)).evidence + 3
        )


def test_leave_one_out_chi_squared_is_that_of_the_frame_against_the_others(rng):
    times = np.arange(float(FRAMES))
    summaries, noisy = summarise(rng, np.zeros((FRAMES, 2)), times)
    others = sum(part for i, (_, part) in enumerate(noisy) if i != 7)
    centre = np.linalg.solve(others, sum(part @ best for i, (best, part) in enumerate(noisy) if i != 7))
    best, part = noisy[7]
    expected = (best - centre) @ np.linalg.solve(np.linalg.inv(part) + np.linalg.inv(others), best - centre)
    shared = list(combine(summaries, {}, every(summaries)).shared())
    assert shared[7].leave_one_out_chi2 == pytest.approx(expected, rel=1e-4)
    assert shared[7].dof == 2
    # 40 frames of two degrees of freedom, nearly independent: mean 2, standard error 0.32
    assert np.mean([s.leave_one_out_chi2 for s in shared]) == pytest.approx(2.0, abs=1.0)


def test_frames_that_do_not_belong_are_left_out_and_the_rest_is_as_if_they_were_not_there(rng):
    times = np.arange(100.0)
    truth = np.zeros((100, 2))
    bad = [3, 40, 41, 42, 99]
    state = rng.bit_generator.state
    clean, _ = summarise(rng, truth, times)
    rng.bit_generator.state = state
    truth[bad] += [[50, 0], [8, 8], [30, -30], [9, 0], [0, 300]]
    spoilt, _ = summarise(rng, truth, times)
    found = combine(spoilt, {})
    assert np.flatnonzero(~found.kept).tolist() == bad
    without = LikelihoodSummaries(clean.names)
    for i, summary in enumerate(clean):
        if i not in bad:
            without.append(summary)
    expected = combine(without, {}, every(without))
    assert np.allclose(found.values, expected.values, atol=1e-4)
    assert np.allclose(found.covariance, expected.covariance, rtol=1e-6)


def test_good_frames_are_not_left_out(rng):
    kept = [
        combine(summarise(rng, np.zeros((100, 2)), np.arange(100.0))[0], {}).kept.all() for _ in range(30)
    ]
    assert sum(kept) >= 28  # 0.3 of 30 runs are expected to flag a frame; three would be 0.4 %


def test_a_parameter_that_no_frame_tells_of_has_no_error(rng):
    summaries = LikelihoodSummaries(("separation", "focus"))
    for time in range(5):
        summaries.append(LikelihoodSummary(time, np.zeros(2), np.array([0.3, 0.0]), np.diag([4.0, 0.0])))
    found = combine(summaries, {})
    assert found.error("separation") == pytest.approx(1 / np.sqrt(20), rel=1e-5)
    assert np.isnan(found.error("focus"))


@pytest.mark.slow
def test_an_ornstein_uhlenbeck_process_is_estimated(rng):
    n, rms, timescale = 1500, 3.0, 40.0
    left = np.exp(-1 / timescale)
    focus = np.empty(n)
    focus[0] = rms * rng.standard_normal()
    for i in range(1, n):
        focus[i] = left * focus[i - 1] + rms * np.sqrt(1 - left**2) * rng.standard_normal()
    summaries, _ = summarise(rng, np.column_stack([np.zeros(n), focus]), np.arange(float(n)))
    found = fit_ornstein_uhlenbeck(summaries, ("focus",), {})
    # 1500/80 independent stretches: rms to 16 %; what is well known is the step, rms² / timescale
    assert found.rms == pytest.approx(rms, rel=0.5)
    assert found.rms**2 / found.timescale == pytest.approx(rms**2 / timescale, rel=0.25)


def test_what_a_frame_has_of_its_own_is_eliminated(rng):
    mix = rng.standard_normal((5, 5))
    information, score = mix @ mix.T, rng.standard_normal(5)
    own = np.linalg.inv(information[np.ix_([0, 2, 4], [0, 2, 4])])
    reduced = eliminate(score, information, [1, 3], [0, 2, 4], own)
    covariance = np.linalg.inv(information)
    block = covariance[np.ix_([1, 3], [1, 3])]
    assert np.allclose(np.linalg.inv(block), reduced[1])
    step = (covariance @ score)[[1, 3]]
    assert np.allclose(np.linalg.solve(reduced[1], reduced[0]), step)


def test_frames_whose_errors_are_wrong_are_not_picked_from(rng):
    summaries = LikelihoodSummaries(("separation",))
    values = 10 * rng.standard_normal(50)
    for i, value in enumerate(values):
        summaries.append(LikelihoodSummary(float(i), np.array([value]), np.zeros(1), np.eye(1)))
    found = combine(summaries, {})
    assert found.kept.all()
    assert found.value("separation") == pytest.approx(values.mean(), abs=1e-4)


def test_a_slow_change_is_not_taken_for_outliers(rng):
    summaries = LikelihoodSummaries(("separation",))
    for i in range(60):
        value = 0.3 * (i - 30) + rng.standard_normal() + 20 * (i == 17)
        summaries.append(LikelihoodSummary(float(i), np.array([value]), np.zeros(1), np.eye(1)))
    assert np.flatnonzero(~combine(summaries, {}).kept).tolist() == [17]


def test_a_walk_much_slower_than_the_run_keeps_its_steps(rng):
    n, steps = 120, []
    for _ in range(6):
        walk = np.cumsum(rng.standard_normal(n))
        summaries, _ = summarise(rng, np.column_stack([np.zeros(n), walk]), np.arange(float(n)))
        found = fit_ornstein_uhlenbeck(summaries, ("focus",), {})
        steps.append(2 * found.rms**2 / found.timescale)
    # 120 steps measure their variance to 13 %, noisy ones to twice that; six walks to 11 %
    assert np.mean(steps) == pytest.approx(1.0, rel=0.35)
