"""One star or two: what a frame supports, and what it leaves open."""

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.integrate import quad

from jitterkit.batch import FrameProcessor
from jitterkit.forward import Parameters
from jitterkit.instruments import load_instrument
from jitterkit.likelihood import Data
from jitterkit.locate import Start, locate_binary
from jitterkit.loci import Linear, Mvn, PartialShm, Path, Shm, Stable, Tones
from jitterkit.refit import FitOptions, FitResult, Priors, Status, choose_scene, fit_locus, weigh_scenes
from jitterkit.refit.choose_scene import _Frame
from jitterkit.refit.reading import FittedPair, Reading, is_same_maximum
from jitterkit.refit.scene_prior import ScenePrior
from jitterkit.refit.weigh_scenes import Weighing
from jitterkit.scene import Binary, Star, Stars
from jitterkit.simulate import simulate_frame

ALONE = partial(Star, 0.3, -0.2)


@pytest.fixture(scope="module")
def chosen(bench):
    """What is chosen of a drawn frame."""

    def choose(scene, locus, seed=1):
        truth = Parameters(scene, locus, (4.0, -3.0))
        return choose_scene(bench.draw(truth, np.random.default_rng(seed)), bench.optics)

    return choose


@pytest.mark.parametrize(
    ("flux", "locus"),
    [
        (1e5, Stable.of()),
        (1e5, Mvn.of(0.2, 0.05, 30.0)),
        (1e6, Linear.of(0.8, 70.0)),
        (1e6, Shm.of(2.5, 160.0)),
    ],
    ids=["still", "shaken", "drifting", "vibrating by more than two resolutions"],
)
def test_one_star_is_one_whatever_its_jitter(flux, locus, chosen):
    choice = chosen(ALONE(flux), locus)
    assert choice.scene == "star"
    assert choice.log_odds < 0
    (x,), (y,), (light,) = map(np.asarray, choice.start.parameters.scene.sources())
    assert (x, y) == pytest.approx((0.3, -0.2), abs=0.02)
    assert light == pytest.approx(flux, rel=0.02)


@pytest.mark.parametrize(
    ("flux", "locus"),
    [
        pytest.param(6.5e4, PartialShm.of(1.8, 161.5, 1.08, -33.0), marks=pytest.mark.slow),
        (2e5, PartialShm.of(2.46, 92.0, 1.28, -50.0)),
        (2e5, Tones.of(2.46, 92.0, 1.45, 117.7)),
    ],
    ids=["a part of a vibration", "a large part", "two vibrations, nearly along a line"],
)
def test_a_star_is_one_though_a_pair_comes_nearer_than_it_does_with_a_simple_locus(flux, locus, chosen):
    choice = chosen(ALONE(flux), locus, seed=7)
    assert choice.scene == "star"
    assert choice.log_odds < -3
    assert choice.fit.locus == ("tones" if isinstance(locus, Tones) else "partial")


@pytest.mark.slow
def test_a_star_that_dwells_at_both_ends_of_its_motion_is_weighed_though_a_pair_comes_nearer():
    # it was taken for a pair, which was a poor fit: chi²/dof of 2.2 in place of 1.01
    telescope = load_instrument("smallsat")
    processor, rng = FrameProcessor(telescope), np.random.default_rng(1)
    motion = PartialShm.of(3.0, 30.0, 0.7)
    seen = processor.calibrate(simulate_frame(telescope, ALONE(3e6), motion, rng=rng).raw)
    frame = _Frame(Data.of(seen), processor.optics(seen), FitOptions(), rough=True)
    pair, star = frame.pair(), frame.star()
    assert star.deviance_dof - 1 > 4 * (pair.deviance_dof - 1)
    assert not frame.comes_nearer(pair, star)


def test_a_star_that_dwells_at_two_places_of_a_walk_is_not_a_pair_for_certain(chosen):
    """Odds were e^11 for a pair, though a path fits better: its fit began between the two places."""
    along = 0.7 * np.array([0.0, 0.1, -0.1, 0.0, 0.1, 1.0, 1.1, 1.0])
    across = 0.2 * np.array([1.0, -1.0, 1.0, -0.5, -1.0, 1.0, -1.0, 0.5])
    choice = chosen(ALONE(1e5), Path.of(np.stack([along, across], axis=1)))
    assert choice.scene == "star" or choice.undecided or choice.ambiguity


