"""The laws of a detector, seen from both of its ends."""

import subprocess
import sys

import numpy as np
import pytest
from refusals import refused

from jitterkit.detectors import Detector
from jitterkit.errors import ErrorCode, FrameError
from jitterkit.frames import RawFrame

CAMERA = Detector(gain=3.7, read_noise=2.4, bias=30.0, full_well=15000.0, bits=12)


def read_back(detector, adu, **metadata):
    return detector.calibrate(RawFrame.from_array(adu, **metadata))


def test_the_photon_transfer_line_gives_gain_and_read_noise():
    # variance [ADU²] = mean/gain + read_noise²/gain² + 1/12 (Janesick, Photon Transfer, 2007)
    n, rng = 100_000, np.random.default_rng(11)
    levels = np.linspace(200.0, 12_000.0, 12)
    flats = [CAMERA.expose(np.full(n, level), rng).astype(float) for level in levels]
    mean = np.array([flat.mean() - CAMERA.bias for flat in flats])
    variance = np.array([flat.var(ddof=1) for flat in flats])
    sigma = variance * np.sqrt(2 / n)  # of a variance of n nearly normal numbers
    (slope, offset), covariance = np.polyfit(mean, variance, 1, w=1 / sigma, cov="unscaled")
    assert slope == pytest.approx(1 / 3.7, abs=4 * covariance[0, 0] ** 0.5)
    assert offset == pytest.approx((2.4 / 3.7) ** 2 + 1 / 12, abs=4 * covariance[1, 1] ** 0.5)


@pytest.mark.parametrize("level", [0.0, 3.0, 200.0, 9000.0])
def test_calibrated_electrons_scatter_about_the_truth_as_the_variance_says(level):
    n = 400
    adu = CAMERA.expose(np.full((n, n), level), np.random.default_rng(5))
    frame = read_back(CAMERA, adu)
    pull = (frame.electrons - level) / np.sqrt(level + frame.read_variance)
    assert not frame.mask.any()
    assert pull.mean() == pytest.approx(0.0, abs=4 / n)
    kurtosis = 2 + 1 / max(level, 1.0)  # a normal law's, and no more than a Poisson law's own
    assert pull.var() == pytest.approx(1.0, abs=4 * np.sqrt(kurtosis) / n)


def test_rounding_alone_has_the_variance_that_calibration_reports():
    coarse, n = Detector(gain=5.0, read_noise=0.0, bias=100.0), 300
    expected = np.random.default_rng(2).uniform(0, 1000, (n, n))
    frame = read_back(coarse, coarse.expose(expected))
    error = frame.electrons - expected
    assert frame.read_variance == pytest.approx(25 / 12)
    # var(error²) of a uniform law is (gain²/12)² 4/5
    assert np.mean(error**2) == pytest.approx(25 / 12, abs=4 * 25 / 12 * np.sqrt(0.8) / n)
    assert np.abs(error).max() <= 2.5 + 1e-9


def test_the_well_fills_before_the_amplifier_adds_noise_and_the_converter_ends():
    detector, n = Detector(gain=2.0, read_noise=6.0, bias=50.0, full_well=1000.0, bits=16), 40_000
    adu = detector.expose(np.full(n, 5000.0), np.random.default_rng(3)).astype(float)
    variance = (6.0 / 2.0) ** 2 + 1 / 12
    assert adu.mean() == pytest.approx(50 + 1000 / 2, abs=4 * np.sqrt(variance / n))
    assert adu.var() == pytest.approx(variance, rel=4 * np.sqrt(2 / n))


def test_the_converter_reads_nothing_beyond_its_bits():
    detector = Detector(gain=1.0, read_noise=20.0, bias=5.0, bits=8)
    adu = detector.expose(np.linspace(0, 600, 5000), np.random.default_rng(3))
    assert (adu.min(), adu.max()) == (0, 255)
    assert adu.dtype == np.uint16
    assert Detector(bits=20).expose(np.array([[2.0**19]]))[0, 0] == 2**19


def test_one_seed_gives_one_frame_and_another_seed_another():
    expected = np.full((20, 20), 500.0)
    first, again, other = (CAMERA.expose(expected, np.random.default_rng(s)) for s in (1, 1, 2))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


