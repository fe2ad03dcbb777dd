"""Finding the stars in a full camera frame."""

import time

import numpy as np
import pytest
from refusals import refused

from jitterkit.errors import ErrorCode, FrameError
from jitterkit.frames import RawFrame
from jitterkit.frames.region import find_region

SKY, READ_NOISE, ELECTRONS = 120.0, 3.0, 2e6


def speckles(rng, centre, shape, spread=18.0, count=400):
    """A pattern some 100 pixels wide of which no pixel has more than a few thousandths of the light."""
    image = np.zeros(shape)
    positions = np.rint(rng.normal(centre, spread, (count, 2))).astype(int)
    inside = ((positions >= 0) & (positions < shape)).all(axis=1)
    np.add.at(image, tuple(positions[inside].T), 1 / count)
    blur = np.exp(-0.5 * (np.arange(-4, 5) / 1.3) ** 2)
    for axis in (0, 1):
        image = np.apply_along_axis(np.convolve, axis, image, blur / blur.sum(), mode="same")
    return image


def pair(rng, y, x, angle, separation=27.0, contrast=3.37):
    """A small image of the pair, and where its middle belongs."""
    half = 0.5 * separation * np.array([np.sin(angle), np.cos(angle)])
    light = speckles(rng, 100 - half, (201, 201)) * contrast + speckles(rng, 100 + half, (201, 201))
    return light / (1 + contrast), (y, x)


def star(rng, y, x, angle):
    rows = np.arange(-100, 101)
    return np.exp(-0.5 * (rows[:, None] ** 2 + rows**2) / 1.5**2) / (2 * np.pi * 1.5**2), (y, x)