@pytest.mark.parametrize(
    ("of_star", "of_pair", "separation", "error", "worse", "chosen", "alike"),
    [
        ("path", "mvn", 0.5, None, 8.0, "star", True),
        ("smear", "mvn", 0.5, None, -2.0, "star", True),
        ("linear", "stable", 0.5, None, 8.0, "star", True),
        ("linear", "mvn", 0.5, None, -2.0, "star", False),  # a freer jitter fits as well in any case
        ("path", "mvn", 0.5, None, 10.0, "star", False),
        ("path", "mvn", 1.5, None, 8.0, "star", False),
        ("path", "mvn", 1.5, 0.6, 8.0, "star", False),  # B may be too faint to be seen
        ("path", "mvn", 1.5, 0.4, 8.0, "star", True),  # moments were 44 errors off, without a flag
        ("path", "mvn", 1.5, None, -8.0, "pair", True),
        ("path", "mvn", 0.5, None, -10.0, "pair", False),
        ("linear", "mvn", 0.5, None, -8.0, "pair", False),
    ],
)
def test_a_close_pair_that_fits_as_well_looks_like_an_intricate_star_though_it_has_no_evidence(
    of_star, of_pair, separation, error, worse, chosen, alike, bench
):
    """Of pairs at half a resolution two of eight were a star on a path: the pair's errors were infinite."""
    weighing = Weighing(None, bench.optics, FitOptions(), False)
    pair = Binary(separation * weighing.fineness, 30.0, 0.0, 0.0, 1e5, 2.0)
    shown = [Parameters(scene, Mvn.of(0.1), (4.0, -3.0)) for scene in (ALONE(1e5), pair)]
    fits = [
        FitResult(Status.OK, "", parameters=one, locus=locus, objective=objective)
        for one, locus, objective in zip(shown, (of_star, of_pair), (4000.0, 4000.0 + worse), strict=True)
    ]
    if error is not None:
        fits[1] = replace(fits[1], names=("contrast",), covariance=np.array([[error**2]]))
    star, two = Reading(None, fits[0], -2000.0), Reading(None, fits[1], -math.inf)
    assert weighing.look_alike(star, two, star if chosen == "star" else two) == alike


@pytest.mark.parametrize(
    ("locus", "of_pair", "of_star", "worse"),
    [
        ("path", 2.3, 3.0, False),  # a vibrating pair 1.8 resolutions apart: 1.0 with its own blur
        ("path", 3.1, 3.0, True),
        ("shm", 2.3, 3.0, True),  # a simple blur of one star describes the frame
        ("shm", 1.3, 3.0, False),
    ],
)
def test_a_pair_with_a_normal_blur_is_held_against_one_star_with_one(locus, of_pair, of_star, worse, bench):
    """The right pair was dropped for one star on a path, with moments 83 errors off and status ok."""
    weighing = Weighing(Data(np.ones((40, 50)), 1.0), bench.optics, FitOptions(), False)
    truth = Parameters(Binary(1.0, 30.0, 0.0, 0.0, 1e5, 2.0), Mvn.of(0.1), (4.0, -3.0))
    pair = Start(truth, bench.optics.nominal, of_pair, np.eye(1), ("separation",))
    star = FitResult(Status.OK, "", parameters=truth, locus=locus, objective=1.08 * 2000)
    assert weighing.is_worse(pair, Reading(replace(pair, deviance_dof=of_star), star, -1000.0)) == worse


def test_a_pair_without_jitter_is_read_so_though_its_start_has_a_jitter_for_certain(bench):
    """No reading was left, and one star with a chi-squared of 246 was a poor fit of a clear pair."""
    truth = Parameters(Binary(3.0, 140.0, 0.3, -0.2, 1e6, 3.0), Stable.of(), (4.0, -3.0))
    data = bench.draw(truth, np.random.default_rng(1))
    weighing = Weighing(data, bench.optics, FitOptions(), False)
    blurred = truth.with_locus(Mvn.of(0.5, 0.4, 10.0))
    start = Start(blurred, bench.optics.nominal, 14.0, 1e12 * np.eye(4), (*Mvn.names, "separation"))
    pair = FittedPair(start, fit_locus("mvn", data, bench.optics, truth, np.zeros(3)))
    star = Reading(start, pair.normal, -3e5)
    read = weighing.readings_of_pairs([pair], star)
    assert [one.fit.locus for one in read if math.isfinite(one.evidence)] == ["stable"]


def aberrated(scene, locus, rng, name="toliman", rms=8.0):
    """Data and optics of a frame; 8 nm rms in each of TOLIMAN's 19 modes are 0.36 rad in all."""
    telescope = load_instrument(name)
    state = rng.normal(0, rms, len(telescope.aberrations))
    processor = FrameProcessor(telescope)
    frame = processor.calibrate(simulate_frame(telescope, scene, locus, aberrations=state, rng=rng).raw)
    return Data.of(frame), processor.optics(frame)


