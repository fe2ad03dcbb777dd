"""Ways to a separation: each against the truth, and the joint one against the sequence fit."""

import math
from dataclasses import replace

import numpy as np
import pytest

from jitterkit.batch import Processor
from jitterkit.errors import JitterkitError
from jitterkit.joint import Exposure, Looker, refit_sequence
from jitterkit.trade.fitting import Fitting
from jitterkit.trade.ladder import without_noise
from jitterkit.trade.methods import separations


@pytest.fixture(scope="module")
def anchored(plain, scene):
    return Fitting.anchored(Processor(plain, locus="mvn"), scene.noisy[0]).processor


@pytest.fixture(scope="module")
def exact(anchored, scene):
    """Frames without noise that share their direction."""
    frames = list(zip(scene.plain, scene.images, strict=True))[: len(scene.noisy)]
    return [without_noise(anchored.calibrate(raw), image) for raw, image in frames]


@pytest.fixture(scope="module")
def refitted(anchored, exact):
    return separations("refit", anchored, exact)


def test_without_noise_every_method_finds_the_separation(anchored, exact, refitted, scene):
    """Within what it is allowed: a step, the bias of a blur that is held, the chance of some draws."""
    truth, sigma = float(scene.truths[0].binary.separation), refitted[0, 1]
    assert refitted[:, 0] == pytest.approx(truth, abs=1e-3 * sigma)
    assert separations("joint", anchored, exact)[:, 0] == pytest.approx(truth, abs=1e-2 * sigma)
    assert separations("score", anchored, exact)[:, 0] == pytest.approx(truth, abs=0.1 * sigma)
    assert separations("mtf", anchored, exact)[:, 0] == pytest.approx(truth, abs=0.1 * sigma)


def test_draws_have_the_mean_and_the_error_of_the_fit(anchored, exact, refitted):
    (mean, error), (value, sigma) = separations("sampling", anchored, exact[:1])[0], refitted[0]
    assert mean == pytest.approx(value, abs=0.3 * sigma)
    assert error == pytest.approx(sigma, rel=0.3)
    assert mean != value


def test_only_what_states_an_error_has_one(anchored, exact, refitted):
    assert np.isnan(separations("score", anchored, exact)[:, 1]).all()
    held = separations("mtf", anchored, exact)[:, 1]
    assert np.all(held < 1.001 * refitted[:, 1])  # of fewer parameters


def test_together_is_the_sequence_fit(anchored, plain, scene):
    frames = [anchored.calibrate(raw) for raw in scene.noisy]
    processor = replace(anchored, known={})
    exposures = [Exposure(str(place), float(place), frame) for place, frame in enumerate(frames)]
    fit = refit_sequence(exposures, Looker(processor.optics(frames[0]), "mvn"))
    found = separations("joint", processor, frames)
    value, error = fit.separation
    assert np.average(found[:, 0]) == pytest.approx(value, abs=0.1 * error)
    assert found[:, 1] == pytest.approx(error * math.sqrt(len(frames)))


@pytest.mark.parametrize("method", ["score", "mtf", "refit", "joint", "sampling"])
def test_what_shows_no_pair_is_refused(anchored, scene, method):
    frame = anchored.calibrate(scene.noisy[0])
    blank = replace(frame, electrons=np.zeros(frame.shape))
    with pytest.raises(JitterkitError, match="no star"):
        separations(method, anchored, [blank])
