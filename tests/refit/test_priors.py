"""Priors: what sequences, traces and moments say, how it adds up, and that it counts in a fit."""

from dataclasses import replace

import numpy as np
import pytest
from refusals import refused

from jitterkit.errors import ErrorCode
from jitterkit.loci import Linear, Mvn
from jitterkit.refit import (
    FitOptions,
    Priors,
    fit_locus,
    kernel_prior,
    moments_prior,
    sequence_prior,
    trace_prior,
)


def test_a_sequence_is_as_wide_as_its_next_frame_scatters(rng, estimates):
    # the predictive law of a normal sample: chi-squared of the next draw is 3 on average
    squares = []
    for _ in range(400):
        found = estimates(rng, 13)
        mean, covariance = sequence_prior(found, "night.fits[12]").moments
        off = found[12].moments - mean
        squares.append(off @ np.linalg.solve(covariance, off))
    # T² of 12 draws has mean 3 and standard deviation about 4 here: 4 * 4/sqrt(400) = 0.8, skewness aside
    assert abs(np.mean(squares) - 3) < 0.8


def test_the_mean_of_a_sequence_is_weighted_by_information(rng, estimates):
    found = estimates(rng, 7, scatter=0)
    sharp = replace(found[0], covariance=found[0].covariance * 1e-6)
    mean, _ = sequence_prior([sharp, *found[1:]], "other.fits").moments
    np.testing.assert_allclose(mean, sharp.moments, atol=1e-5 * np.abs(found[0].errors).max() * 10)


def test_an_estimate_that_does_not_say_what_it_was_made_from_is_no_prior(rng, estimates):
    found = estimates(rng, 8)
    nameless = replace(found[0], source="")
    with refused(ErrorCode.MISSING_VALUE):
        kernel_prior(nameless, "night.fits")
    with refused(ErrorCode.MISSING_VALUE):
        sequence_prior([*found, nameless], "night.fits")


def test_a_trace_has_the_moments_of_its_motion():
    t = np.linspace(0, 1, 4001)
    along = 0.2 * np.sin(2 * np.pi * 20 * t)  # an amplitude A has variance A²/2
    mean, covariance = trace_prior(t, along * np.cos(0.5), along * np.sin(0.5), 0.1).moments
    c, s = np.cos(0.5), np.sin(0.5)
    np.testing.assert_allclose(mean, 0.02 * np.array([c * c, c * s, s * s]), rtol=1e-3)
    # ten per cent of the rms are twenty of the variance, in any direction: also across
    assert np.sqrt(covariance[0, 0]) == pytest.approx(0.2 * 0.02, rel=1e-3)
    turn = np.array([s * s, -2 * s * c, c * c])
    assert np.sqrt(turn @ covariance @ turn) == pytest.approx(0.2 * 0.02, rel=1e-3)


def test_a_long_trace_tells_what_one_exposure_sees():
    t = np.arange(0, 10.0001, 0.01)
    drift = trace_prior(t, 0.3 * t, 0 * t, 0.1, exposure=1.0).moments
    assert drift[0][0] == pytest.approx(0.3**2 / 12, rel=1e-3)  # not (3 arcsec)²/12
    assert trace_prior(t, 0.3 * t, 0 * t, 0.1).moments[0][0] == pytest.approx(3.0**2 / 12, rel=1e-3)
    # where exposures differ, their scatter is in the width
    gusty = 0.3 * t * (t > 5)
    assert trace_prior(t, gusty, 0 * t, 0.1, exposure=1.0).moments[1][0, 0] > 1.5 * drift[1][0, 0]


def test_a_trace_that_stands_still_or_is_certain_is_refused():
    t = np.linspace(0, 1, 50)
    for offset in (0.0, 0.1, -3e5):  # of a mean of equal numbers rounding may leave a rest
        with refused(ErrorCode.NO_SIGNAL):
            trace_prior(t, 0 * t, 0 * t + offset)
    with refused(ErrorCode.NO_SIGNAL):
        trace_prior(t, np.maximum(t - 0.6, 0), 0 * t, exposure=0.55)  # moves afterwards only
    with refused(ErrorCode.OUT_OF_RANGE, 0.0):
        trace_prior(t, t, t, 0.0)


def test_a_prior_on_moments_holds_for_every_locus(bench, rng):
    streak = Linear.of(0.5, 30.0)
    data, moments = bench.draw(bench.truth(streak), rng), np.asarray(streak.moments())
    covariance = np.diag([1e-4, 2e-4, 1e-4]) ** 2
    plain = fit_locus("linear", data, bench.optics, bench.near(), moments)
    options = FitOptions(priors=moments_prior(moments, covariance))
    result = fit_locus("linear", data, bench.optics, bench.near(), moments, options=options)
    # the information adds, turned into the streak's coordinates: S = (q + c, s, q - c)/24 with q² = c² + s²
    c, s = np.asarray(result.parameters.locus.coords)
    q = np.hypot(c, s)
    slope = np.array([[c / q + 1, s / q], [0, 1], [c / q - 1, s / q]]) / 24
    told = np.linalg.inv(plain.covariance)
    slots = [plain.names.index(name) for name in Linear.names]
    told[np.ix_(slots, slots)] += slope.T @ np.linalg.solve(covariance, slope)
    np.testing.assert_allclose(np.sqrt(np.diag(np.linalg.inv(told))), _errors(result), rtol=0.02)
    assert result.error("linear_c") < 0.9 * plain.error("linear_c")
    assert result.crlb[slots[0]] == pytest.approx(plain.crlb[slots[0]], rel=0.02)


