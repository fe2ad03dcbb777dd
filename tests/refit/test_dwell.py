"""A star that dwells where a pair's stars would be."""

import math

import numpy as np
import pytest

from jitterkit.forward import Parameters
from jitterkit.loci import Mvn, Path, Shm, Stable
from jitterkit.refit import FitOptions, FitResult, SceneChoice, Status, fit_locus
from jitterkit.refit.dwell import _dwelling_stars, fit_dwelling_star, log_maxima, over_orders
from jitterkit.refit.evidence import log_evidence
from jitterkit.refit.locus_fit import FrameFits
from jitterkit.refit.result import Candidate
from jitterkit.refit.weigh import with_candidate
from jitterkit.scene import Binary, Star

PAIR = Binary(0.7, 30.0, 0.3, -0.2, 1e5, 2.0)


def test_a_path_starts_where_the_stars_are_for_as_long_as_they_are_bright():
    for start in _dwelling_stars(Parameters(PAIR, Stable.of(), (4.0, -3.0))):
        (xa, xb), (ya, yb), flux = (np.asarray(part) for part in PAIR.sources())
        knots = np.array(list(start.locus.describe().values())).reshape(-1, 2)
        knots += [float(start.scene.x), float(start.scene.y)]
        first = np.round(len(knots) * flux[0] / flux.sum()).astype(int)
        assert np.ptp(knots[:first], axis=0) == pytest.approx(0.0, abs=1e-9)
        assert np.ptp(knots[first:], axis=0) == pytest.approx(0.0, abs=1e-9)
        assert knots[-1] - knots[0] == pytest.approx([xb - xa, yb - ya])
        assert float(start.scene.flux) == pytest.approx(flux.sum())


def test_two_positions_to_and_fro_are_as_wide_as_the_blur_of_the_pair():
    blur = Mvn.of(0.2, 0.1, 70.0)
    start = next(_dwelling_stars(Parameters(PAIR, blur, (0.0, 0.0))))
    knots = np.array(list(start.locus.describe().values())).reshape(-1, 2)
    way = np.radians(70.0)
    assert (knots[0] - knots[1]) @ [math.cos(way), math.sin(way)] == pytest.approx(0.4)


def fits(bench, scene, locus, seed=1):
    """The fit of a pair to a drawn frame, and the frame."""
    truth = Parameters(scene, locus, (4.0, -3.0))
    data = bench.draw(truth, np.random.default_rng(seed))
    frame = FrameFits(data, bench.optics, FitOptions(), sure=True)
    start = Parameters(PAIR, Mvn.of(0.2), (4.0, -3.0))
    return frame, fit_locus("mvn", data, bench.optics, start, np.array([0.03, 0.0, 0.03]), sure=True)


@pytest.mark.slow  # test_choose_scene.py has such a walk
def test_a_walk_that_looks_like_a_pair_is_fitted_better_by_a_path(bench):
    along = 0.7 * np.array([0.0, 0.1, -0.1, 0.0, 0.1, 1.0, 1.1, 1.0])
    across = 0.2 * np.array([1.0, -1.0, 1.0, -0.5, -1.0, 1.0, -1.0, 0.5])
    walk = Path.of(np.stack([along, across], axis=1))
    frame, pair = fits(bench, Star(0.3, -0.2, 1e5), walk)
    path = fit_dwelling_star(frame, pair, FitResult(Status.FAILED, ""))
    best, evidence = over_orders(frame, path)
    assert best.objective < pair.objective
    assert log_evidence(path) <= log_evidence(best) <= evidence <= log_evidence(best) + log_maxima(best)
    moments, covariance = best.moments()
    off = moments - np.asarray(walk.moments())
    assert off @ np.linalg.solve(covariance, off) < 3 + 4 * np.sqrt(6)  # chi-squared of three


def test_a_pair_that_no_path_describes_takes_no_fit_of_one(bench, monkeypatch):
    frame, pair = fits(bench, Binary(1.2, 30.0, 0.3, -0.2, 2e6, 1.5), Shm.of(1.0, 120.0))
    monkeypatch.setattr("jitterkit.refit.dwell.fit_and_allow", lambda *_: pytest.fail("it was fitted"))
    assert fit_dwelling_star(frame, pair, FitResult(Status.FAILED, "")) is None


def test_four_positions_have_twelve_orders_and_many_have_as_many_maxima_as_were_counted():
    for knots, number in ((4, 12.0), (6, 100.0), (8, 100.0)):
        path = Parameters(Star(0.0, 0.0, 1.0), Path.of(np.eye(knots, 2)), (0.0,))
        assert math.exp(log_maxima(FitResult(Status.OK, "", parameters=path))) == pytest.approx(number)


def test_a_better_path_takes_the_place_of_the_one_before_among_the_candidates():
    before = tuple(Candidate(n, 10.0, 0.5, math.nan, evidence=e) for n, e in (("mvn", -5.0), ("path", -5.0)))
    after = with_candidate(before, FitResult(Status.OK, "", locus="path"), -4.0)
    assert [one.locus for one in after] == ["path", "mvn"]
    assert [one.weight for one in after] == pytest.approx([1 / (1 + math.exp(-1)), 1 / (1 + math.e)])


@pytest.mark.parametrize(
    ("log_odds", "alike", "said"),
    [(5.0, True, True), (5.0, False, False), (1.0, True, False), (-5.0, True, True)],
)
def test_what_looks_the_same_is_said_of_a_pair_as_of_a_star_and_of_their_run(log_odds, alike, said):
    choice = SceneChoice(None, log_odds, "one, or two", alike)
    assert bool(choice.ambiguity) == bool(choice.ambiguity_of_run) == said
    assert choice.is_clear == (log_odds == -5.0 or not alike)


def test_a_star_that_dwells_has_the_colour_of_the_pair():
    coloured = PAIR.coloured((1.0, -2.0))  # of two thirds and one third of the light
    for start in _dwelling_stars(Parameters(coloured, Mvn.of(0.2), (4.0, -3.0))):
        assert np.asarray(start.scene.source_indices()) == pytest.approx([0.0], abs=1e-12)
