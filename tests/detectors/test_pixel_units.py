"""Pixels in rates, in other units, from 0 to 1, and above what a converter can read."""

import numpy as np
import pytest
from refusals import refused

from jitterkit.detectors import NORMALISED, Detector
from jitterkit.errors import ErrorCode, FrameError
from jitterkit.frames import Metadata, RawFrame, Sourced

COUNTS = np.arange(12.0).reshape(3, 4) * 100


def frame(data, unit, **metadata):
    known = Metadata().override("header X", **metadata)
    return RawFrame(
        data, metadata=known.override("header BUNIT", unit=Sourced(unit, "", "header BUNIT (HDU 0)"))
    )


@pytest.mark.parametrize("unit", ["adu", "electron"])
def test_a_rate_is_the_counts_over_the_exposure(unit):
    detector = Detector(gain=2.0, read_noise=3.0)
    rate = detector.calibrate(frame(COUNTS / 0.1, f"{unit}/s", exposure=0.1))
    counts = detector.calibrate(frame(COUNTS, unit, exposure=0.1))
    np.testing.assert_allclose(rate.electrons, counts.electrons)
    np.testing.assert_allclose(rate.variance, counts.variance)


def test_of_a_rate_no_bias_is_subtracted_unless_the_command_line_says_so():
    detector = Detector(gain=1.0, bias=30.0, sources={"bias": "instrument file"})
    raw = frame(COUNTS, "adu/s", exposure=1.0, bias=50.0)
    np.testing.assert_allclose(detector.calibrate(raw).electrons, COUNTS)
    told = RawFrame(COUNTS, metadata=raw.metadata.apply("command line", bias=7.0))
    np.testing.assert_allclose(detector.calibrate(told).electrons, COUNTS - 7)


@pytest.mark.parametrize("source", [None, "preset toliman"])
def test_a_rate_without_an_exposure_of_its_own_is_refused(source):
    raw = frame(COUNTS, "electron/s")
    if source:
        raw = RawFrame(COUNTS, metadata=raw.metadata.override(source, exposure=0.1))
    with refused(ErrorCode.MISSING_VALUE, "electron/s", "header BUNIT", "--exposure", error=FrameError):
        Detector().calibrate(raw)


@pytest.mark.parametrize("unit", ["MJy/sr", "nanomaggy", "Jy/beam"])
def test_another_unit_is_refused_by_its_name(unit):
    with refused(ErrorCode.UNKNOWN_UNIT, unit, "header BUNIT", error=FrameError):
        Detector().calibrate(frame(COUNTS, unit, exposure=1.0))


def test_floats_from_0_to_1_are_recognised():
    for dark in (0.0, 0.1):  # below 0 is the noise of a dark that was subtracted
        assert NORMALISED in Detector(gain=1.0).calibrate(RawFrame(COUNTS / COUNTS.max() - dark)).flags
    for data in (COUNTS, COUNTS / COUNTS.max() - 0.5, np.eye(3), np.zeros((3, 3))):
        assert NORMALISED not in Detector(gain=1.0).calibrate(RawFrame(data)).flags
    assert NORMALISED not in Detector().calibrate(frame(COUNTS / COUNTS.max(), "electron")).flags


def test_a_well_is_proved_wrong_with_the_converter():
    detector = Detector(gain=3.6, bias=0.0, bits=12, full_well=14500.0)
    data = np.full((8, 8), 100.0)
    data[2:6, 2:6] = 50000.0
    assert not detector.calibrate(frame(data, "adu")).mask.any()
    data[2:6, 2:6] = 4095.0
    assert detector.calibrate(frame(data, "adu")).saturated == 16


@pytest.mark.parametrize("unit", ["adu", "electron"])
def test_readings_far_above_a_ceiling_prove_it_wrong(unit):
    detector = Detector(gain=3.6, bias=30.0, bits=12, sources={"gain": "preset imx183"})
    data = np.full((8, 8), 100.0)
    data[2:6, 2:6] = np.linspace(3000, 14000, 16).reshape(4, 4)
    found = detector.calibrate(frame(data, unit, gain=1.0))
    assert not found.mask.any()
    assert "above_adc_range" in found.flags
    assert "saturated" not in found.flags


def test_what_a_flat_lifts_above_a_ceiling_stays_masked():
    detector = Detector(gain=1.0, bias=0.0, bits=12)
    data = np.full((8, 8), 100.0)
    data[2:6, 2:6] = 4095 * 1.2
    assert detector.calibrate(frame(data, "electron")).saturated == 16
