"""Flat, dark current, bias and read noise from pixel to pixel, and who is masked why."""

import numpy as np
import pytest
from refusals import refused

from jitterkit.detectors import Detector
from jitterkit.errors import ErrorCode, FrameError
from jitterkit.frames import RawFrame

N = 300


def halves(low, high):
    """A map of two values, left and right."""
    values = np.full((N, N), float(low))
    values[:, N // 2 :] = high
    return values


def exposed(detector, level, seed=0, exposure=2.0):
    adu = detector.expose(np.full((N, N), float(level)), np.random.default_rng(seed), exposure=exposure)
    return detector.calibrate(RawFrame.from_array(adu, exposure=exposure))


def test_dividing_by_the_flat_divides_the_photon_noise_by_its_root():
    # var(counts / f) = f mu / f², and read noise and rounding by f²
    detector = Detector(gain=2.0, read_noise=10.0, bias=100.0, flat=halves(0.5, 1.5))
    frame, level = exposed(detector, 1000.0), 1000.0
    for side, f in ((slice(0, N // 2), 0.5), (slice(N // 2, N), 1.5)):
        counts, number = frame.electrons[:, side], N * N / 2
        variance = level / f + (100.0 + 4 / 12) / f**2
        assert counts.mean() == pytest.approx(level, abs=4 * np.sqrt(variance / number))
        assert counts.var() == pytest.approx(variance, rel=4 * np.sqrt(2 / number))
        assert frame.variance[:, side].mean() == pytest.approx(variance, rel=1e-3)
    assert np.array_equal(frame.response, halves(0.5, 1.5))
    assert frame.read_variance == pytest.approx(100 + 4 / 12)


def test_dark_current_is_subtracted_and_leaves_its_shot_noise():
    detector = Detector(gain=1.5, read_noise=3.0, bias=50.0, dark_current=halves(20.0, 200.0))
    frame, number = exposed(detector, 0.0, exposure=2.0), N * N / 2
    for side, dark in ((slice(0, N // 2), 40.0), (slice(N // 2, N), 400.0)):
        variance = dark + 9 + 1.5**2 / 12
        assert frame.read_variance[:, side] == pytest.approx(variance)
        assert frame.electrons[:, side].mean() == pytest.approx(0.0, abs=4 * np.sqrt(variance / number))
        assert frame.electrons[:, side].var() == pytest.approx(variance, rel=4 * np.sqrt(2 / number))


def test_bias_and_read_noise_may_differ_from_pixel_to_pixel():
    detector = Detector(gain=1.0, read_noise=halves(2.0, 20.0), bias=halves(80.0, 120.0))
    frame, number = exposed(detector, 0.0), N * N / 2
    for side, noise in ((slice(0, N // 2), 2.0), (slice(N // 2, N), 20.0)):
        variance = noise**2 + 1 / 12
        assert frame.read_variance[:, side] == pytest.approx(variance)
        assert frame.electrons[:, side].mean() == pytest.approx(0.0, abs=4 * np.sqrt(variance / number))
        assert frame.electrons[:, side].var() == pytest.approx(variance, rel=4 * np.sqrt(2 / number))
    assert frame.metadata.value("bias") == 100.0  # the median


def test_every_step_of_the_read_out_comes_in_its_place():
    # by hand, each step with a number that another order would not give
    flat = np.array([[0.5, 1.0, 1.5]] * 3)
    detector = Detector(
        gain=2.0, bias=10.0, full_well=1000.0, bits=9,
        flat=flat, dark_current=5.0, coupling=0.05, nonlinearity=[-1e-4],
    )  # fmt: skip
    image = np.array([[0.0, 0.0, 0.0], [100.0, 5000.0, 0.0], [0.0, 0.0, 0.0]])
    wells = np.array([[10.0, 10, 10], [60, 1000, 10], [10, 10, 10]])  # flat, then 2 s of dark, then the well
    coupled = np.array(
        [
            [10 + 0.05 * 50, 10 + 0.05 * 990, 10],
            [
                60 + 0.05 * (10 + 1000 + 10 - 3 * 60),
                1000 + 0.05 * (10 + 60 + 10 + 10 - 4000),
                10 + 0.05 * 990,
            ],
            [10 + 0.05 * 50, 10 + 0.05 * 990, 10],
        ]
    )
    assert coupled.sum() == pytest.approx(wells.sum())
    level = 10 + coupled * (1 - 1e-4 * coupled) / 2
    assert np.array_equal(detector.expose(image, exposure=2.0), np.rint(level).astype(int))
    assert level[1, 1] == pytest.approx(10 + 804.5 * (1 - 0.08045) / 2)
    short = Detector(gain=1.0, bias=10.0, full_well=1000.0, bits=9)
    assert short.expose(np.array([[5000.0]]))[0, 0] == 511


def test_a_well_that_is_full_of_dark_holds_no_light_and_the_converter_ends_after_it():
    # exchanged, the converter would end at 255 ADU and the well would not be seen
    detector = Detector(gain=4.0, bias=20.0, full_well=800.0, bits=8, dark_current=300.0)
    adu = detector.expose(np.full((4, 4), 1000.0), exposure=2.0)
    assert np.all(adu == 20 + 200)
    frame = detector.calibrate(RawFrame.from_array(adu, exposure=2.0))
    assert frame.full.all()
    # the ceiling is what the dark current leaves of the well, less five sigma of the reading
    assert frame.ceiling == pytest.approx(800 - 5 * np.sqrt(16 / 12) - 600)


def test_dead_pixels_are_masked_and_divided_by_nothing():
    flat = np.ones((5, 6))
    flat[1, 2] = 0.0
    detector = Detector(gain=1.0, read_noise=1.0, bias=0.0, flat=flat)
    assert detector.expose(np.full((5, 6), 50.0))[1, 2] == 0
    frame = detector.calibrate(RawFrame.from_array(np.full((5, 6), 50.0)))
    assert np.argwhere(frame.mask).tolist() == [[1, 2]]
    assert not frame.full.any()
    assert np.isfinite(frame.variance).all()


def test_a_hot_pixel_is_noisier_and_one_that_is_full_in_the_dark_is_bad():
    dark = np.zeros((5, 6))
    dark[1, 2], dark[3, 4] = 500.0, 1e5
    detector = Detector(gain=1.0, read_noise=1.0, bias=0.0, dark_current=dark, full_well=10_000.0)
    adu = detector.expose(np.full((5, 6), 50.0), exposure=2.0)
    frame = detector.calibrate(RawFrame.from_array(adu, exposure=2.0))
    assert frame.electrons[1, 2] == 50.0
    assert frame.read_variance[1, 2] == pytest.approx(1000 + 1 + 1 / 12)
    assert np.argwhere(frame.mask).tolist() == [[3, 4]]
    assert not frame.full.any()  # it says nothing about the light, not even that there is much


def test_the_ceiling_is_in_the_unit_of_the_electrons():
    flat = np.array([[0.5, 1.5, 1.0]])
    detector = Detector(gain=2.0, read_noise=0.0, bias=10.0, saturation=510.0, flat=flat, dark_current=100.0)
    frame = detector.calibrate(RawFrame.from_array(np.array([[510.0, 509.0, 600.0]]), exposure=1.0))
    assert frame.ceiling == pytest.approx((1000 - 100) / flat)
    assert frame.electrons[0, 0] == pytest.approx(frame.ceiling[0, 0])
    assert frame.full.tolist() == [[True, False, True]]
    assert Detector(gain=2.0).calibrate(RawFrame.from_array(flat)).ceiling == np.inf


def test_a_full_pixel_that_is_also_bad_is_not_known_to_be_full():
    bad = np.array([[True, False, False]])
    raw = RawFrame.from_array(np.array([[255.0, 255.0, 255.0]]), mask=np.array([[False, True, False]]))
    frame = Detector(bits=8, bad_pixels=bad).calibrate(raw)
    assert frame.full.tolist() == [[False, False, True]]
    assert frame.mask.all()
    assert frame.saturated == 2


def test_without_maps_nothing_is_spread_over_the_image():
    frame = Detector(gain=3.0, full_well=1e4, dark_current=1.0).calibrate(
        RawFrame.from_array(np.zeros((4, 4)), exposure=1.0)
    )
    assert isinstance(frame.response, float)
    assert isinstance(frame.ceiling, float)


def test_maps_lie_under_a_region_cut_from_the_frame():
    rng = np.random.default_rng(7)
    flat, bias = 1 + 0.1 * rng.uniform(-1, 1, (20, 30)), rng.uniform(90, 110, (20, 30))
    detector = Detector(gain=0.01, bias=bias, flat=flat / flat.mean())
    image = rng.uniform(100, 200, (20, 30))
    raw = RawFrame.from_array(detector.expose(image)).region(11, 5, nx=7, ny=6)
    # 0.01 e-/ADU: rounding leaves half of that, over the flat
    assert detector.calibrate(raw).electrons == pytest.approx(image[5:11, 11:18], abs=0.006)
    cut = detector.expose(image[5:11, 11:18], origin=(11, 5))
    assert np.array_equal(cut, raw.data)


def test_a_frame_that_says_another_bias_than_the_map_is_believed():
    detector = Detector(gain=1.0, read_noise=1.0, bias=halves(80.0, 120.0))
    data = np.full((N, N), 130.0)
    for said, left in ((100.0, 50.0), (90.0, 40.0)):  # 100 is the map's median
        frame = detector.calibrate(RawFrame.from_array(data, source="command line", bias=said))
        assert frame.electrons[0, 0] == left


def test_an_unknown_exposure_leaves_the_dark_current_and_says_so():
    detector = Detector(gain=1.0, read_noise=1.0, bias=0.0, dark_current=halves(1.0, 2.0))
    frame = detector.calibrate(RawFrame.from_array(np.full((N, N), 7.0)))
    assert frame.electrons[0, 0] == 7.0
    assert frame.flags == ("dark_not_subtracted",)
    with refused(ErrorCode.MISSING_VALUE, "dark_current", "exposure"):
        detector.expose(np.zeros((N, N)))


def test_electrons_of_others_are_taken_as_finished():
    flat = np.ones((4, 4))
    flat[0, 0], flat[0, 1] = 0.0, 1.05
    detector = Detector(
        gain=2.0, read_noise=3.0, bias=10.0, full_well=1e4, bits=16,
        dark_current=5.0, flat=flat, coupling=0.02, nonlinearity=[-1e-6],
    )  # fmt: skip
    frame = detector.calibrate(RawFrame.from_array(np.full((4, 4), 500.0), unit="electron", exposure=1.0))
    assert frame.electrons == pytest.approx(500.0)
    assert frame.read_variance == pytest.approx(9.0)
    assert frame.response == 1.0
    assert np.argwhere(frame.mask).tolist() == [[0, 0]]


def test_a_pixel_without_a_number_in_a_map_is_bad():
    bias, flat = np.full((3, 4), 10.0), np.ones((3, 4))
    bias[0, 1], flat[2, 3] = np.nan, np.nan
    frame = Detector(gain=1.0, bias=bias, flat=flat).calibrate(RawFrame.from_array(np.full((3, 4), 60.0)))
    assert np.argwhere(frame.mask).tolist() == [[0, 1], [2, 3]]
    assert np.isfinite(frame.variance).all()


def test_a_map_that_does_not_cover_the_frame_is_refused_by_its_name():
    detector = Detector(flat=np.ones((4, 4)))
    values = ("column 4, row 3", "map flat", "4 x 4")
    with refused(ErrorCode.WRONG_INSTRUMENT, *values, error=FrameError):
        detector.calibrate(RawFrame.from_array(np.zeros((4, 5))))
    with refused(ErrorCode.WRONG_INSTRUMENT, *values, error=FrameError):
        detector.expose(np.zeros((4, 4)), origin=(1, 0))


@pytest.mark.parametrize(
    ("numbers", "code", "values"),
    [
        ({"flat": 1.0}, ErrorCode.WRONG_SHAPE, ("flat", "()")),
        ({"flat": np.full((3, 4), 0.5)}, ErrorCode.OUT_OF_RANGE, ("flat", "mean of 0.5 ")),
        ({"flat": -np.ones((3, 4))}, ErrorCode.OUT_OF_RANGE, ("flat", -1.0, "0 to 1e+09")),
        ({"flat": np.zeros((3, 4))}, ErrorCode.OUT_OF_RANGE, ("flat", "mean of 0 ")),
        ({"bias": np.zeros(3)}, ErrorCode.WRONG_SHAPE, ("bias", (3,))),
        ({"bias": np.full((3, 4), np.nan)}, ErrorCode.OUT_OF_RANGE, ("bias", "4 x 3")),
        (
            {"bias": np.full((3, 4), 5000.0), "bits": 12},
            ErrorCode.CONFLICT,
            ("bias = 5000", "12-bit", "0 to 4095"),
        ),
        ({"dark_current": np.full((3, 4), -1.0)}, ErrorCode.OUT_OF_RANGE, ("dark_current", -1.0, "e-/s")),
        ({"dark_current": -1.0}, ErrorCode.OUT_OF_RANGE, ("dark_current = -1.0", "0 to 1e+09 e-/s")),
        ({"diffusion": 11.0}, ErrorCode.OUT_OF_RANGE, ("diffusion = 11.0", "0 to 10 pixel")),
        ({"line_time": np.inf}, ErrorCode.OUT_OF_RANGE, ("line_time = inf",)),
        ({"cosmic_rays": 2.0}, ErrorCode.OUT_OF_RANGE, ("cosmic_rays = 2.0", "0 to 1 ")),
        (
            {"flat": np.ones((3, 4)), "bad_pixels": np.zeros((4, 3), bool)},
            ErrorCode.WRONG_SHAPE,
            ("flat", "4 x 3", "bad_pixels", "3 x 4"),
        ),
    ],
)
def test_maps_and_numbers_that_cannot_be_are_refused(numbers, code, values):
    with refused(code, *values):
        Detector(**numbers)