def camera(rng, shape, light=None, flux=ELECTRONS, vignetting=0.0):
    """A frame in ADU with sky, bias, noise, hot pixels, a bad column and cosmic rays that do not cross it."""
    ny, nx = shape
    y, x = np.mgrid[:ny, :nx]
    expected = SKY * (1 - vignetting * ((2 * y / ny - 1) ** 2 + (2 * x / nx - 1) ** 2))
    if light is not None:
        image, (cy, cx) = light
        top, left = max(cy - 100, 0), max(cx - 100, 0)
        part = image[top - cy + 100 :, left - cx + 100 :][: ny - top, : nx - left]
        expected[top : top + part.shape[0], left : left + part.shape[1]] += flux * part
    data = expected + np.sqrt(expected + READ_NOISE**2) * rng.standard_normal(shape) + 100
    hot = rng.integers(0, data.size, data.size // 2000)
    data.flat[hot] = 4095
    data[:, nx // 3] = 4095
    for _ in range(3):
        row, column = rng.integers(10, ny - 40), rng.integers(nx // 3 + 5, nx - 40)
        data[np.arange(row, row + 25), np.arange(column, column + 25)] += 1500
    return np.clip(np.rint(data), 0, 65535).astype(np.uint16)


@pytest.mark.parametrize("make", [pair, star])
@pytest.mark.parametrize(("y", "x", "angle"), [(300, 500, 0.3), (431, 211, 1.6), (250, 650, 2.5)])
def test_the_light_is_at_the_centre_of_the_region(make, y, x, angle):
    rng = np.random.default_rng(y)
    image, position = make(rng, y, x, angle)
    rows = np.arange(201) - 100
    light = np.array([image.sum(axis=1) @ rows, image.sum(axis=0) @ rows]) / image.sum() + position
    raw = RawFrame.from_array(camera(rng, (600, 800), (image, position), vignetting=0.1))
    region = find_region(raw)
    x0, y0 = region.origin
    assert region.shape == (128, 128)
    # binned by 8: a bin's quarter, and the light that falls outside the region
    assert np.abs(np.array([y0, x0]) + 63.5 - light).max() < 4
    np.testing.assert_array_equal(region.data, raw.data[y0 : y0 + 128, x0 : x0 + 128])


@pytest.mark.parametrize(("y", "x"), [(20, 400), (300, 790), (590, 5)])
def test_at_the_border_the_region_is_clamped_and_holds_the_star(y, x):
    rng = np.random.default_rng(x)
    raw = RawFrame.from_array(camera(rng, (600, 800), star(rng, y, x, 0)))
    x0, y0 = find_region(raw).origin
    assert 0 <= x0 <= 800 - 128
    assert 0 <= y0 <= 600 - 128
    assert x0 <= x < x0 + 128
    assert y0 <= y < y0 + 128


def test_an_origin_is_carried_on_and_metadata_kept():
    rng = np.random.default_rng(4)
    raw = RawFrame.from_array(camera(rng, (600, 800), star(rng, 300, 500, 0)), gain=3.7)
    whole = find_region(raw).origin
    part = find_region(raw.region(100, 50, 600, 500))
    assert np.abs(np.subtract(part.origin, whole)).max() <= 2
    assert part.metadata.gain.value == 3.7


def test_a_bright_blob_that_is_masked_is_not_found():
    rng = np.random.default_rng(4)
    data = camera(rng, (600, 800), star(rng, 300, 500, 0))
    data[90:110, 90:110] = 60000
    x0, y0 = find_region(RawFrame.from_array(data, mask=data == 60000)).origin
    assert abs(x0 + 63.5 - 500) < 4
    assert abs(y0 + 63.5 - 300) < 4


@pytest.mark.parametrize("shape", [(100, 90), (128, 128)])
def test_a_small_frame_is_returned_as_it_is(shape):
    raw = RawFrame.from_array(np.zeros(shape))
    assert find_region(raw) is raw


def test_a_frame_small_on_one_side_is_cut_on_the_other():
    rng = np.random.default_rng(4)
    raw = RawFrame.from_array(camera(rng, (120, 700), star(rng, 60, 500, 0)))
    region = find_region(raw)
    assert region.shape == (120, 128)
    assert region.origin[1] == 0
    assert abs(region.origin[0] + 63.5 - 500) < 4


def test_a_frame_barely_larger_than_the_region_is_cut():
    rng = np.random.default_rng(4)
    raw = RawFrame.from_array(camera(rng, (150, 160), pair(rng, 80, 75, 0.4)))
    x0, y0 = find_region(raw).origin
    assert abs(x0 + 63.5 - 75) < 8
    assert abs(y0 + 63.5 - 80) < 8


@pytest.mark.parametrize(("shape", "vignetting"), [((600, 800), 0.02), ((200, 220), 0.0)])
@pytest.mark.parametrize("seed", range(10))
def test_sky_hot_pixels_and_cosmic_rays_alone_are_no_star(shape, vignetting, seed):
    raw = RawFrame.from_array(camera(np.random.default_rng(seed), shape, vignetting=vignetting))
    with refused(ErrorCode.NO_STAR, "array", "64 pixels", error=FrameError):
        find_region(raw)


@pytest.mark.parametrize("level", [0.0, 100.0])
def test_a_frame_of_one_value_or_all_masked_has_no_star(level):
    with refused(ErrorCode.NO_STAR, "array", error=FrameError):
        find_region(RawFrame.from_array(np.full((300, 400), level)))
    with refused(ErrorCode.NO_STAR, "array", error=FrameError):
        find_region(RawFrame.from_array(np.full((300, 400), np.nan)))


def test_twenty_megapixels_take_about_a_second():
    rng = np.random.default_rng(7)
    data = rng.integers(190, 250, (3648, 5472), dtype=np.uint16)
    image, _ = pair(rng, 0, 0, 1.0)
    data[2500:2701, 4000:4201] += rng.poisson(ELECTRONS * image).astype(np.uint16)
    raw = RawFrame(data.astype(np.float64))
    find_region(raw.region(3900, 2400, 400, 400))  # loads what is loaded once
    start = time.process_time()
    x0, y0 = find_region(raw).origin
    seconds = time.process_time() - start
    assert abs(x0 + 63.5 - 4100) < 8
    assert abs(y0 + 63.5 - 2600) < 8
    assert seconds < 3, f"{seconds:.2f} s of processor time, all cores together"


def test_a_sky_that_brightens_to_a_corner_is_not_taken_for_the_star():
    rng = np.random.default_rng(4)
    data = camera(rng, (900, 1200), star(rng, 300, 350, 0), flux=8e4).astype(float)
    data += 40 * (np.arange(900) / 900)[:, None] * (np.arange(1200) / 1200)
    x0, y0 = find_region(RawFrame.from_array(data)).origin
    assert abs(x0 + 63.5 - 350) < 4
    assert abs(y0 + 63.5 - 300) < 4
