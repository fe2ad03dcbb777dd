"""Plans: cheap, as exact as promised, and refused where nothing keeps the promise."""

import math
import re
from dataclasses import replace

import equinox as eqx
import numpy as np
import pytest
from astropy.io import fits
from planner_loss import fitted, loss
from refusals import refused

from jitterkit.batch import FrameProcessor
from jitterkit.errors import ErrorCode
from jitterkit.loci import Mvn, PartialShm, Stable
from jitterkit.refit import FitOptions
from jitterkit.refit.priors import Priors
from jitterkit.report.words import angle_size
from jitterkit.scene import Binary
from jitterkit.trade import Settings, TradeScene, plan
from jitterkit.trade.explain import explain
from jitterkit.trade.methods import Fitting
from jitterkit.trade.plan import Plan, Planner, work
from jitterkit.trade.predict import Example
from jitterkit.trade.worst_case import OWN, WorstCase, examples_of

FEW = {
    "pad": (0, 8, 32),
    "samples": (3, 5),
    "binning": (1,),
    "region": (24,),
    "tolerance": (0.1, 1e-2, 1e-4, 1e-5, 1e-6),
}


@pytest.fixture
def planner(example, monkeypatch):
    monkeypatch.setattr(plan, "GRID", FEW)
    return Planner([example])


@pytest.mark.parametrize("allowed", [5e-6, 1e-4])
@pytest.mark.slow
def test_the_cheapest_settings_that_keep_a_promise_are_found(planner, example, one, allowed):
    found = planner.cheapest(allowed).settings
    whole = fitted(Settings(), example, one).error("separation")
    assert loss(found, example, one, whole) <= allowed
    cheaper = [settings for settings in planner.by_work() if planner.work(settings) < planner.work(found)]
    assert cheaper
    nearest = cheaper if allowed < 1e-5 else cheaper[-3:]  # each is compiled: all of them in the slow test
    assert all(loss(settings, example, one, whole) > 0.75 * allowed for settings in nearest)


@pytest.mark.parametrize(
    ("share", "tolerance"),
    [pytest.param(1.2, 0.1, marks=pytest.mark.slow), (0.21, 1e-2), (0.11, 1e-4), (0.011, 1e-5)],
)
def test_a_fit_is_ended_within_a_tenth_of_what_is_allowed(planner, share, tolerance):
    """Linearised optics leave 0.01 of an error to any tolerance down to 1e-4, and less to tighter ones."""
    assert planner.cheapest(share * planner.worst_case.sigma).settings.tolerance == tolerance


@pytest.mark.slow
def test_what_cannot_be_kept_is_refused_with_what_can(planner):
    with refused(ErrorCode.OUT_OF_RANGE, "1e-07 uas") as caught:
        planner.cheapest(1e-13)
    least = float(re.findall(r"([\d.e+-]+) uas", str(caught.value))[-1]) * 1e-6
    assert planner.cheapest(least).loss <= least


def test_the_faintest_example_says_when_a_fit_has_to_end(plain, planner, example):
    faint = Binary(5.0, 0.0, 0.0, 0.0, 0.1 * plain.flux, 3.0)
    scene = TradeScene.of(plain, faint, Mvn.of(0.2, 0.1, 20.0), 1, np.random.default_rng(5))
    other = Example.of(scene.noisy[0], example.processor)
    sigma = other.result.error("separation")
    assert sigma > 3 * planner.worst_case.sigma
    both = Planner([example, other])
    assert both.worst_case.sigma == planner.worst_case.sigma  # what a share of the error is counted by
    assert (
        both.cheapest(planner.worst_case.sigma).settings.tolerance * sigma <= 0.1 * planner.worst_case.sigma
    )


@pytest.mark.slow
def test_what_no_fit_can_keep_is_not_promised(planner, example):
    """A locus with regularizing priors ends within 0.03 of an error, whatever is asked for."""
    loose = replace(example.result, parameters=example.truth.with_locus(PartialShm.of(0.4, 20.0, 0.7, 30.0)))
    regularized = Planner([replace(example, result=loose)])
    allowed = 0.1 * planner.worst_case.sigma
    with refused(ErrorCode.OUT_OF_RANGE, f"{1e6 * allowed:.2g} uas"):
        regularized.cheapest(allowed)


@pytest.mark.slow
def test_an_aberration_is_left_out_where_it_may_cost_next_to_nothing(planner, example):
    names = example.processor.instrument.aberrations
    flat = eqx.tree_at(lambda p: p.aberrations, example.truth, example.truth.aberrations / 20)
    hardly = replace(example, result=replace(example.result, parameters=flat))
    costs = {name: hardly.without((name,)) for name in names}
    least = min(costs, key=costs.get)
    assert Planner([hardly]).cheapest(11 * costs[least]).settings.without == (least,)
    assert Planner([hardly]).cheapest(9 * costs[least]).settings.without == ()
    assert (
        planner.cheapest(11 * example.without((least,))).settings.without == ()
    )  # it is seen in chi-squared


