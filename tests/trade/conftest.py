"""A plain telescope with coma, small enough to be fitted many times, and frames of it."""

from dataclasses import replace

import numpy as np
import pytest

from jitterkit.batch import FrameProcessor
from jitterkit.detectors import Detector
from jitterkit.instruments import Instrument
from jitterkit.loci import Mvn
from jitterkit.optics import flat_band, obstructed_circle
from jitterkit.scene import Binary
from jitterkit.trade import TradeScene
from jitterkit.trade.predict import Example


@pytest.fixture(scope="session")
def plain():
    """A telescope of its own: settings change its sampling and wavelengths, so there must be many of both.

    Its sources have one spectrum; ``test_predict`` has one test of free colours.
    """
    return Instrument(
        name="plain",
        plate_scale=0.375,
        shape=(48, 48),
        detector=Detector(gain=2.0, read_noise=3.0, bits=16),
        spectrum=flat_band(530.0, 640.0, 7),
        pupil_from=obstructed_circle(0.125, 0.04, noll=(7, 8), samples=256),
        exposure=1.0,
        flux=1e5,
        colours=None,
    )


def drawn(plain, frames):
    pair = Binary(5.0, 0.0, 0.0, 0.0, plain.flux, 3.0)
    return TradeScene.of(plain, pair, Mvn.of(0.2, 0.1, 20.0), frames, np.random.default_rng(5))


@pytest.fixture(scope="session")
def scene(plain):
    return drawn(plain, 3)


@pytest.fixture(scope="session")
def one(plain):
    """A scene of one frame."""
    return drawn(plain, 1)


@pytest.fixture(scope="session")
def example(plain, one):
    """The frame as its noise has it."""
    return Example.of(one.noisy[0], FrameProcessor(plain, locus="mvn"))


@pytest.fixture(scope="session")
def shown(example, one):
    """The frame as its truth has it."""
    return replace(example, result=replace(example.result, parameters=one.truths[0]))
