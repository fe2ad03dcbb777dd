"""Photon transfer: gain, read noise, linearity, coupling and full well of frames whose truth is known."""

import re

import numpy as np
import pytest
from refusals import refused
from scipy.ndimage import gaussian_filter

from jitterkit.calibration import Stack, calibrate, photon_transfer
from jitterkit.calibration.level import Level
from jitterkit.detectors import Detector
from jitterkit.errors import ErrorCode
from jitterkit.report.calibration_table import calibration_sentences

TIMES = (0.05, 0.1, 0.2, 0.4, 0.7, 1.0)


def flats(camera, times=TIMES, count=6):
    return [camera.flats(count, seconds) for seconds in times]


def test_gain_and_read_noise_are_found_within_their_errors(camera):
    found = calibrate(camera.biases(16), (), flats(camera)).transfer
    assert found.gain_error < 0.0035 * camera.gain
    assert found.gain == pytest.approx(camera.gain, abs=4 * found.gain_error)
    assert found.read_noise == pytest.approx(camera.noise, abs=4 * found.read_noise_error)


def test_gain_is_unbiased_and_its_errors_have_pulls_of_one(a_camera):
    found = []
    for _ in range(40):
        camera = a_camera(size=64)
        found.append(calibrate(camera.biases(6), (), flats(camera, (0.1, 0.6), 4)).transfer)
    gains, errors = np.array([(each.gain, each.gain_error) for each in found]).T
    # 40 draws: the mean of the pulls is good to 0.16, their standard deviation to 0.11
    pulls = (gains - 3.7) / errors
    assert abs(pulls.mean()) < 4 * 0.16
    assert pulls.std() == pytest.approx(1, abs=4 * 0.11)
    noises = np.array([each.read_noise for each in found])
    assert noises.mean() == pytest.approx(2.4, abs=4 * noises.std() / 40**0.5)


def test_one_level_of_light_is_enough_where_there_are_biases(camera):
    found = calibrate(camera.biases(10), (), [camera.flats(2, 0.5)]).transfer
    # one pair of 128² pixels: the variance is good to 1.1 %
    assert found.gain_error == pytest.approx(camera.gain * (2 / 128**2) ** 0.5, rel=0.05)
    assert found.gain == pytest.approx(camera.gain, abs=4 * found.gain_error)


def test_levels_without_biases_stand_on_a_given_level(camera):
    found = calibrate(None, (), flats(camera), bias_level=100.0)
    assert found.gain == pytest.approx(camera.gain, abs=4 * found.gain_error)
    assert found.bias is None


def test_rays_and_hot_pixels_do_not_hurt(a_camera):
    camera = a_camera(rays=3e-4, hot=80)
    found = calibrate(camera.biases(16), [camera.darks(8, 10.0)], flats(camera)).transfer
    # a ray of 1000 e- in 3 of 10,000 values would add 300 e-² to a variance of 700 to 14,000; those of less
    # than 5 sigma stay, a share of 3e-4 of up to 25 times the variance
    assert found.gain == pytest.approx(camera.gain, rel=0.005)


def test_non_linearity_is_measured_and_the_gain_is_free_of_it(a_camera):
    camera = a_camera(bend=-3e-6)
    stacks = [camera.flats(8, seconds, drift=0.0005) for seconds in TIMES]
    transfer = calibrate(camera.biases(16), (), stacks).transfer
    ((bend, *more), (error, *_)) = transfer.linearity.in_electrons(transfer.gain)
    assert not more
    assert error < 0.1 * 3e-6
    assert bend == pytest.approx(-3e-6, abs=4 * error)
    assert transfer.gain == pytest.approx(camera.gain, abs=4 * transfer.gain_error)
    assert transfer.gain_error < 0.01 * camera.gain


def test_a_linear_detector_has_no_coefficients(camera):
    linearity = calibrate(camera.biases(8), (), flats(camera)).transfer.linearity
    assert linearity.coefficients == ()
    # the lamp changes by 0.4 % from frame to frame, of which there are six
    assert np.abs(linearity.residuals).max() < 5 * 0.004 / 6**0.5


def test_a_lamp_that_is_turned_up_gives_levels_of_one_exposure_and_no_linearity(camera):
    stacks = [camera.flats(4, 0.5, rate) for rate in (2000.0, 8000.0, 20000.0)]
    together = Stack.of("flat", np.concatenate([stack.pixels for stack in stacks]), 0.5)
    more = [camera.flats(4, seconds, 2000.0) for seconds in (0.8, 1.0)]
    found = calibrate(camera.biases(8), (), [together, *more]).transfer
    assert [level.exposure for level in found.levels] == [0, 0.5, 0.8, 1.0, 0.5, 0.5]
    assert [level.frames for level in found.levels] == [8, 4, 4, 4, 4, 4]
    assert found.linearity is None
    assert found.gain == pytest.approx(camera.gain, abs=4 * found.gain_error)


