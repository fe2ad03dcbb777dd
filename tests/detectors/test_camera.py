"""A whole camera, there and back; and the one that comes with jitterkit."""

import numpy as np
import pytest
from refusals import refused

from jitterkit.detectors import DETECTORS, Detector, detector_preset
from jitterkit.errors import ErrorCode
from jitterkit.frames import RawFrame

SHAPE = (300, 320)


def camera(seed=1):
    """Everything on that calibration can undo."""
    rng = np.random.default_rng(seed)
    flat = 1 + 0.02 * rng.standard_normal(SHAPE)
    dark = rng.lognormal(1.0, 1.5, SHAPE)  # a few hot pixels of hundreds of e-/s
    flat[100, 50] = 0.0
    return Detector(
        gain=1.7,
        bias=100 + rng.normal(0.0, 3.0, SHAPE),
        read_noise=rng.uniform(2.0, 5.0, SHAPE),
        full_well=20_000.0,
        bits=14,
        dark_current=dark,
        flat=flat / flat[flat > 0].mean(),
        nonlinearity=[-4e-6, -2e-11],
        coupling=0.006,
        brighter_fatter=2e-6,
        bad_pixels=rng.random(SHAPE) < 1e-3,
    )


def test_what_a_whole_camera_reads_is_calibrated_without_bias_and_with_the_right_noise():
    detector, exposure = camera(), 3.0
    y, x = np.indices(SHAPE)
    truth = 4000 * (1 + np.cos(x / 9.0) * np.cos(y / 7.0)) + 20
    adu = detector.expose(truth, np.random.default_rng(2), exposure=exposure)
    frame = detector.calibrate(RawFrame.from_array(adu, exposure=exposure))
    variance = truth / frame.response + frame.read_variance / frame.response**2
    pull = ((frame.electrons - truth) / np.sqrt(variance))[~frame.mask]
    n = pull.size
    assert n > 0.99 * truth.size
    # means of n pulls; the kurtosis of Poisson counts is at most 1/20 here, that of rounding is less
    assert pull.mean() == pytest.approx(0.0, abs=4 / np.sqrt(n))
    assert pull.var() == pytest.approx(1.0, abs=4 * np.sqrt(2.05 / n))
    # and bright, faint and hot pixels for themselves
    for part in (truth > 6000, truth < 500, detector.dark_current > 100):
        some = ((frame.electrons - truth) / np.sqrt(variance))[part & ~frame.mask]
        assert some.mean() == pytest.approx(0.0, abs=4 / np.sqrt(some.size))
        assert some.var() == pytest.approx(1.0, abs=4 * np.sqrt(2.05 / some.size))


@pytest.mark.parametrize(
    "left_out", ["bias", "dark_current", "flat", "nonlinearity", "coupling", "brighter_fatter"]
)
def test_every_part_of_the_calibration_is_needed(left_out):
    from dataclasses import replace

    detector, exposure = camera(), 3.0
    y, x = np.indices(SHAPE)
    truth = 4000 * (1 + np.cos(x / 9.0) * np.cos(y / 7.0)) + 20
    truth[:, ::2] *= 0.8  # detail for the coupling to wash out
    raw = RawFrame.from_array(detector.expose(truth, exposure=exposure), exposure=exposure)
    used = ~detector.calibrate(raw).mask
    errors = []
    for trial in (detector, replace(detector, **{left_out: None})):
        errors.append(np.abs(trial.calibrate(raw).electrons - truth)[used].max())
    # rounding to half an ADU of 1.7 e-, over flat, slope and decoupling
    assert errors[0] < 0.5 * 1.7 * 1.35
    assert errors[1] > 10 * errors[0]


def test_the_camera_that_comes_along_has_a_source_for_every_number():
    detector = detector_preset("imx183")
    for name, value in vars(detector).items():
        if value is not None and name not in ("sources", "map_orders", "map_windows"):
            assert detector.source(name).startswith("preset imx183 ("), name


def test_the_camera_s_well_and_noise_are_those_of_the_published_decibels():
    # EMVA 1288: SNRmax² is the full well; DNR is the full well over sqrt(sigma² + 1/4) + 1/2
    detector = detector_preset("imx183")
    assert 10 * np.log10(detector.full_well) == pytest.approx(41.6, abs=0.05)
    smallest = np.sqrt(detector.read_noise**2 + detector.gain**2 / 12 + 0.25) + 0.5
    assert 20 * np.log10(detector.full_well / smallest) == pytest.approx(71.5, abs=0.2)


@pytest.mark.parametrize("name", DETECTORS)
def test_the_well_of_a_preset_fills_before_its_converter_ends(name):
    detector = detector_preset(name)
    reading = detector.expose(np.full((200, 200), 1e6), np.random.default_rng(0), exposure=0.1)
    assert reading.max() < detector.largest
    assert detector.calibrate(RawFrame.from_array(reading, exposure=0.1)).full.all()


def test_a_detector_that_is_not_there_is_distinguished_from_those_that_are():
    with refused(ErrorCode.UNKNOWN_NAME, "'imx138'", "'imx183'", ", ".join(DETECTORS)):
        detector_preset("imx138")
