"""The choice of the locus: as fine as the frame can tell, and no finer."""

import re
from dataclasses import replace

import numpy as np
import pytest
from own_images import star_image

from jitterkit.docs import read_page
from jitterkit.forward import Parameters
from jitterkit.likelihood import Data
from jitterkit.locate import locate_star
from jitterkit.loci import LOCI, Ellipse, Linear, Mvn, PartialShm, Shm, Stable
from jitterkit.refit import (
    FitOptions,
    Priors,
    Status,
    choose,
    evidence,
    fit_best_locus,
    fit_locus,
    locus_fit,
    moments_prior,
)
from jitterkit.refit.fit import fit_and_allow
from jitterkit.scene import Star


def choose_for(bench, data, moments, **options):
    return fit_best_locus(data, bench.optics, bench.near(), np.asarray(moments), **options)


@pytest.mark.parametrize(
    ("locus", "chosen"),
    [
        (Linear.of(0.9, 30.0), "linear"),
        (Shm.of(0.9, 30.0), "shm"),
        (Mvn.of(0.2, 0.1), "mvn"),
        (Ellipse.of(0.5, 0.35, 30.0), "ellipse"),
        pytest.param(PartialShm.of(0.9, 30.0, 0.7, 50.0), "partial", marks=pytest.mark.slow),
    ],
)
def test_auto_takes_the_locus_that_the_frame_shows(locus, chosen, bench, rng):
    # no noise, so that what is chosen does not hang on a draw; at 3e7 electrons the loci differ by 10 in ln Z
    data = Data(bench.image(bench.truth(locus, flux=3e7)), 1.0)
    result = choose_for(bench, data, locus.moments())
    assert result.locus == chosen
    assert result.locus_weight > 0.95
    assert sum(c.weight for c in result.candidates) == pytest.approx(1.0)
    assert "µas" not in result.message  # of a separation that hangs on the choice
    # a regularized fit stops within 0.03 errors of its end, and the prior pulls
    off = float(result.parameters.binary.separation) - 5.0
    assert abs(off) < 0.05 * result.error("separation")


def test_a_locus_added_as_the_handbook_says_is_tried_and_chosen(bench, monkeypatch):
    page, scope = read_page("extending"), {}
    exec(compile(re.search(r"```python\n(.*?)```", page, re.S)[1], "extending.md", "exec"), scope)
    monkeypatch.setitem(LOCI, "laplace", scope["Laplace"])
    entry = eval(re.search(r'"laplace": (Choice\(.*\)),', page)[1], vars(evidence))
    monkeypatch.setitem(evidence.CHOICES, "laplace", entry)
    locus = scope["Laplace"].of(0.3, 0.15, 30.0)
    data = Data(bench.image(bench.truth(locus, flux=3e7)), 1.0)
    result = choose_for(bench, data, locus.moments())
    assert result.locus == "laplace"
    assert result.locus_weight > 0.95


def test_jitter_is_said_to_be_there_as_often_as_the_test_says(bench, rng):
    chi2, flags = [], 0
    for _ in range(60):
        data = bench.draw(bench.truth(Stable.of()), rng)
        result = choose_for(bench, data, np.zeros(3))
        moments, covariance = fit_locus("mvn", data, bench.optics, bench.near(), np.zeros(3)).moments()
        chi2.append(moments @ np.linalg.solve(covariance, moments))
        flags += "jitter_undetected" in result.flags
        assert result.locus == "mvn" or chi2[-1] > choose.DETECTED
    # chi-squared with 3 degrees of freedom: mean 3, variance 6; 0.6 of 60 lie above its 99 % point, and
    # more than 5 once in 3e4 times
    assert abs(np.mean(chi2) - 3) < 4 * np.sqrt(6 / 60)
    assert flags >= 60 - 5
    assert pytest.approx(0.01) == choose.FALSE_ALARM
    assert pytest.approx(11.3449, abs=1e-4) == choose.DETECTED  # from a table of chi-squared


def estimated(bench, data):
    """Moments and covariance of a fit, as an estimate has them."""
    return fit_locus("mvn", data, bench.optics, bench.near(), np.zeros(3)).moments()


