"""Moments where a frame does not tell the shape of the blur, against images by direct sums."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.stats
from own_images import drift, star_image

from jitterkit.batch.diagnose import classify
from jitterkit.estimators.shape import CumulantStep
from jitterkit.forward import Parameters
from jitterkit.frames import Frame
from jitterkit.likelihood import Data
from jitterkit.loci import Mvn
from jitterkit.refit import FitOptions, FitResult, Priors, Status, fit_best_locus, fit_locus
from jitterkit.refit.result import Candidate, StraightBlur
from jitterkit.scene import Star


def near(electrons):
    return Parameters(Star(0.62, -1.08, 0.98 * electrons), Mvn.of(0.1), np.zeros(2))


def test_the_moments_of_a_drift_are_right_where_its_shape_is_not_certain(optics):
    """Fitted with a normal, as long as the kurtosis is below three errors, they are off by two of theirs."""
    image = star_image(0.6, -1.1, 2e5, drift(0.6, 25)) + 2.0
    result = fit_best_locus(Data(image, 9.0), optics, near(2e5), np.array([0.02, 0.0, 0.02]))
    moments, covariance = result.moments()
    c, s = np.cos(np.radians(25)), np.sin(np.radians(25))
    off = moments - 0.6**2 / 12 * np.array([c * c, c * s, s * s])  # of a uniform streak
    assert abs(result.shape) < 3 * result.shape_err
    # no noise: what the pupil's 64 samples and the loci's priors leave
    assert np.all(np.abs(off) < 0.3 * np.sqrt(np.diag(covariance)))
    normal = fit_locus("mvn", Data(image, 9.0), optics, near(2e5), np.array([0.02, 0.0, 0.02]))
    assert normal.moments()[0][0] - moments[0] > np.sqrt(covariance[0, 0])


def test_a_drift_whose_shape_is_not_seen_has_the_mean_kurtosis_of_straight_blurs(optics):
    """Values and errors are those of a blur that is fitted with such a prior on its kurtosis."""
    image = star_image(0.6, -1.1, 2e5, drift(0.4, 25)) + 2.0
    data, start = Data(image, 9.0), np.array([0.01, 0.0, 0.01])
    result = fit_best_locus(data, optics, near(2e5), start)
    assert [one.locus for one in result.candidates] == ["mvn"]
    shaped = Priors({"shaped_kurtosis": (-0.75, 0.75)})
    expected = fit_locus("shaped", data, optics, near(2e5), start, options=FitOptions(priors=shaped))
    (moments, covariance), (wanted, wide) = result.moments(), expected.moments()
    errors = np.sqrt(np.diag(wide))
    assert np.sqrt(np.diag(covariance)) == pytest.approx(errors, rel=0.02)
    assert np.all(np.abs(moments - wanted) < 0.02 * errors)
    assert abs(float(result.parameters.scene.flux - expected.parameters.scene.flux)) < 0.02 * result.error(
        "flux"
    )
    normal, _ = fit_locus("mvn", data, optics, near(2e5), start).moments()
    truth = 0.4**2 / 12 * np.cos(np.radians(25)) ** 2
    assert abs(moments[0] - truth) < 0.5 * abs(normal[0] - truth)


def under_noise(path, major, minor, angle, points=5):
    """Return a path whose every point is shaken normally, by Gauss-Hermite quadrature."""
    nodes, shares = np.polynomial.hermite_e.hermegauss(points)
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    return [
        (x + major * u * c - minor * v * s, y + major * u * s + minor * v * c, share * p * q / (2 * np.pi))
        for x, y, share in path
        for u, p in zip(nodes, shares, strict=True)
        for v, q in zip(nodes, shares, strict=True)
    ]


def test_a_wide_blur_that_may_be_normal_has_errors_that_hold_other_shapes(optics):
    """A drift under noise has a kurtosis of about -0.4, and the moments of a normal are off by two errors."""
    image = star_image(0.6, -1.1, 1e5, under_noise(drift(0.8, 25), 0.2, 0.15, 80)) + 2.0
    data, start = Data(image, 9.0), np.array([0.06, 0.0, 0.04])
    result = fit_best_locus(data, optics, near(1e5), start)
    assert result.locus == "mvn"
    assert abs(result.shape) < 3 * result.shape_err
    normal = fit_locus("mvn", data, optics, near(1e5), start)
    shaped = Priors({"shaped_kurtosis": (0.0, 0.75)})
    free = fit_locus("shaped", data, optics, near(1e5), start, options=FitOptions(priors=shaped))
    odds = scipy.stats.norm.pdf(result.shape, scale=np.hypot(0.75, result.shape_err))
    odds /= scipy.stats.norm.pdf(result.shape, scale=result.shape_err)
    share, (narrow, before), (wide, after) = odds / (1 + odds), normal.moments(), free.moments()
    moments, covariance = result.moments()
    expected = (1 - share) * before + share * after
    expected += share * (1 - share) * np.outer(wide - narrow, wide - narrow)
    # one step from the normal says less of the kurtosis than a fit of it
    assert np.diag(covariance) == pytest.approx(np.diag(expected), rel=0.3)
    off = moments - narrow - share * (wide - narrow)
    assert np.all(np.abs(off) < 0.2 * np.sqrt(np.diag(covariance)))
    truth = 0.8**2 / 12 + 0.2**2 + 0.15**2  # of both axes together
    sums = [covariance[0, 0] + covariance[2, 2] + 2 * covariance[0, 2] for covariance in (before, covariance)]
    assert narrow[0] + narrow[2] - truth > 1.2 * np.sqrt(sums[0])
    assert abs(moments[0] + moments[2] - truth) < 0.4 * np.sqrt(sums[1])


def test_an_unknown_kurtosis_never_narrows_an_error():
    """Its variance is that of all fitted together, and at most its prior's where curvatures do not agree."""
    p = Parameters(Star(0.0, 0.0, 1e5), Mvn.near(np.array([0.02, 0.0, 0.01])), np.zeros(0))
    jacobian = np.random.default_rng(3).normal(size=(40, 12)) * np.array([1.0] * 3 + [3e3] * 9)
    step = CumulantStep(p, Mvn.names, np.zeros(12), jacobian.T @ jacobian)
    covariance = np.linalg.inv(step.information[:3, :3])
    together = step.information_of_shaped()
    together[3, 3] += 0.5**-2
    _, added = step.unknown_shape(covariance, -0.75, 0.5)
    assert covariance + added == pytest.approx(np.linalg.inv(together)[:3, :3], rel=1e-6)
    change, added = step.unknown_shape(400 * covariance, -0.75, 0.5)
    assert np.all(np.diag(added) > 0)
    assert added == pytest.approx(np.outer(change, change) * (0.5 / 0.75) ** 2, rel=1e-9)


