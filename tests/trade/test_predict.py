"""What is foreseen of settings, against fits."""

from dataclasses import replace

import equinox as eqx
import numpy as np
import pytest
from planner_loss import bias_of, fitted
from refusals import refused

from jitterkit.batch import FrameProcessor
from jitterkit.errors import ErrorCode
from jitterkit.forecast import forecast
from jitterkit.forward import expected_image
from jitterkit.loci import Mvn
from jitterkit.optics import Colours
from jitterkit.refit import FitOptions, Priors
from jitterkit.scene import Binary
from jitterkit.trade import Settings, TradeScene
from jitterkit.trade.predict import Example
from jitterkit.trade.worst_case import WorstCase


@pytest.mark.parametrize(
    "settings",
    [
        Settings(pad=0),
        pytest.param(Settings(samples=2), marks=pytest.mark.slow),
        pytest.param(Settings(binning=4, pad=8), marks=pytest.mark.slow),
        pytest.param(Settings(region=24, pad=4), marks=pytest.mark.slow),
        pytest.param(Settings(aberrations="held"), marks=pytest.mark.slow),
        pytest.param(Settings(without=("noll8",)), marks=pytest.mark.slow),
    ],
)
def test_what_is_foreseen_is_what_a_fit_without_noise_finds(shown, one, settings):
    found = fitted(settings, shown, one)
    bias = bias_of(found, one)
    seen = shown.forecast(settings)
    assert abs(bias) > 1e-7  # arcsec: there is something to foresee
    assert seen.bias == pytest.approx(bias, rel=0.05, abs=1e-8)
    sigma = found.error("separation")  # that of where the bias led it
    assert seen.sigma == pytest.approx(sigma, rel=0.01)


@pytest.mark.slow
def test_it_is_foreseen_of_stars_whose_colours_are_free_too(plain):
    coloured, settings = replace(plain, colours=Colours()), Settings(samples=2)
    pair = Binary(5.0, 0.0, 0.0, 0.0, plain.flux, 3.0)
    one = TradeScene.of(coloured, pair, Mvn.of(0.2, 0.1, 20.0), 1, np.random.default_rng(5))
    example = Example.of(one.noisy[0], FrameProcessor(coloured, locus="mvn"))
    shown = replace(example, result=replace(example.result, parameters=one.truths[0]))
    bias = bias_of(fitted(settings, shown, one), one)
    assert abs(bias) > 1e-7
    assert shown.forecast(settings).bias == pytest.approx(bias, rel=0.05, abs=1e-8)


@pytest.mark.parametrize(("region", "side"), [(None, 48), (24, 24)])
def test_a_misfit_is_what_chi_squared_rises_by(shown, one, region, side):
    settings = Settings(samples=1, region=region)
    chi2 = fitted(settings, shown, one).chi2
    assert shown.forecast(settings).misfit == pytest.approx(chi2 / np.sqrt(2 * side**2), rel=0.05)


def test_what_an_aberration_may_cost_is_its_value_and_two_errors(shown, plain, one):
    truth = eqx.tree_at(lambda p: p.aberrations, one.truths[0], one.truths[0].aberrations / 20)
    shown = replace(shown, result=replace(shown.result, parameters=truth))
    otf, detector = plain.system().otf(truth.aberrations), plain.detector
    images = (np.asarray(expected_image(truth, otf)),)
    scene = replace(one, truths=(truth,), images=images)
    every = (Settings(without=("noll8",)), Settings())
    left_out, own = (bias_of(fitted(settings, shown, scene), scene) for settings in every)
    errors = [
        forecast(truth, otf, detector, FitOptions(hold=("background", *held)), exposure=1.0)
        for held in ((), ("noll8",))
    ]
    free, narrow = (each.error("separation") for each in errors)
    expected = abs(left_out - own) + 2 * np.sqrt(free**2 - narrow**2)
    assert shown.without(("noll8",)) == pytest.approx(expected, rel=0.05)
    assert shown.without(()) == 0.0