def test_a_lamp_that_is_turned_up_with_the_exposure_bends_the_levels_and_not_the_gain(camera):
    rates = (14000.0, 20000.0, 25000.0, 30000.0)  # for each second; of one lamp they would be alike
    stacks = [camera.flats(6, t, rate, 5e-4) for t, rate in zip((0.1, 0.2, 0.3, 0.4), rates, strict=True)]
    found = calibrate(camera.biases(8), (), stacks).transfer
    assert found.linearity is None
    assert found.gain == pytest.approx(camera.gain, abs=4 * found.gain_error)
    assert found.gain_error < 0.01 * camera.gain


def test_two_coefficients_are_found_in_levels_without_noise():
    t = np.arange(1, 13) / 10
    charge = 3000 * t
    signal = charge * (1 - 8e-6 * charge - 1e-9 * charge**2)
    slope = 1 - 16e-6 * charge - 3e-9 * charge**2
    levels = [
        Level(seconds, 10, s, 1e-5 * s, k**2 * q / 2.0 + 4, 1e-4 * (k**2 * q / 2.0 + 4))
        for seconds, s, q, k in zip(t, signal, charge, slope, strict=True)
    ]
    found = photon_transfer([Level(0.0, 10, 0.0, 0.0, 4.0, 1e-4), *levels])
    # t + b t² + d t³ is the law exactly
    assert found.linearity.coefficients == pytest.approx((-8e-6, -1e-9), rel=1e-4)
    assert found.gain == pytest.approx(2.0, rel=1e-5)
    assert found.read_noise == pytest.approx(4.0, rel=1e-4)
    assert found.freedom == 13 - 2  # levels, and the two numbers of a line


def test_coupling_is_measured_and_the_gain_is_free_of_it(rng):
    share, gain = 0.01, 2.0
    kernel = np.array([[0, share, 0], [share, 1 - 4 * share, share], [0, share, 0]])

    def read(electrons):
        charge = rng.poisson(electrons, (8, 160, 160)).astype(float)
        around = sum(
            kernel[1 + dy, 1 + dx] * np.roll(charge, (dy, dx), (1, 2))
            for dy in (-1, 0, 1)
            for dx in (-1, 0, 1)
        )
        return np.rint(100 + (around + rng.normal(0, 3.0, charge.shape)) / gain).astype(np.uint16)

    stacks = [Stack.of("flat", read(n), n / 1e4) for n in (1e3, 3e3, 8e3)]
    found = calibrate(Stack.of("bias", read(0.0)), (), stacks).transfer
    assert found.coupling == pytest.approx(share, abs=4 * found.coupling_error)
    assert found.coupling_error < 0.1 * share
    # without the correction the gain would be 7.5 % too large
    assert found.gain == pytest.approx(gain, abs=4 * found.gain_error)
    assert found.gain_error < 0.01 * gain


@pytest.mark.parametrize("sigma", [0.5, 0.8])
def test_flats_that_were_smoothed_are_said_or_refused(rng, sigma):
    """A Gaussian of half a pixel makes the gain too large, and correlates more than any detector does."""

    def smooth(electrons):
        return np.rint(gaussian_filter(100 + rng.poisson(electrons, (8, 160, 160)) / 2, (0, sigma, sigma)))

    bias = Stack.of("bias", np.rint(100 + rng.normal(0, 2.5, (8, 160, 160))))
    stacks = [Stack.of("flat", smooth(n), n / 1e4) for n in (1e3, 3e3, 8e3)]
    if sigma > 0.7:
        with refused(ErrorCode.IMPLAUSIBLE, "correlated", "as they were read"):
            calibrate(bias, (), stacks)
        return
    found = calibrate(bias, (), stacks)
    assert found.transfer.gain > 2.1
    assert any("larger than detectors have" in text for text in calibration_sentences(found))


def test_gain_and_coupling_are_exact_without_noise():
    share, gain, noise = 0.05, 1.6, 4.0
    kernel = np.array([[0, share, 0], [share, 1 - 4 * share, share], [0, share, 0]])
    padded = np.pad(kernel, 1)
    own, beside = (float(np.sum(padded * np.roll(padded, k, 1))) for k in (0, 1))
    levels = [
        Level(s, 9, s, 0.1, own * s / gain + noise, 0.01, beside * s / gain, 0.01)
        for s in (0.0, 500.0, 2000.0)
    ]
    found = photon_transfer(levels)
    assert found.coupling == pytest.approx(share, rel=1e-9)
    assert found.gain == pytest.approx(gain, rel=1e-9)