@pytest.fixture(scope="module")
def still(plain):
    """A frame without jitter, fitted by ``auto``."""
    pair = Binary(5.0, 0.0, 0.0, 0.0, plain.flux, 3.0)
    scene = TradeScene.of(plain, pair, Stable.of(), 1, np.random.default_rng(5))
    return Example.of(scene.noisy[0], FrameProcessor(plain, locus="auto"))


def said_of_jitter(worst_case, settings=OWN):
    (found,) = (one for one in explain(worst_case, Plan(settings, 0.0, 0.1)) if one.startswith("jitter"))
    assert re.findall(r"mvn|\d+", found)[:3] == ["mvn", "3", "1"]  # parameters, frames
    return found


@pytest.mark.slow
def test_it_is_said_what_jitter_that_is_not_seen_would_cost(planner, still):
    worst_case = WorstCase([still])
    cost = worst_case.cost_of_jitter()
    assert 0 < cost < 0.3 * still.result.error("separation")
    always, seen = (said_of_jitter(worst_case, settings) for settings in (OWN, Settings(jitter="seen")))
    assert always != seen
    for said in (always, seen):
        assert angle_size(cost, 2) in said
        assert "--locus" not in said
    assert "--locus" in said_of_jitter(planner.worst_case)


@pytest.mark.slow
def test_a_still_frame_gets_no_jitter_where_the_promise_allows_it(still, example, monkeypatch):
    monkeypatch.setattr(plan, "GRID", FEW)
    ours = Planner([still])
    cost = ours.worst_case.cost_of_jitter()
    ample, short = ours.cheapest(1.5 * cost), ours.cheapest(cost)
    assert (ample.settings.jitter, short.settings.jitter) == ("seen", "always")
    cut = ample.settings  # in a region less is seen of the jitter, and it costs more
    without = ours.worst_case.cost_of_jitter(cut)
    assert ample.loss == pytest.approx(ours.worst_case.loss(replace(cut, jitter="always")) + without)
    assert ample.loss <= 0.8 * 1.5 * cost
    fitted = cut.applied(still.processor).process(still.raw).result
    assert fitted.locus == "stable"
    assert "jitter_undetected" in fitted.flags
    assert len(fitted.names) == len(still.result.names) - 3
    known = FitOptions(priors=Priors(moments=(np.zeros(3), np.eye(3))))
    for one, changes in (
        (still, {"locus": "mvn"}),
        (still, {"kernel": "mtf"}),
        (still, {"options": known}),
        (example, {"locus": "auto"}),
    ):
        other = Planner([replace(one, processor=replace(one.processor, **changes))])
        assert other.worst_case.cost_of_jitter() == math.inf
        assert other.cheapest(1.5 * cost).settings.jitter == "always"


@pytest.mark.slow
def test_a_frame_that_shakes_is_fitted_as_ever_by_settings_that_leave_out_what_is_not_seen(example):
    auto = replace(example.processor, locus="auto")
    always, seen = (
        replace(Settings(), jitter=jitter).applied(auto).process(example.raw).result
        for jitter in ("always", "seen")
    )
    assert always.locus == seen.locus != "stable"
    assert always.of_scene("separation") == seen.of_scene("separation")


def test_settings_that_would_be_seen_in_chi_squared_promise_nothing(plain, planner):
    bright = Binary(5.0, 0.0, 0.0, 0.0, 1e9, 3.0)
    scene = TradeScene.of(plain, bright, Mvn.of(0.2, 0.1, 20.0), 1, np.random.default_rng(5))
    detector = FrameProcessor(plain, locus="mvn")
    shown = Example.of(scene.noisy[0], detector)
    seen = shown.forecast(Settings(samples=3))
    assert seen.misfit > 1
    assert WorstCase([shown]).loss(Settings(samples=3)) == math.inf
    assert planner.worst_case.loss(Settings(samples=3)) < math.inf


@pytest.mark.slow
def test_within_a_budget_the_least_loss_is_had(planner, monkeypatch):
    monkeypatch.setattr(planner, "seconds", lambda settings: planner.work(settings))
    ample, short = planner.within(1.5), planner.within(0.4)
    assert ample.loss < short.loss
    assert short.seconds <= 0.4
    affordable = [s for s in planner.by_work() if planner.work(s) <= 0.4]
    assert short.loss <= 1.01 * min(map(planner.worst_case.loss, affordable))
    with refused(ErrorCode.OUT_OF_RANGE, "1 ms", "--preset"):
        planner.within(1e-3)