@pytest.mark.slow
def test_stars_beside_one_that_outshines_them_are_a_field(rng):
    """By their peaks they are one star, or a pair with a chi-squared of 29."""
    x = np.array([9.97, 19.55, 14.62, -19.82, 19.65, -5.48, -17.40, 9.91])
    y = np.array([6.07, 4.84, 16.14, -10.89, 2.48, 6.32, 15.10, 15.10])
    flux = 1e3 * np.array([19.6, 16.1, 32.0, 27.0, 7.2, 13.2, 155.4, 19.3])
    data, optics = aberrated(Stars.of(x, y, flux), Stable.of(), rng, "smallsat", 3.0)
    choice = choose_scene(data, optics, rough=True)
    assert (choice.scene, choice.is_sure) == ("stars", True)
    found = np.array([np.asarray(part) for part in choice.start.parameters.scene.sources()])
    nearest = np.hypot(found[0] - x[:, None], found[1] - y[:, None]).argmin(axis=1)
    assert sorted(nearest) == list(range(8))
    assert found[2, nearest] == pytest.approx(flux, rel=0.03)


@pytest.mark.parametrize("length", [0.0, 0.375])
@pytest.mark.slow
def test_a_star_of_unknown_wavefront_is_no_pair(length):
    # a rough fit with the derivatives of a flat wavefront found a companion of 12 and of 8 errors
    rng = np.random.default_rng(1)
    locus = Linear.of(length, rng.uniform(0, 180)) if length else Stable.of()
    choice = choose_scene(*aberrated(Star(*rng.uniform(-1, 1, 2), 1e7), locus, rng), rough=True)
    assert (choice.scene, choice.is_sure) == ("star", True)


@pytest.mark.slow
def test_a_star_behind_a_symmetric_pupil_is_found_through_a_large_wavefront():
    # derivatives of a flat wavefront are zero for focus and astigmatism: 0.4 rad of them were a poor fit
    rng = np.random.default_rng(2)
    locus = Linear.of(0.375, rng.uniform(0, 180))
    scene = Star(*rng.uniform(-1, 1, 2), 1e6)
    data, optics = aberrated(scene, locus, rng, "smallsat", 15.0)
    start = choose_scene(data, optics, rough=True).start
    assert start.parameters.scene.name == "star"
    assert start.describes(data)


@pytest.mark.parametrize("seed", [3, 2])
@pytest.mark.slow
def test_a_rough_start_describes_a_pair_of_unknown_wavefront(seed):
    # else everything is fitted that is no such pair: a minute
    pair = Binary(9.8, 30.0, 0.3, -0.2, 1e7, 3.37)
    data, optics = aberrated(pair, Mvn.of(0.15, 0.1, 70.0), np.random.default_rng(seed))
    start = locate_binary(data, optics, rough=True)
    assert start.describes(data)
    assert float(start.parameters.scene.separation) == pytest.approx(9.8, abs=0.01)


@pytest.mark.parametrize(
    ("separation", "contrast"),
    [(5.0, 3.0), (3.0, 200.0), pytest.param(1.0, 3.0, marks=pytest.mark.slow), (0.6, 2.0)],
    ids=["wide", "faint", "at the resolution", "closer"],
)
def test_two_stars_are_two(separation, contrast, chosen):
    choice = chosen(Binary(separation, 140.0, 0.3, -0.2, 3e6, contrast), Stable.of())
    assert choice.scene == "binary"
    assert choice.log_odds > 3
    assert float(choice.start.parameters.scene.separation) == pytest.approx(separation, abs=0.05)


@pytest.mark.parametrize("contrast", [pytest.param(1.2, marks=pytest.mark.slow), 2.0])
def test_two_stars_closer_than_the_resolution_are_two_under_jitter_too(contrast, bench):
    """One star with a long blur describes them to chi-squared's eye, hundreds lower in likelihood."""
    pair, locus = Binary(0.6, 140.0, 0.3, -0.2, 3e5, contrast), Mvn.of(0.15, 0.12, 20.0)
    data = bench.draw(Parameters(pair, locus, (4.0, -3.0)), np.random.default_rng(1))
    choice = choose_scene(data, bench.optics)
    assert choice.scene == "binary"
    assert choice.log_odds > 3
    start = choice.start
    fit = fit_locus("mvn", data, bench.optics, start.parameters, start.parameters.locus.moments(), start.otf)
    assert abs(fit.of_scene("separation") - 0.6) < 4 * fit.error("separation")
    moments, covariance = fit.moments()
    off = moments - np.asarray(locus.moments())
    assert off @ np.linalg.solve(covariance, off) < 3 + 4 * np.sqrt(6)  # chi-squared of three


def test_a_pair_that_vibrates_is_two_though_an_intricate_motion_of_one_comes_near(chosen):
    choice = chosen(Binary(0.75, 200.0, 0.3, -0.2, 4.8e5, 1.5), Shm.of(1.3, 30.0))
    assert choice.scene == "binary"
    assert choice.log_odds > 3