def _errors(result):
    return np.sqrt(np.diag(result.covariance))


def test_a_prior_pulls_by_its_information(bench):
    from jitterkit.likelihood import Data

    locus = Mvn.of(0.1, 0.1)
    data, truth = Data(bench.image(bench.truth(locus)), 1.0), np.asarray(locus.moments())
    plain = fit_locus("mvn", data, bench.optics, bench.near(), truth)
    off, covariance = np.array([3e-5, 0, 0]), plain.moments()[1]
    options = FitOptions(priors=moments_prior(truth + off, covariance))
    result = fit_locus("mvn", data, bench.optics, bench.near(), truth, options=options)
    # of two equally good opinions the mean; the information changes by under a per cent over so small a step
    np.testing.assert_allclose(result.moments()[0] - truth, off / 2, atol=0.02 * 3e-5)


def test_an_impossible_prior_is_refused():
    with refused(ErrorCode.OUT_OF_RANGE, (-np.eye(3)).tolist()):
        moments_prior(np.zeros(3), -np.eye(3))
    with refused(ErrorCode.OUT_OF_RANGE, "[nan, nan, nan]"):
        moments_prior(np.full(3, np.nan), np.eye(3))


def test_a_trace_of_whole_exposures_is_cut_whatever_rounding_does():
    # a drift of 1 arcsec/s: in an exposure of e seconds a variance of e²/12, however long the trace
    for start in (0.0, 5.3, 1e4 + 0.1):
        for exposure in (0.1, 0.3, 0.7):
            for pieces in (1, 3, 7):
                t = start + np.linspace(0, pieces * exposure, pieces * 50 + 1)
                mean, _ = trace_prior(t, t - start, 0 * t, exposure=exposure).moments
                assert mean[0] == pytest.approx(exposure**2 / 12, rel=1e-6)


def test_a_trace_longer_than_one_exposure_is_not_taken_for_one():
    t = np.linspace(0, 1.95, 400)
    mean, _ = trace_prior(t, t, 0 * t, exposure=1.0).moments
    assert mean[0] == pytest.approx(1 / 12, rel=1e-4)
    with refused(ErrorCode.OUT_OF_RANGE, "1.95 s", "4 s"):
        trace_prior(t, t, 0 * t, exposure=4.0)


def test_a_packed_file_holds_the_same_frame(rng, estimates):
    (found,) = estimates(rng, 1)
    assert kernel_prior(replace(found, source="night.fits.gz[0]"), "night.fits").moments is None


def test_what_holds_where_a_parameter_is_free_is_nothing_where_it_is_not():
    known = Priors.alike(("noll4", "noll7"), 5.0).joined(Priors({"noll7": (1.0, 2.0)}))
    assert known.on(("x", "noll4", "noll7")) == {"noll4": (0.0, 5.0), "noll7": (1.0, 2.0)}
    assert np.diag(known.over(("x", "noll7")).precision).tolist() == [0.0, 0.25]
    with refused(ErrorCode.UNKNOWN_NAME, "'noll7'", "x, noll4"):
        known.over(("x", "noll4"))
    with refused(ErrorCode.OUT_OF_RANGE, "noll4", -1.0):
        Priors.alike(("noll4",), -1.0)
    assert Priors.alike(("noll4",), None) == Priors()


def test_two_priors_on_the_moments_count_both(same):
    one, other = np.array([0.02, 0.004, 0.01]), np.array([0.026, 0.002, 0.013])
    tight, wide = np.diag([1.0, 4.0, 9.0]) * 1e-6, np.diag([2.0, 4.0, 1.0]) * 1e-6
    first = Priors({"noll7": (0.0, 5.0), "x": (0.0, 1.0)}, (one, tight))
    both = first.joined(Priors({"x": (0.1, 2.0)}, (other, wide)))
    # of two measurements of one number the mean by inverse variance: thirds, halves, tenths
    np.testing.assert_allclose(both.moments[0], [0.022, 0.003, 0.0127], rtol=1e-12)
    np.testing.assert_allclose(both.moments[1], np.diag([2 / 3, 2.0, 0.9]) * 1e-6, rtol=1e-12, atol=1e-20)
    assert both.terms == {"noll7": (0.0, 5.0), "x": (0.1, 2.0)}
    assert same(first.joined(Priors()), first)
    assert same(Priors().joined(first), first)
