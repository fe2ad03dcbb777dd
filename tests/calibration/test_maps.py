"""Maps of bias, read noise, dark current and response, and the pixels that are bad."""

import re

import numpy as np
import pytest

from jitterkit.calibration import FLAGS, Settings, Stack, calibrate
from jitterkit.calibration.flat_frames import surface


def pull(found, truth, good):
    return float(np.std((found.values - truth)[good] / found.error))


def test_every_map_is_the_truth_within_its_error(a_camera):
    camera = a_camera(rays=1e-5, hot=20, dead=12, tilt=0.05)
    flats = [camera.flats(8, seconds) for seconds in (0.2, 0.5, 0.9)]
    found = calibrate(camera.biases(20), [camera.darks(10, s) for s in (10.0, 30.0)], flats)
    good = found.bad == 0
    response = camera.response / camera.response[good].mean()
    # of 16,384 pulls the standard deviation is good to 0.55 %; the errors are those of a typical pixel
    assert pull(found.bias, camera.offset, good) == pytest.approx(1, abs=0.03)
    assert pull(found.dark_current, camera.dark, good) == pytest.approx(1, abs=0.03)
    assert pull(found.flat, response, good) == pytest.approx(1, abs=0.03)
    assert found.flat.values[good].mean() == pytest.approx(1, abs=1e-9)
    for measured, truth in (
        (found.bias, camera.offset[good].mean()),
        (found.dark_current, camera.dark[good].mean()),
        (found.read_noise, 2.4),
    ):
        assert measured.number == pytest.approx(truth, abs=4 * measured.number_error)


def test_read_noise_is_without_rounding_and_unbiased(a_camera):
    camera = a_camera(gain=3.7, noise=1.9)  # half an ADU, of which rounding makes 0.29
    found = calibrate(camera.biases(30), gain=3.7).read_noise
    assert found.number == pytest.approx(1.9, abs=4 * found.number_error)
    assert found.number_error < 0.01
    # chi square of 29, zero where it would be negative: the mean square is that of the number
    assert np.mean(found.values**2) == pytest.approx(1.9**2, rel=0.02)
    # one pixel in two is known to (1.9² + 3.7²/12)/1.9 / sqrt(2 · 29)
    assert found.error == pytest.approx((1.9**2 + 3.7**2 / 12) / 1.9 / 58**0.5, rel=0.02)
    assert not found.serves


def test_a_map_serves_once_its_pixels_differ_by_more_than_its_error(a_camera):
    camera = a_camera()  # offsets differ by 0.3 ADU, of which a frame knows 0.71
    few, many = (calibrate(camera.biases(n), gain=3.7).bias for n in (3, 30))
    assert not few.serves
    assert many.serves
    short, long = (
        [float(number) for number in re.findall(r"\d+(?:\.\d+)?", found.sentence())] for found in (few, many)
    )
    assert long == pytest.approx([30, many.true_spread, many.error], rel=0.005)
    assert short[:3] == pytest.approx([3, few.true_spread, few.error], rel=0.005)
    assert short[3:] == [pytest.approx(2 * (0.71 / 0.3) ** 2, abs=1.5)]  # frames from which it would serve


@pytest.mark.parametrize("seconds", [(20.0,), (10.0, 40.0), (5.0, 20.0, 60.0)])
def test_dark_current_comes_from_one_exposure_or_several(camera, seconds):
    found = calibrate(camera.biases(20), [camera.darks(10, s) for s in seconds], gain=3.7).dark_current
    good = np.ones(camera.dark.shape, bool)
    assert pull(found, camera.dark, good) == pytest.approx(1, abs=0.03)


def test_dark_current_needs_no_bias_with_two_exposures(camera):
    darks = [camera.darks(10, s) for s in (10.0, 40.0)]
    found = calibrate(None, darks, gain=3.7).dark_current
    assert found.number == pytest.approx(camera.dark.mean(), abs=4 * found.number_error)


def test_hot_dead_noisy_and_blank_pixels_are_found_and_no_others(a_camera):
    camera = a_camera(hot=20, dead=12)
    pixels = camera.biases(20).pixels.astype(float)
    pixels[:, 5, 6] += 20 * camera.rng.normal(size=20)
    pixels[3, 8, 9] = np.nan
    found = calibrate(
        Stack.of("bias", pixels), [camera.darks(10, 20.0)], [camera.flats(8, s) for s in (0.2, 0.6)]
    )
    for flag, positions in (("hot", camera.hot_places), ("dead", camera.dead_places)):
        marked = np.flatnonzero(found.bad & FLAGS[flag])
        assert set(marked) == set(positions)
        assert found.count(flag) == len(positions)
    assert np.argwhere(found.bad & FLAGS["noisy"]).tolist() == [[5, 6]]
    assert np.argwhere(found.bad & FLAGS["blank"]).tolist() == [[8, 9]]


def test_light_that_is_not_even_is_kept_or_divided_out(a_camera):
    camera = a_camera(tilt=0.1)
    biases, flats = camera.biases(10), [camera.flats(8, 0.5), camera.flats(8, 0.8)]
    kept, divided = (calibrate(biases, (), flats, settings=Settings(smooth=s)) for s in (False, True))
    columns = kept.flat.values.mean(axis=0), divided.flat.values.mean(axis=0)
    # the tilt of 0.1 at either end; a column's mean is good to (0.006, 0.003)/√128
    assert columns[0][[0, -1]] == pytest.approx([0.9, 1.1], abs=0.004)
    assert columns[1] == pytest.approx(1, abs=0.004)
    assert kept.gradient == pytest.approx(1.1 / 0.9 - 1, abs=0.01)
    assert kept.prnu == pytest.approx(divided.prnu, rel=1e-9)


def test_a_bent_detector_has_the_response_of_its_light(a_camera):
    camera = a_camera(bend=-5e-6, prnu=0.01)
    flats = [camera.flats(8, s, drift=0.0005) for s in (0.1, 0.2, 0.4, 0.7, 1.0)]
    found = calibrate(camera.biases(16), (), flats)
    truth = camera.response / camera.response.mean()
    slope = np.polyfit(truth.ravel() - 1, found.flat.values.ravel() - 1, 1)[0]
    # readings alone would give 0.955; a slope of 16,384 pixels is good to (0.0026/0.01)/128
    assert slope == pytest.approx(1, abs=4 * 0.26 / 128 + 0.004)


def test_the_surface_through_a_cubic_is_the_cubic(rng):
    x = np.linspace(-1, 1, 192)
    truth = 1000 + 80 * x[:, None] - 50 * x + 30 * x[:, None] * x**2 - 40 * x**2
    image = truth.copy()
    image[rng.random(image.shape) < 0.01] = 0.0
    # 48 x 48 medians of 4 x 4 pixels: of a slope of 100 over 192 pixels, one tile is 2
    np.testing.assert_allclose(surface(image, np.ones(image.shape, bool)), truth, atol=0.5)


def test_dark_current_is_no_response(a_camera):
    camera = a_camera()
    camera.dark = 300 * camera.dark  # 48 e- from pixel to pixel in a second, PRNU makes 48
    found = calibrate(camera.biases(20), [camera.darks(20, 10.0)], [camera.flats(10, 1.0, 8000.0)])
    truth = camera.response / camera.response.mean()
    slope = np.polyfit(camera.dark.ravel() / 8000, (found.flat.values - truth).ravel(), 1)[0]
    # left in, it would be 1; a pixel is known to 0.0035, dark currents differ by 0.006 of the light
    assert slope == pytest.approx(0, abs=4 * 0.0035 / 0.006 / 128)