def test_in_a_region_an_aberration_costs_what_it_does_to_the_region(shown, plain, one):
    """The error it is known to is that of the whole frame: the plan sees no less."""
    cut = Settings(region=24)
    every = (replace(cut, without=("noll8",)), cut)
    left_out, own = (bias_of(fitted(settings, shown, one), one) for settings in every)
    value = float(shown.truth.aberrations[plain.aberrations.index("noll8")])
    otf, held = plain.system().otf(shown.truth.aberrations), FitOptions(hold=("background",))
    error = forecast(shown.truth, otf, plain.detector, held, exposure=1.0).error("noll8")
    expected = abs(left_out - own) * (1 + 2 * error / abs(value))
    assert shown.without(("noll8",), cut) == pytest.approx(expected, rel=0.05)
    assert shown.without(("noll8",), cut) > 1.1 * shown.without(("noll8",))


@pytest.mark.slow
def test_what_jitter_may_cost_is_what_moments_do_that_are_not_seen(shown, plain, one):
    """By the errors with and without them, which differ by no more than they move; and by fits without."""
    calm = one.truths[0].with_locus(Mvn.near(np.zeros(3)))
    noisy = calm.with_locus(Mvn.near(np.array([2e-4, -3e-4, -1e-4])))
    shown = replace(shown, processor=replace(shown.processor, locus="auto"))
    still = replace(shown, result=replace(shown.result, parameters=noisy))
    assert still.still
    assert not shown.still
    otf, detector = plain.system().otf(calm.aberrations), plain.detector
    free, narrow = (
        forecast(calm, otf, detector, FitOptions(hold=("background", *held)), exposure=1.0)
        for held in ((), calm.locus.names)
    )
    most = np.sqrt(11.3449) + 2  # errors: a table's chi-squared of three that one frame in a hundred exceeds
    spread = np.sqrt(free.error("separation") ** 2 - narrow.error("separation") ** 2)
    price = still.without_jitter(Settings())
    assert price == pytest.approx(most * spread, rel=1e-3)
    assert WorstCase([still, shown]).cost_of_jitter() == price  # one of them shows some: it is fitted
    assert WorstCase([shown]).cost_of_jitter() == np.inf

    slots = [free.names.index(name) for name in calm.locus.names]
    information = np.linalg.inv(free.covariance[np.ix_(slots, slots)])
    stable = replace(still, processor=replace(still.processor, locus="stable"))
    biases = []
    for angle in (0.0, 45.0, 90.0, 135.0):
        unit = Mvn.of(1.0, 0.0, angle).moments()
        size = np.sqrt(most / np.sqrt(unit @ information @ unit))
        truth = calm.with_locus(Mvn.of(size, 0.0, angle))
        scene = replace(one, truths=(truth,), images=(np.asarray(expected_image(truth, otf)),))
        own = bias_of(fitted(Settings(), still, scene), scene)
        biases.append(abs(bias_of(fitted(Settings(), stable, scene), scene) - own))
    assert 0.5 * price < max(biases) < 1.05 * price


def test_what_is_known_beforehand_makes_it_cheap_to_leave_out(shown, plain):
    sigma, truth = 0.1, eqx.tree_at(lambda p: p.aberrations, shown.truth, np.zeros(2))
    none = replace(shown, result=replace(shown.result, parameters=truth))
    telescope = replace(plain, aberration_sigma=sigma)
    known = replace(none, processor=replace(none.processor, instrument=telescope))
    errors = [
        forecast(
            truth,
            plain.system().otf(truth.aberrations),
            plain.detector,
            FitOptions(hold=held, priors=Priors.alike(free, sigma)),
            exposure=1.0,
        ).error("separation")
        for held, free in (((), plain.aberrations), (("noll8",), ("noll7",)))
    ]
    assert known.without(("noll8",)) == pytest.approx(2 * np.sqrt(errors[0] ** 2 - errors[1] ** 2), rel=0.01)
    assert known.without(("noll8",)) < 0.5 * none.without(("noll8",))


def test_what_cannot_be_had_is_refused(shown):
    with refused(ErrorCode.OUT_OF_RANGE, 256, 3):
        shown.forecast(Settings(binning=3))


def test_a_frame_that_cannot_be_fitted_is_no_example(plain, one):
    empty = replace(one.noisy[0], data=np.full(plain.shape, 100.0))
    assert Example.of(empty, FrameProcessor(plain, locus="mvn")) is None
