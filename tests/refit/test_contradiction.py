"""Frame against prior: chance is what it says, and what chance does not allow is not taken in silence."""

import numpy as np
import pytest
import scipy.stats

from jitterkit.forward import free_parameters, to_vector
from jitterkit.likelihood import Data
from jitterkit.loci import Linear, Mvn, Stable
from jitterkit.refit import FitOptions, Priors, Status, fit_best_locus, fit_locus
from jitterkit.refit.contradiction import prior_chance
from jitterkit.refit.fit import _CONTRADICTION

SHAPE = np.array([[1.0, 0.3, 0.5], [0.0, 0.8, -0.2], [0.0, 0.0, 1.2]])
"""Columns of correlated errors of the three moments."""


def fit(bench, data, locus, name, priors=None):
    options = FitOptions(priors=priors or Priors())
    near = np.asarray(locus.moments()) + np.array([1e-3, 0, 1e-3])
    return fit_locus(name, data, bench.optics, bench.near(), near, options=options)


def chance(bench, result, priors):
    names, free = free_parameters(result.parameters, bench.optics.nominal)
    return prior_chance(priors, result.parameters, names, free, result.covariance, np.zeros(len(names)))


# a frame knows the moments to about 1e-4: priors that know more, as much and less
@pytest.mark.parametrize("width", [1e-5, pytest.param(1e-4, marks=pytest.mark.slow), 1e-2])
def test_the_chance_of_a_prior_that_holds_is_anything_from_0_to_1(bench, rng, width):
    locus, told = Mvn.of(0.12, 0.06, 30.0), SHAPE @ SHAPE.T * width**2
    found = []
    for _ in range(24):
        moments = rng.multivariate_normal(np.asarray(locus.moments()), told)
        priors = Priors({"noll7": (4.0 + rng.normal(), 1.0)}, (moments, told))
        data = bench.draw(bench.truth(locus, (4.0, -3.0)), rng)
        found.append(chance(bench, fit(bench, data, locus, "mvn", priors), priors))
    # Kolmogorov's test: one honest seed in a thousand fails
    assert scipy.stats.kstest(found, "uniform").pvalue > 1e-3


def test_the_chance_is_that_of_two_independent_measurements(bench):
    # without noise the frame alone ends at the truth, with the covariance V of a fit without prior; a prior
    # with P then lies off by d with chi-squared d (P + V)^-1 d, whatever the two together make of it
    locus = Mvn.of(0.1, 0.07, 30.0)
    data = Data(bench.image(bench.truth(locus)), 1.0)
    plain = fit(bench, data, locus, "mvn")
    slots = [plain.names.index(name) for name in ("contrast", *Mvn.names)]
    own = plain.covariance[np.ix_(slots, slots)]
    spread = np.sqrt(np.diag(own))
    told = np.diag(spread) ** 2 * 2
    told[1:, 1:] = np.diag(spread[1:]) @ (SHAPE @ SHAPE.T) @ np.diag(spread[1:])
    off = np.array([0.8, -0.9, 0.7, 0.4]) * spread
    moments = np.asarray(locus.moments()) + off[1:]
    priors = Priors({"contrast": (3.0 + off[0], np.sqrt(told[0, 0]))}, (moments, told[1:, 1:]))
    expected = scipy.stats.chi2.sf(off @ np.linalg.solve(told + own, off), 4)
    result = fit(bench, data, locus, "mvn", priors)
    # the information changes by a per cent over such a step, and so does chi-squared
    assert chance(bench, result, priors) == pytest.approx(expected, rel=0.02)
    assert result.flags == plain.flags


def test_a_locus_that_cannot_follow_a_prior_is_tested_by_what_it_has(bench):
    # a streak has no width: that of the prior, three sigmas, is against it whatever the frame shows
    locus = Linear.of(0.5, 0.0)
    data = Data(bench.image(bench.truth(locus)), 1.0)
    told = np.eye(3) * 1e-10
    priors = Priors(moments=(np.asarray(locus.moments()) + np.array([0, 0, 3e-5]), told))
    result = fit(bench, data, locus, "linear", priors)
    assert chance(bench, result, priors) == pytest.approx(scipy.stats.chi2.sf(9, 3), rel=0.02)