def test_a_pair_is_compared_with_an_intricate_star_as_well_as_it_can_be_fitted(bench, monkeypatch):
    """A path was better than a drifting pair with a normal blur: moments 17 errors off, without a flag."""

    def dwelling(self, one, two):
        assert two.fit.locus == "mvn"
        return replace(one, fit=replace(one.fit, locus="path"), evidence=two.evidence + 5.0)

    monkeypatch.setattr(Weighing, "dwelling", dwelling)
    monkeypatch.setattr(weigh_scenes, "needs_more", lambda star, _: star.locus == "path")
    truth = Parameters(Binary(1.8, 343.7, 0.3, -0.2, 3.9e4, 6.8), Linear.of(1.9, 23.4), (4.0, -3.0))
    choice = choose_scene(bench.draw(truth, np.random.default_rng(1)), bench.optics)
    assert choice.scene == "binary"
    assert choice.log_odds > 3


def test_a_prior_on_the_jitter_does_not_choose_the_scene(bench):
    truth = Parameters(ALONE(1e6), Linear.of(0.8, 30.0), (4.0, -3.0))
    data = bench.draw(truth, np.random.default_rng(1))
    choice = choose_scene(data, bench.optics, FitOptions(priors=Priors(moments=(np.zeros(3), np.eye(3)))))
    assert choice.scene == "star"
    assert -math.inf < choice.log_odds < -3


@pytest.mark.parametrize(
    "options",
    [FitOptions(hold=("background", "contrast")), FitOptions(priors=Priors({"separation": (5.0, 0.1)}))],
    ids=["held", "known"],
)
def test_who_knows_something_of_a_pair_gets_one(options, bench):
    truth = Parameters(Binary(5.0, 140.0, 0.3, -0.2, 3e6, 3.0), Stable.of(), (4.0, -3.0))
    choice = choose_scene(bench.draw(truth, np.random.default_rng(1)), bench.optics, options)
    assert (choice.scene, choice.log_odds) == ("binary", math.inf)


def test_two_stars_much_closer_than_the_resolution_look_like_a_smear_and_that_is_said(chosen):
    choice = chosen(Binary(0.25, 140.0, 0.3, -0.2, 1e5, 1.0), Stable.of())
    assert choice.scene == "star"
    assert "two stars 0.2" in choice.ambiguity
    assert "one star with a jitter of" in choice.readings
    assert "two stars 0.2" in choice.readings


def test_an_empty_frame_has_no_scene(bench, rng):
    assert choose_scene(Data(rng.normal(0, 2.4, (48, 44)), 2.4**2), bench.optics) is None


def test_the_priors_of_the_scenes_add_up_to_one(bench):
    """The density of a pair, integrated over separations, directions and contrasts, and that of a star."""
    prior = ScenePrior.of(bench.optics.nominal)

    def density(separation, contrast):
        pair = Parameters(Binary(separation, 0.0, 0.0, 0.0, 1e5, contrast), Stable.of(), np.zeros(2))
        # an error that is nothing: all of it lies where B is the fainter star
        fit = FitResult(Status.OK, "", parameters=pair, names=("contrast",), covariance=np.array([[1e-12]]))
        return math.exp(prior.log_density(fit))

    contrasts, _ = quad(lambda log: math.exp(log) * density(1.0, math.exp(log)), 1e-9, math.log(999.999))
    least, most = prior.fineness / 10, prior.width * math.sqrt(2)
    separations, _ = quad(
        lambda log: math.exp(log) * density(math.exp(log), 2.0), math.log(least), math.log(most)
    )
    star = FitResult(Status.OK, "", parameters=Parameters(ALONE(1e5), Stable.of(), np.zeros(2)))
    total = separations / density(1.0, 2.0) * contrasts * 360.0
    assert total + math.exp(prior.log_density(star)) == pytest.approx(1.0, rel=1e-4)


@pytest.mark.parametrize(
    ("moved", "deviance", "status", "same"),
    [
        (0.001, 4000.0, Status.OK, True),
        (0.02, 4000.0, Status.OK, False),
        (0.001, 4000.5, Status.OK, False),
        (0.001, 4000.0, Status.NOT_CONVERGED, False),  # the one that settled must stay
        (np.nan, 4000.0, Status.OK, False),
    ],
)
def test_two_pairs_are_one_if_their_fits_end_at_one_maximum_that_settled(moved, deviance, status, same):
    names = ("separation", "theta", "contrast")
    fits = [
        FitResult(
            how,
            "",
            parameters=Parameters(Binary(separation, 30.0, 0.0, 0.0, 1e5, 2.0), Mvn.of(0.1), ()),
            names=names,
            covariance=np.diag([0.1, 1.0, 0.1]) ** 2,
            objective=objective,
        )
        for how, separation, objective in ((status, 3.0, 4000.0), (Status.OK, 3.0 + moved, deviance))
    ]
    assert is_same_maximum(fits[1], fits[0]) == same