def test_ringing_below_zero_is_exposed_as_darkness():
    assert CAMERA.expose(np.array([[-3.0]]), np.random.default_rng(0)).shape == (1, 1)
    assert CAMERA.expose(np.array([[-3.0]]))[0, 0] == 30


def test_more_light_than_noise_can_be_drawn_of_is_refused():
    with refused(ErrorCode.OUT_OF_RANGE, "1e+19 electrons"):
        CAMERA.expose(np.array([[1e19]]), np.random.default_rng(0))


@pytest.mark.parametrize(
    ("detector", "level"),
    [
        (Detector(gain=2.0, bits=10, bias=10.0), 1023),
        (Detector(gain=2.0, saturation=700.0), 700),
        (Detector(gain=2.0, bits=10, saturation=700.0), 700),
        # 1000 e-: the read-out of a full well is below it by chance, 5 sigma at most
        (
            Detector(gain=2.0, read_noise=4.0, bias=100.0, full_well=1000.0),
            100 + 500 - 2.5 * np.sqrt(16 + 1 / 3),
        ),
    ],
)
def test_pixels_at_the_end_of_the_range_are_masked_and_counted(detector, level):
    adu = np.array([[0.0, level - 0.5, level, level + 0.5]])
    frame = read_back(detector, adu)
    assert frame.mask.tolist() == [[False, False, True, True]]
    assert frame.saturated == 2
    assert "saturated" in frame.flags


def test_full_wells_do_not_escape_the_mask():
    adu = CAMERA.expose(np.full((300, 300), 20_000.0), np.random.default_rng(8))
    assert read_back(CAMERA, adu).mask.all()  # 90,000 chances of 3e-7 each


def test_a_pixel_that_was_masked_before_does_not_count_as_saturated():
    frame = read_back(Detector(bits=8), np.ma.masked_array([[255.0, 255.0]], [[True, False]]))
    assert frame.saturated == 1
    assert frame.mask.all()


def test_a_value_beyond_the_bits_is_said_to_come_from_another_detector():
    assert "above_adc_range" in read_back(CAMERA, np.array([[60_000.0]])).flags
    assert "above_adc_range" not in read_back(CAMERA, np.array([[4095.0]])).flags


def test_electrons_are_neither_scaled_nor_rounded():
    frame = read_back(CAMERA, np.array([[1.5, 14_000.0, 15_001.0]]), unit="electron")
    assert frame.electrons.tolist() == [[1.5, 14_000.0, 15_001.0]]
    assert frame.read_variance == pytest.approx(2.4**2)
    assert frame.mask.tolist() == [[False, False, True]]


def test_a_header_gives_saturation_in_the_unit_of_its_own_pixels():
    detector = Detector(gain=4.0, bias=0.0)
    data = np.array([[900.0, 3000.0]])
    said = {"unit": "electron", "saturation": 1000.0}
    header = RawFrame.from_array(data, source="header (HDU 0)", **said)
    command = RawFrame.from_array(data, source="command line", **said)
    assert detector.calibrate(header).mask.tolist() == [[False, True]]
    assert not detector.calibrate(command).mask.any()  # 1000 ADU are 4000 e-


def test_a_frame_keeps_its_own_numbers_unless_the_detector_is_the_authority():
    raw = RawFrame.from_array(np.array([[130.0]]), source="header (HDU 0)", gain=2.0, read_noise=5.0)
    names = ("gain", "read_noise", "bias")
    preset = Detector(gain=3.0, read_noise=1.0, bias=30.0, sources=dict.fromkeys(names, "preset camera"))
    file = Detector(
        gain=3.0, read_noise=1.0, bias=30.0, sources=dict.fromkeys(names, "instrument file c.toml")
    )
    below, above = preset.calibrate(raw), file.calibrate(raw)
    assert (below.electrons[0, 0], below.read_variance[0, 0]) == pytest.approx((200.0, 25 + 4 / 12))
    assert (above.electrons[0, 0], above.read_variance[0, 0]) == pytest.approx((300.0, 1 + 9 / 12))
    assert below.metadata.gain.source == "header (HDU 0)"
    assert above.metadata.gain.source == "instrument file c.toml"