def test_full_wells_are_left_out_and_measured(camera):
    found = calibrate(camera.biases(8), (), flats(camera, (*TIMES, 1.2, 1.5))).transfer
    assert [level.saturated for level in found.levels] == [False] * 7 + [True] * 2
    assert found.full_well == pytest.approx(camera.well, rel=0.005)
    assert found.saturation is None
    assert found.gain == pytest.approx(camera.gain, abs=4 * found.gain_error)


def test_the_end_of_the_converter_is_saturation_and_no_full_well(a_camera):
    camera = a_camera(top=2047)
    found = calibrate(camera.biases(8), (), flats(camera)).transfer
    assert sum(level.saturated for level in found.levels) == 2  # 0.7 and 1.0 s are 2650 and 3780 ADU
    assert found.full_well is None
    assert found.saturation == pytest.approx(2047 - 100, abs=0.1)


def test_prnu_is_what_the_variance_over_pixels_has_more(camera):
    found = calibrate(camera.biases(16), (), flats(camera))
    prnu, error = found.prnu
    # of 16,384 pixels a standard deviation is good to 0.55 %
    assert error == pytest.approx(0.006 / (2 * 128**2) ** 0.5, rel=0.2)
    assert prnu == pytest.approx(np.std(camera.response / camera.response.mean()), rel=0.01)
    bright = found.transfer.levels[-1]
    # in one frame the photons make 0.9 % beside it
    assert bright.prnu == pytest.approx(0.006, rel=0.05)


def test_a_detector_that_exposes_is_measured_as_what_it_is(rng):
    n = 96
    truth = Detector(
        gain=1.5,
        read_noise=4.0,
        bias=200 + rng.normal(0, 0.5, (n, n)),
        dark_current=np.full((n, n), 2.0),
        flat=(flat := 1 + 0.01 * rng.normal(size=(n, n))) / flat.mean(),
        full_well=40000.0,
        nonlinearity=(-1e-6,),
        coupling=0.004,
    )

    def stack(kind, light, seconds, count):
        frames = [truth.expose(np.full((n, n), light), rng, exposure=seconds) for _ in range(count)]
        return Stack.of(kind, frames, seconds)

    found = calibrate(
        stack("bias", 0.0, 0.0, 20),
        [stack("dark", 0.0, 60.0, 20)],
        [stack("flat", 20000 * t, t, 10) for t in (0.1, 0.3, 0.6, 1.0, 1.4)],
    )
    transfer = found.transfer
    assert transfer.gain == pytest.approx(1.5, abs=4 * transfer.gain_error)
    assert transfer.gain_error < 0.015
    assert transfer.coupling == pytest.approx(0.004, abs=4 * transfer.coupling_error)
    bends, errors = transfer.linearity.in_electrons(transfer.gain)
    assert bends == pytest.approx((-1e-6,), abs=4 * errors[0])
    assert found.read_noise.number == pytest.approx(4.0, abs=4 * found.read_noise.number_error)
    assert found.dark_current.number == pytest.approx(2.0, abs=4 * found.dark_current.number_error)
    # coupling smooths the response: of a white map it leaves (1-4a)² + 4a²
    kept = ((1 - 0.016) ** 2 + 4 * 0.004**2) ** 0.5
    assert found.prnu[0] == pytest.approx(0.01 * kept, rel=0.04)


def in_adu(caught):
    """The level that a message names."""
    return float(re.search(r"([\d.]+) ADU", str(caught.value))[1])


def test_what_no_photons_can_do_is_one_sentence(camera):
    biases = camera.biases(4)
    with refused(ErrorCode.TOO_FEW, "--bias") as caught:
        calibrate(None, (), [camera.flats(3, 0.5)], bias_level=100.0)
    assert in_adu(caught) == pytest.approx(14000 * 0.5 / camera.gain, rel=0.02)
    still = Stack.of("flat", np.full((3, 128, 128), 4095, dtype=np.uint16), 1.0)
    with refused(ErrorCode.NO_DATA) as caught:
        calibrate(biases, (), [still])
    assert in_adu(caught) == pytest.approx(4095 - 100, abs=1)
    dark = Level(1.0, 9, 0.0, 0.1, 9.0, 0.1)  # an exposure, and no light
    with refused(ErrorCode.NO_DATA, "4000 ADU"):
        photon_transfer([dark, Level(2.0, 9, 4000.0, 0.1, 9.0, 0.1, saturated=True)])
    with refused(ErrorCode.IMPLAUSIBLE, "-0.012 ADU"):
        photon_transfer([Level(0, 9, 0, 0, 9.0, 0.1), Level(1, 9, 500, 1, 3.0, 0.1)])