def test_a_still_frame_gets_no_parameters_of_jitter_where_it_may_do_without(bench, rng):
    data, may = bench.draw(bench.truth(Stable.of()), rng), FitOptions(may_be_still=True)
    moments, covariance = estimated(bench, data)
    still = choose_for(bench, data, moments, options=may, covariance=covariance)
    known = fit_locus("stable", data, bench.optics, bench.near(), moments)
    assert (still.locus, still.flags) == ("stable", ("jitter_undetected",))
    assert still.names == known.names
    assert still.of_scene("separation") == known.of_scene("separation")
    assert [one.locus for one in still.candidates] == ["stable"]
    others = (
        {"covariance": covariance},  # it must not do without
        {"options": may},  # nobody knows whether it shows any
        {"options": may, "covariance": np.full((3, 3), np.nan)},
        {
            "options": replace(may, priors=moments_prior(np.zeros(3), 1e-4 * np.eye(3))),
            "covariance": covariance,
        },
    )
    for options in others:
        assert choose_for(bench, data, moments, **options).locus == "mvn"


@pytest.mark.parametrize("spoilt", [False, True])
def test_a_frame_that_no_still_model_describes_is_fitted_as_ever(bench, rng, spoilt):
    """Jitter is seen; or it is not, by an estimate that is wrong."""
    data, may = bench.draw(bench.truth(Mvn.of(0.6, 0.2)), rng), FitOptions(may_be_still=True)
    moments, covariance = estimated(bench, data)
    assert choose.is_jitter_undetected(moments, covariance) is False
    usual = choose_for(bench, data, moments)
    found = choose_for(bench, data, moments, options=may, covariance=covariance * (1e9 if spoilt else 1.0))
    assert found.locus == usual.locus != "stable"
    assert found.of_scene("separation") == usual.of_scene("separation")


def test_a_frame_between_two_loci_says_which_and_what_hangs_on_it(bench):
    streak = Shm.of(0.4, 30.0)
    data = Data(bench.image(bench.truth(streak)), 1.0)
    result = choose_for(bench, data, streak.moments())
    found = re.search(r" shm and linear\b.* ([\d.]+) µas", result.message)
    assert found, result.message
    by_name = {c.locus: c for c in result.candidates}
    difference = abs(by_name["shm"].separation - by_name["linear"].separation)
    assert float(found[1]) == pytest.approx(difference * 1e6, abs=0.06)
    assert 0.5 < result.locus_weight < 0.95
    assert 0 < result.separation_spread < difference
    # both streaks have the same prior but for v² of the length: equal weights up to deviance and widths
    log_odds = by_name["shm"].evidence - by_name["linear"].evidence
    assert by_name["shm"].weight / by_name["linear"].weight == pytest.approx(np.exp(log_odds))
    assert log_odds == pytest.approx((by_name["linear"].objective - by_name["shm"].objective) / 2, abs=0.2)


def test_what_a_small_blur_does_not_show_is_not_asked(bench, rng):
    blur = Mvn.of(0.05, 0.04)
    result = choose_for(bench, bench.draw(bench.truth(blur), rng), blur.moments())
    assert "jitter_undetected" not in result.flags
    assert [c.locus for c in result.candidates] == ["mvn"]
    assert result.shape_err > 5
    assert np.isnan(result.separation_spread)


def test_no_locus_is_asked_to_mend_what_is_no_jitter(bench, monkeypatch):
    locus, tried = Shm.of(0.9, 30.0), []
    image = bench.image(bench.truth(locus, flux=3e7))
    speckled = image + 0.2 * image.max() * (np.indices(image.shape).sum(axis=0) % 7 == 0)

    def noting(data, optics, start, *others):
        tried.append(type(start.locus))
        return fit_and_allow(data, optics, start, *others)

    monkeypatch.setattr(locus_fit, "fit_and_allow", noting)
    result = choose_for(bench, Data(speckled, 1.0), locus.moments())
    assert result.status is Status.POOR_FIT
    assert tried == [Mvn]


def test_a_streak_that_no_normal_describes_is_found_all_the_same(bench):
    locus = Shm.of(2.0, 30.0)
    data = Data(bench.image(bench.truth(locus, flux=3e7)), 1.0)
    normal = fit_locus("mvn", data, bench.optics, bench.near(), np.asarray(locus.moments()))
    assert normal.status is Status.POOR_FIT
    assert choose_for(bench, data, locus.moments()).locus == "shm"