def test_padding_that_the_pupil_does_not_carry_is_no_choice(example, monkeypatch):
    monkeypatch.setattr(plan, "GRID", {**FEW, "pad": (8, 300), "region": (), "samples": (5,)})
    ample = Planner([example])
    monkeypatch.setattr(ample, "seconds", lambda settings: 0.1)
    assert ample.within(100.0).settings.pad == 8


def test_what_is_said_of_a_preset_is_what_it_does(example, planner, monkeypatch):
    fast = replace(example.processor, options=FitOptions(tolerance=0.01))
    of_fast = Planner([replace(example, processor=fast)])
    monkeypatch.setattr(of_fast, "seconds", lambda settings: settings.tolerance)
    assert of_fast.as_they_are().seconds == 0.01


@pytest.mark.slow
def test_time_is_counted_as_it_passes(plain, example):
    """The order is what matters: of settings four times as dear the fit takes longer."""
    parameters = len(example.result.names)
    small, large = Settings(pad=8), Settings(pad=112)
    counted = [work(one, plain, parameters, 1000) for one in (small, large)]
    assert counted[1] > 4 * counted[0]
    took = [Fitting(one.applied(example.processor)).timed([example.raw] * 3)[1] for one in (small, large)]
    assert took[1] > took[0]


def test_few_frames_each_compute_the_optics(plain):
    fine, coarse = (Settings(samples=count) for count in (16, 1))
    dearer = [work(fine, plain, 10, n) / work(coarse, plain, 10, n) for n in (1, 1000)]
    assert dearer[0] > 1.5
    assert dearer[1] < 1.1


@pytest.mark.slow
def test_what_is_left_out_is_said_with_what_it_would_cost(planner, example):
    # a background would take up the light that comes back for want of padding
    held = replace(example.processor, options=FitOptions(("background",)))
    planner = Planner([replace(example, processor=held)])
    found = planner.cheapest(5e-6)
    said = {line.split()[0]: line for line in explain(planner.worst_case, found)}
    assert "48 x 48" in said["pixels:"]
    pad, own, *rest = re.findall(r"\d+", said["padding:"])
    assert (int(pad), own) == (found.settings.pad, "64")
    assert rest  # what less would cost
    assert "noll7, noll8" in said["aberrations"]
    assert all(value in said["jitter:"] for value in ("mvn (3 parameters) in 1 ", "--locus"))
    cheaper = FEW["samples"][FEW["samples"].index(found.settings.samples) - 1]
    lost = planner.worst_case.loss(
        Settings(pad=found.settings.pad, samples=cheaper, region=found.settings.region)
    )
    assert re.search(rf"\b{cheaper}\b.* {re.escape(f'{1e6 * lost:.2g}')}", said["wavelengths:"])


def test_an_aberration_that_no_frame_tells_is_named_with_what_holds_it(plain, example, planner):
    def said(example):
        return [line for line in explain(WorstCase([example]), found) if line.startswith(example.raw.name)]

    found = planner.cheapest(1e-4)
    assert said(example) == []
    faint = replace(example, result=replace(example.result, covariance=1e6 * example.result.covariance))
    (free,) = said(faint)
    assert all(value in free for value in ("noll7, noll8", "100 nm", "aberration_sigma"))
    well_known = replace(example.processor, instrument=replace(plain, aberration_sigma=0.05))
    (held,) = said(Example.of(example.raw, well_known))
    assert all(value in held for value in ("noll7, noll8", "0.045 nm", "0.05 nm"))


def test_examples_are_taken_where_frames_can_be_fitted(tmp_path, plain, one):
    blank = np.full(plain.shape, 100, np.uint16)
    for number in range(9):
        fits.writeto(tmp_path / f"{number}.fits", one.noisy[0].data if number == 4 else blank)
    cube = tmp_path / "cube.fits"
    fits.writeto(cube, np.stack([one.noisy[0].data] * 30))
    seen, frames = examples_of([cube], FrameProcessor(plain, locus="mvn"))
    assert sorted(example.raw.index for example in seen) == [0, 11, 21]
    assert frames == 30
    cube.unlink()
    files = sorted(tmp_path.iterdir())
    found, frames = examples_of(files, FrameProcessor(plain, locus="mvn"))
    assert [example.raw.path.name for example in found] == ["4.fits"]
    assert frames == 9
    with refused(ErrorCode.TOO_FEW, 8):
        examples_of([file for file in files if file.name != "4.fits"], FrameProcessor(plain, locus="mvn"))