def test_a_prior_is_accused_however_sure_it_is_of_itself_but_not_for_being_sure(bench, rng):
    locus, flagged = Mvn.of(0.12, 0.06, 30.0), 0
    data = bench.draw(bench.truth(locus), rng)
    error = fit(bench, data, locus, "mvn").error("separation")
    for width in (1e-2, 1e-4):  # of the frame's error
        priors = Priors({"separation": (5.0 + 10 * error, width * error)})
        assert "prior_contradicted" in fit(bench, data, locus, "mvn", priors).flags
    for _ in range(20):
        data = bench.draw(bench.truth(locus), rng)
        priors = Priors({"separation": (5.0 + 1e-2 * error * rng.normal(), 1e-2 * error)})
        flagged += "prior_contradicted" in fit(bench, data, locus, "mvn", priors).flags
    assert flagged == 0  # by chance in two of a hundred runs of this test


def test_a_step_that_a_fit_left_undone_changes_no_chance(bench, rng):
    locus = Mvn.of(0.12, 0.06, 30.0)
    data = bench.draw(bench.truth(locus), rng)
    error = fit(bench, data, locus, "mvn").error("separation")
    priors = Priors({"separation": (5.0 + error, 1e-3 * error)})
    result = fit(bench, data, locus, "mvn", priors)
    names, free = free_parameters(result.parameters, bench.optics.nominal)
    # of a normal the slope is the inverse covariance times the way to the maximum: half a sigma of the prior,
    # which would be 500 of what the frame is expected to move it by
    way = np.zeros(len(names))
    way[names.index("separation")] = 5e-4 * error
    vector, unravel = to_vector(result.parameters)
    short = unravel(vector.at[np.array(free)].add(-way))
    score = np.linalg.solve(result.covariance, way)
    found = prior_chance(priors, short, names, free, result.covariance, score)
    # the covariance is that of 32-bit slopes, good to 1e-6
    assert found == pytest.approx(chance(bench, result, priors), rel=1e-5)


@pytest.mark.parametrize("name", ["mvn", "linear"])
def test_fifty_sigmas_are_flagged_and_said(bench, rng, name):
    locus = Linear.of(0.5, 30.0)
    data, moments = bench.draw(bench.truth(locus), rng), np.asarray(locus.moments())
    covariance = fit(bench, data, locus, "mvn").moments()[1]
    priors = Priors(moments=(moments + 50 * np.sqrt(np.diag(covariance)), covariance))
    result = fit(bench, data, locus, name, priors)
    assert "prior_contradicted" in result.flags
    assert _CONTRADICTION in result.message


def test_a_prior_on_one_parameter_is_tested_too_whoever_chooses_the_locus(bench, rng):
    data = bench.draw(bench.truth(Stable.of()), rng)
    error = fit(bench, data, Stable.of(), "mvn").error("contrast")
    for sigmas, flagged in ((50, True), (1, False)):
        options = FitOptions(priors=Priors({"contrast": (3.0 + sigmas * error, error)}))
        result = fit_best_locus(data, bench.optics, bench.near(), np.zeros(3), options=options)
        assert ("prior_contradicted" in result.flags) == flagged


def test_a_streak_of_zero_length_is_not_accused_for_what_a_cone_forbids(bench, rng):
    # a prior about no jitter has negative variances as often as not; no streak has
    told, flagged = SHAPE @ SHAPE.T * 1e-10, 0
    for _ in range(12):
        data = bench.draw(bench.truth(Stable.of()), rng)
        priors = Priors(moments=(rng.multivariate_normal(np.zeros(3), told), told))
        result = fit(bench, data, Stable.of(), "linear", priors)
        assert result.status is Status.OK, result.message
        flagged += "prior_contradicted" in result.flags
    assert flagged == 0


def test_a_prior_of_three_sigmas_that_no_streak_can_have_is_no_contradiction(bench, rng):
    # the likelihood's slope at a tip is no step that a fit left undone, nor is the tip a mean of prior and
    # frame: of the prior's width alone it is 9 for three degrees of freedom, one in 34
    data = bench.draw(bench.truth(Stable.of()), rng)
    priors = Priors(moments=(np.array([-1.0, 0.0, -1.0]) * 3e-5 / np.sqrt(2), np.eye(3) * 1e-10))
    result = fit(bench, data, Stable.of(), "linear", priors)
    assert result.status is Status.OK, result.message
    assert "jitter_undetected" in result.flags
    assert "prior_contradicted" not in result.flags


def test_without_a_prior_there_is_nothing_to_contradict(bench, rng):
    data = bench.draw(bench.truth(Linear.of(0.6, 30.0)), rng)
    result = fit(bench, data, Linear.of(0.6, 30.0), "mvn")
    assert chance(bench, result, Priors()) == 1.0
    assert "prior_contradicted" not in result.flags