def test_the_mean_pointing_of_a_star_that_jumped_is_right(optics):
    """A tenth of the time 0.4 arcsec aside: a normal misses the mean by four errors, chi-squared is usual."""
    jump = 0.4 * np.array([np.cos(np.radians(30)), np.sin(np.radians(30))])
    image = star_image(0.6, -1.1, 2e5, [(0, 0, 0.9), (*jump, 0.1)]) + 2.0
    result = fit_best_locus(Data(image, 9.0), optics, near(2e5), np.array([0.01, 0.0, 0.01]))
    scene = result.parameters.scene
    for name, truth in (("x", 0.6 + 0.1 * jump[0]), ("y", -1.1 + 0.1 * jump[1])):
        assert abs(float(scene.values[name]) - truth) < 0.5 * result.error(name)


def test_errors_of_moments_hold_what_not_knowing_the_locus_adds():
    p = Parameters(Star(0.0, 0.0, 1e5), Mvn.near(np.array([0.02, 0.0, 0.01])), np.zeros(0))
    names, covariance = ("mvn_xx", "mvn_xy", "mvn_yy"), np.diag([1e-6, 1e-6, 1e-6])
    candidates = (
        Candidate("mvn", 0.0, 0.75, np.nan, moments=(0.02, 0.0, 0.01)),
        Candidate("ellipse", 0.0, 0.25, np.nan, moments=(0.018, 0.0, 0.009)),
        Candidate("linear", np.nan, 0.0, np.nan),
    )
    fit = FitResult(
        Status.OK, "", locus="mvn", parameters=p, names=names, covariance=covariance, candidates=candidates
    )
    expected = np.diag([1e-6, 1e-6, 1e-6])
    expected[0, 0] += 0.25 * 0.002**2  # by hand
    expected[2, 2] += 0.25 * 0.001**2
    expected[0, 2] = expected[2, 0] = 0.25 * 0.002 * 0.001
    assert fit.moments()[1] == pytest.approx(expected, rel=1e-9)


def taken_for_a_vibration(shape_err):
    """A frame whose excess kurtosis is -1.3, between a drift's and a vibration's -1.2 and -1.5."""
    p = Parameters(Star(0.0, 0.0, 1e5), Mvn.near(np.array([0.018, 0.0, 0.0])), np.zeros(0))
    candidates = (
        Candidate("shm", 0.0, 0.6, np.nan, moments=(0.018, 0.0, 0.0)),
        Candidate("linear", 0.0, 0.4, np.nan, moments=(0.021, 0.0, 0.0)),
    )
    known = {"names": ("mvn_xx", "mvn_xy", "mvn_yy"), "covariance": np.diag([1e-6, 1e-6, 1e-6])}
    straight = StraightBlur(-1.3, shape_err, np.array([0.01, 0.0, 0.0]))
    return FitResult(
        Status.OK, "", locus="shm", parameters=p, candidates=candidates, straight=straight, **known
    )


