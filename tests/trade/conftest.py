"""A plain telescope with coma, small enough to be fitted many times, and frames of it."""

import numpy as np
import pytest

from jitterkit.detectors import Detector
from jitterkit.instruments import Instrument
from jitterkit.loci import Mvn
from jitterkit.optics import flat_band, obstructed_circle
from jitterkit.scene import Binary
from jitterkit.trade import TradeScene


@pytest.fixture(scope="session")
def plain():
    return Instrument(
        name="plain",
        plate_scale=0.375,
        shape=(48, 48),
        detector=Detector(gain=2.0, read_noise=3.0, bits=16),
        spectrum=flat_band(530.0, 640.0, 7),
        pupil_from=obstructed_circle(0.125, 0.04, noll=(7, 8), samples=256),
        exposure=1.0,
        flux=1e5,
    )


@pytest.fixture(scope="session")
def scene(plain):
    pair = Binary(5.0, 0.0, 0.0, 0.0, plain.flux, 3.0)
    return TradeScene.of(plain, pair, Mvn.of(0.2, 0.1, 20.0), 3, np.random.default_rng(5))