def test_what_nobody_said_is_assumed_and_flagged():
    frame = read_back(Detector(), np.array([[7.0]]))
    assert frame.electrons[0, 0] == 7.0
    assert frame.flags == ("gain_assumed", "read_noise_assumed", "bias_assumed")
    assert frame.metadata.gain.source.startswith("assumed")
    preset = Detector(gain=3.0, sources={"gain": "preset camera"})
    assert "gain_assumed" in read_back(preset, np.array([[7.0]])).flags
    assert read_back(Detector(), np.array([[7.0]]), gain=1.0, read_noise=2.0, bias=0.0).flags == ()


def test_a_frame_and_a_detector_made_by_hand_agree_that_the_frame_knows_itself_best():
    assert read_back(CAMERA, np.array([[130.0]]), gain=2.0, bias=10.0).electrons[0, 0] == 240.0


def test_electrons_need_no_gain_to_be_known():
    assert read_back(Detector(), np.array([[7.0]]), unit="electron").flags == ("read_noise_assumed",)


def test_informing_twice_changes_nothing():
    once = CAMERA.inform(RawFrame.from_array(np.zeros((2, 2))).metadata)
    assert CAMERA.inform(once) == once


def test_bad_pixels_are_found_under_a_region_cut_from_the_frame():
    bad = np.zeros((10, 12), bool)
    bad[4, 7] = True
    raw = RawFrame.from_array(np.zeros((10, 12))).region(6, 3, nx=4, ny=5)
    mask = Detector(bad_pixels=bad).calibrate(raw).mask
    assert np.argwhere(mask).tolist() == [[1, 1]]


def test_a_bad_pixel_map_that_does_not_cover_the_frame_is_refused_for_that_frame():
    detector = Detector(bad_pixels=np.zeros((4, 4), bool))
    with refused(ErrorCode.WRONG_INSTRUMENT, "column 4, row 3", "bad-pixel map", "4 x 4", error=FrameError):
        read_back(detector, np.zeros((4, 5)))


def test_place_name_and_scale_of_a_frame_survive_calibration():
    raw = RawFrame.from_array(np.zeros((6, 6)), exposure=0.5, plate_scale=0.4).region(2, 1, 3, 3)
    frame = CAMERA.calibrate(raw)
    assert (frame.origin, frame.exposure, frame.plate_scale, frame.name) == ((2, 1), 0.5, 0.4, raw.name)


@pytest.mark.parametrize(
    ("numbers", "code", "values"),
    [
        ({"gain": 0.0}, ErrorCode.OUT_OF_RANGE, ("gain = 0.0", "e-/ADU")),
        ({"gain": -1.0}, ErrorCode.OUT_OF_RANGE, ("gain = -1.0", "0 to 100000 e-/ADU")),
        ({"read_noise": float("nan")}, ErrorCode.OUT_OF_RANGE, ("read_noise = nan", "e-")),
        ({"full_well": 0.0}, ErrorCode.OUT_OF_RANGE, ("full_well = 0.0", "e-")),
        ({"bits": 40}, ErrorCode.OUT_OF_RANGE, ("bits = 40", "1 to 32")),
        ({"bits": 12.5}, ErrorCode.OUT_OF_RANGE, ("bits = 12.5", "1 to 32")),
        ({"bias": 5000.0, "bits": 12}, ErrorCode.CONFLICT, ("bias = 5000", "12-bit", "0 to 4095")),
        ({"bad_pixels": np.zeros(3)}, ErrorCode.WRONG_SHAPE, ("bad_pixels", (3,))),
    ],
)
def test_a_detector_that_cannot_be_is_refused(numbers, code, values):
    with refused(code, *values):
        Detector(**numbers)


def test_detectors_load_no_jax():
    code = "import sys, jitterkit.detectors; sys.exit('jax' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_a_detector_without_a_range_counts_beyond_32_bits():
    readings = Detector(gain=1.0, read_noise=0.0, bias=0.0).expose(np.array([[3.0, 2.0**31, 1e12]]))
    assert readings.tolist() == [[3, 2**31, 10**12]]