def test_a_frame_that_may_be_wrong_about_its_locus_has_the_moments_of_the_kurtosis_that_it_shows():
    moments, covariance = taken_for_a_vibration(0.25).moments()
    # by hand: 0.003 for 0.3 of kurtosis, from a vibration's -1.5 to -1.3; its error is 0.25
    assert moments == pytest.approx([0.020, 0.0, 0.0])
    assert covariance[0, 0] == pytest.approx(1e-6 + 0.0025**2)
    moments, covariance = taken_for_a_vibration(0.05).moments()
    assert moments == pytest.approx([0.018, 0.0, 0.0])
    assert covariance[0, 0] == pytest.approx(1e-6 + 0.4 * 0.003**2)


@pytest.mark.parametrize(("weight", "counts"), [(0.04, False), (0.3, True)])
def test_an_ellipse_adds_to_the_errors_of_a_straight_blur_that_it_may_be(weight, counts):
    fit = taken_for_a_vibration(0.25)
    plain, straight = fit.moments(), (1 - weight)
    ellipse = Candidate("ellipse", 0.0, weight, np.nan, moments=(0.019, 0.0, 0.002))
    rest = [replace(one, weight=one.weight * straight) for one in fit.candidates]
    moments, covariance = replace(fit, candidates=(*rest, ellipse)).moments()
    assert moments == pytest.approx(plain[0])
    assert covariance[2, 2] == pytest.approx(plain[1][2, 2] + counts * weight * 0.002**2)
    mostly = [replace(one, weight=0.01) for one in fit.candidates]  # then the kurtosis is not looked at
    moments, _ = replace(fit, candidates=(*mostly, replace(ellipse, weight=0.98))).moments()
    assert moments == pytest.approx([0.018, 0.0, 0.0])


def test_a_normal_that_may_be_straight_has_the_moments_of_the_kurtosis_that_is_shown():
    fit = taken_for_a_vibration(0.25)
    normal = Candidate("mvn", 9.0, 0.5, np.nan, moments=(0.018, 0.0, 0.0))
    rest = [replace(one, weight=one.weight / 2) for one in fit.candidates]
    moments, covariance = replace(fit, locus="mvn", candidates=(normal, *rest)).moments()
    # by hand: 0.018 less 1.3 of kurtosis at 0.01 each; its error is 0.25
    assert moments == pytest.approx([0.005, 0.0, 0.0])
    assert covariance[0, 0] == pytest.approx(1e-6 + 0.0025**2)


@pytest.mark.parametrize("size", [0.75, 0.85])
def test_a_drift_that_may_be_a_vibration_has_its_own_moments(size, optics):
    """By the distance of both fits' images; by one step of scoring they are farther off."""
    image = star_image(0.6, -1.1, 5e5, drift(size, 25)) + 2.0
    result = fit_best_locus(Data(image, 9.0), optics, near(5e5), np.array([0.02, 0.0, 0.02]))
    objective = {one.locus: one.objective for one in result.candidates}
    # without noise: a drift's own chi-squared is none, a vibration's the square of its distance in kurtosis
    distance = np.sqrt(objective["shm"] - objective["linear"])
    assert result.straight.error == pytest.approx(0.3 / distance, rel=0.03)
    assert result.straight.kurtosis == pytest.approx(-1.2, abs=0.03 * result.straight.error)
    moments, covariance = result.moments()
    c, s = np.cos(np.radians(25)), np.sin(np.radians(25))
    off = (moments - size**2 / 12 * np.array([c * c, c * s, s * s])) / np.sqrt(np.diag(covariance))
    assert np.all(np.abs(off) < 0.012)


@pytest.mark.parametrize(("width", "narrow"), [(1.0, False), (0.8, True)])
def test_a_star_that_is_narrower_than_still_is_a_misfit(width, narrow, optics, rng):
    """Pixels that respond over 0.8 of their width take (1 - 0.8²)/12 of a pixel² from both variances."""
    image = rng.poisson(star_image(0.6, -1.1, 3e5, [(0, 0, 1)], width=width) + 2.0)
    image = image + rng.normal(0, 3, image.shape)
    result = fit_locus("mvn", Data(image, 9.0), optics, near(3e5), np.zeros(3))
    moments, covariance = result.moments()
    off = (moments + (1 - width**2) / 12 * 0.375**2 * np.array([1, 0, 1])) / np.sqrt(np.diag(covariance))
    assert np.all(np.abs(off) < 3.5)
    result = classify(Frame(image, 9.0, plate_scale=0.375), result, 0.375)
    assert ("misfit" in result.flags, "narrower" in result.message) == (narrow, narrow)
