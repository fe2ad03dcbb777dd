"""What is foreseen of settings, against fits."""

from dataclasses import replace

import equinox as eqx
import numpy as np
import pytest

from jitterkit.batch import Processor
from jitterkit.errors import ConfigurationError
from jitterkit.forecast import forecast
from jitterkit.forward import expected_image
from jitterkit.loci import Mvn
from jitterkit.refit import FitOptions
from jitterkit.scene import Binary
from jitterkit.trade import Settings, TradeScene, ladder
from jitterkit.trade.fitting import Fitting
from jitterkit.trade.predict import Example


@pytest.fixture(scope="module")
def one(plain):
    """A scene of one frame."""
    pair = Binary(5.0, 0.0, 0.0, 0.0, plain.flux, 3.0)
    return TradeScene.of(plain, pair, Mvn.of(0.2, 0.1, 20.0), 1, np.random.default_rng(5))


@pytest.fixture(scope="module")
def example(plain, one):
    """The frame as its truth has it, not as its noise."""
    found = Example.of(one.noisy[0], Processor(plain, locus="mvn"))
    return replace(found, result=replace(found.result, parameters=one.truths[0]))


def fitted(settings, example, scene):
    """Bias and stated error of the frame without noise."""
    processor = settings.applied(example.processor)
    frame = ladder.without_noise(processor.calibrate(scene.plain[0]), scene.images[0])
    ((found, sigma),) = Fitting(processor).separations([frame])
    return found - float(scene.truths[0].binary.separation), sigma


@pytest.mark.parametrize(
    "settings",
    [
        Settings(pad=0),
        Settings(samples=2),
        Settings(binning=4, pad=8),
        Settings(region=24, pad=4),
        Settings(aberrations="held"),
        Settings(without=("noll8",)),
    ],
)
def test_what_is_foreseen_is_what_a_fit_without_noise_finds(example, one, settings):
    bias, sigma = fitted(settings, example, one)
    seen = example.foresee(settings)
    assert abs(bias) > 1e-7  # arcsec: there is something to foresee
    assert seen.bias == pytest.approx(bias, rel=0.05, abs=1e-8)
    assert seen.sigma == pytest.approx(sigma, rel=0.01)  # of a fit it is that of where the bias led it


def test_a_misfit_is_what_chi_squared_rises_by(example, one):
    settings = Settings(samples=1)
    processor = settings.applied(example.processor)
    frame = ladder.without_noise(processor.calibrate(one.plain[0]), one.images[0])
    chi2 = processor.fit(frame).result.chi2
    assert example.foresee(settings).misfit == pytest.approx(chi2 / np.sqrt(2 * 48 * 48), rel=0.05)


def test_what_an_aberration_may_cost_is_its_value_and_two_errors(example, plain, one):
    truth = eqx.tree_at(lambda p: p.aberrations, one.truths[0], one.truths[0].aberrations / 20)
    example = replace(example, result=replace(example.result, parameters=truth))
    otf, detector = plain.system().otf(truth.aberrations), plain.detector
    images = (np.asarray(expected_image(truth, otf)),)
    scene = replace(one, truths=(truth,), images=images)
    shift = fitted(Settings(without=("noll8",)), example, scene)[0] - fitted(Settings(), example, scene)[0]
    errors = [
        forecast(truth, otf, detector, FitOptions(hold=("background", *held)), exposure=1.0)
        for held in ((), ("noll8",))
    ]
    free, narrow = (each.error("separation") for each in errors)
    expected = abs(shift) + 2 * np.sqrt(free**2 - narrow**2)
    assert example.without(("noll8",)) == pytest.approx(expected, rel=0.05)
    assert example.without(()) == 0.0


def test_what_cannot_be_had_is_refused(example):
    with pytest.raises(ConfigurationError, match="cannot be binned by 3"):
        example.foresee(Settings(binning=3))


def test_a_frame_that_cannot_be_fitted_is_no_example(plain, one):
    empty = replace(one.noisy[0], data=np.full(plain.shape, 100.0))
    assert Example.of(empty, Processor(plain, locus="mvn")) is None