def test_a_candidate_that_breaks_down_takes_nothing_with_it(bench, rng, monkeypatch):
    streak = Shm.of(0.9, 30.0)
    data = bench.draw(bench.truth(streak), rng)
    whole = locus_fit.fit_and_allow

    def fragile(data, optics, start, otf, options):
        if isinstance(start.locus, Ellipse):
            raise np.linalg.LinAlgError("Singular matrix")
        fit, otf, data = whole(data, optics, start, otf, options)
        unsettled = isinstance(start.locus, Linear)
        return (replace(fit, status=Status.NOT_CONVERGED) if unsettled else fit), otf, data

    monkeypatch.setattr(locus_fit, "fit_and_allow", fragile)
    result = choose_for(bench, data, streak.moments())
    assert result.status is Status.OK
    weights = {c.locus: c.weight for c in result.candidates}
    assert weights["ellipse"] == weights["linear"] == 0.0
    assert result.locus == "shm"
    assert np.isfinite(result.separation_spread)


def test_a_locus_across_its_axis_is_not_tried_on_a_round_blur(bench, rng):
    blur = Mvn.of(0.2, 0.15)
    result = choose_for(bench, bench.draw(bench.truth(blur), rng), blur.moments())
    assert {c.locus for c in result.candidates} == {"mvn", "ellipse"}


def test_a_prior_on_moments_leaves_the_choice_and_one_on_a_coordinate_does_not(bench):
    streak = Shm.of(0.9, 30.0)
    data = Data(bench.image(bench.truth(streak)), 1.0)
    moments = np.asarray(streak.moments())
    told = FitOptions(priors=moments_prior(moments, np.eye(3) * 1e-6))
    assert choose_for(bench, data, moments, options=told).locus == "shm"
    normal = FitOptions(priors=Priors({"mvn_xx": (moments[0], 0.1)}))
    assert [c.locus for c in choose_for(bench, data, moments, options=normal).candidates] == ["mvn"]


def test_two_vibrations_across_each_other_are_not_taken_for_an_ellipse(optics):
    """One step sees half of what two tones gain; as an ellipse, moments are wrong by four to five errors."""
    phases = (np.arange(8) + 0.5) * np.pi / 8
    one, other = (
        half * np.outer(np.cos(phases), [np.cos(angle), np.sin(angle)])
        for half, angle in ((0.4, np.radians(10)), (0.3, np.radians(70)))
    )
    places = (one[:, None] + other).reshape(-1, 2)
    truth = (places.T @ places / len(places))[np.triu_indices(2)]
    image = star_image(0.6, -1.1, 1e5, [(dx, dy, 1 / len(places)) for dx, dy in places]) + 2.0
    rng = np.random.default_rng(1)
    start = Parameters(Star(0.62, -1.08, 1e5), Mvn.of(0.2), np.zeros(2))
    for _ in range(3):
        pixels = rng.poisson(image) + rng.normal(0, 3, image.shape)
        result = fit_best_locus(Data(pixels, 9.0), optics, start, np.array([0.05, 0.0, 0.05]))
        moments, covariance = result.moments()
        assert result.locus == "tones"
        assert np.all(np.abs(moments - truth) < 3.5 * np.sqrt(np.diag(covariance)))


def test_a_random_walk_that_no_simple_locus_describes_is_a_path(optics, rng):
    """An ellipse took up a part of what a normal left, its score asked for little more, and that was all."""
    places = [(-0.3, -0.09), (-0.16, 0.38), (-0.26, 0.11), (-0.05, 0.25)]
    places += [(0.13, 0.29), (0.34, 0.86), (0.37, 1.15), (0.44, 0.96)]
    way = np.stack(
        [np.interp(np.linspace(0, 7, 60), range(8), axis) for axis in np.transpose(places)], axis=1
    )
    way -= way.mean(axis=0)
    image = star_image(0.3, -0.2, 7.3e4, [(*place, 1 / len(way)) for place in way])
    data = Data(rng.poisson(image) + rng.normal(0, 2.4, image.shape), 2.4**2)
    start = locate_star(data, optics)
    moments = np.asarray(start.parameters.locus.moments())
    fit = fit_best_locus(data, optics, start.parameters, moments, start.otf)
    assert (fit.status, fit.locus) == (Status.OK, "path")
    assert {"ellipse", "tones", "path"} <= set(fit.tried)
    found, covariance = fit.moments()
    true = np.array([np.mean(way[:, i] * way[:, j]) for i, j in ((0, 0), (0, 1), (1, 1))])
    assert fit.parameters.locus.knots > 4  # moments of four are off by up to four errors
    assert np.all(np.abs(found - true) < 3 * np.sqrt(np.diag(covariance)))
