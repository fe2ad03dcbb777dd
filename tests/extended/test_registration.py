"""Shifts between frames, against exact ones."""

import numpy as np
import pytest
from refusals import refused
from scipy import fft
from scipy.ndimage import gaussian_filter
from skimage.registration import phase_cross_correlation

from jitterkit.errors import ConfigurationError, ErrorCode, UndeterminedError
from jitterkit.extended import drifts, register
from jitterkit.extended.registration import align


def shifted(scene, x, y, decibels=40.0, seed=0):
    """The scene behind a PSF of one pixel, moved exactly; mirrored borders are cut off."""
    padded = np.pad(scene, 64, mode="symmetric")
    fy, fx = fft.fftfreq(padded.shape[0])[:, None], fft.rfftfreq(padded.shape[1])
    move = np.exp(-2j * np.pi * (fx * x + fy * y) - 2 * np.pi**2 * (fx**2 + fy**2))
    image = fft.irfft2(fft.rfft2(padded) * move, padded.shape)[80:-80, 80:-80]
    return image + np.random.default_rng(seed).normal(0, image.std() * 10 ** (-decibels / 20), image.shape)


@pytest.mark.parametrize(("x", "y"), [(0.0, 0.0), (0.31, -0.44), (5.7, 2.2), (-3.5, 11.25)])
def test_positive_shifts_go_to_larger_columns_and_rows(x, y, gravel):
    drift = register(shifted(gravel, 0, 0), shifted(gravel, x, y, seed=1), plate_scale=0.5)
    assert drift.x == pytest.approx(0.5 * x, abs=5 * drift.errors[0])
    assert drift.y == pytest.approx(0.5 * y, abs=5 * drift.errors[1])
    assert drift.errors.max() < 0.005


def test_errors_are_those_of_the_bound(gravel):
    # at 20 dB the floor of 0.003 pixels, which is for the window, is a part of the errors only
    one = shifted(gravel, 0, 0, 300.0)
    slopes = np.stack([np.gradient(one, axis=1).ravel(), np.gradient(one, axis=0).ravel()])
    noise = 0.3 * one.std()
    bound = np.sqrt(np.diag(np.linalg.inv(slopes @ slopes.T)) * 2) * noise
    found = []
    for seed in range(12):
        frames = [
            shifted(gravel, *s, -20 * np.log10(0.3), 2 * seed + k) for k, s in enumerate([(0, 0), (1.3, 0.6)])
        ]
        drift = register(*frames)
        found.append([drift.x - 1.3, drift.y - 0.6, *drift.errors])
    off, errors = np.array(found)[:, :2], np.array(found)[:, 2:]
    # of twelve, a standard deviation scatters by a fifth; the window costs another third
    assert np.all(np.sqrt(np.mean(off**2, axis=0)) < 2.5 * bound)
    assert 0.5 < np.sqrt(np.mean((off / errors) ** 2)) < 1.6


def test_it_is_ten_times_closer_than_phase_correlation(gravel):
    one, two = shifted(gravel, 0, 0), shifted(gravel, 2.37, -1.61, seed=1)
    drift = register(one, two)
    theirs = -phase_cross_correlation(one, two, normalization=None, upsample_factor=100)[0]
    ours = np.hypot(drift.x - 2.37, drift.y + 1.61)
    assert ours < 0.1 * np.hypot(theirs[1] - 2.37, theirs[0] + 1.61) + 0.002


def test_a_sequence_is_measured_against_its_first(gravel):
    path = [(0.0, 0.0), (0.4, 0.1), (0.9, -0.3)]
    found = drifts(shifted(gravel, x, y, seed=k) for k, (x, y) in enumerate(path))
    np.testing.assert_allclose([(d.x, d.y) for d in found], path[1:], atol=0.01)


def test_frames_without_a_common_scene_are_refused(gravel):
    rng = np.random.default_rng(0)
    with refused(ErrorCode.MODEL_MISMATCH, "-0.05", 0.3, error=UndeterminedError):  # the correlation
        register(rng.normal(size=(128, 128)), rng.normal(size=(128, 128)))
    with refused(ErrorCode.NO_SIGNAL, "image", 1, error=UndeterminedError):
        register(gravel, np.ones_like(gravel))


def test_frames_of_two_shapes_are_refused(gravel):
    with refused(ErrorCode.WRONG_SHAPE, (300, 300), (299, 300), error=ConfigurationError):
        register(gravel, gravel[1:])


def test_frames_with_holes_are_refused(gravel):
    holed = gravel.copy()
    holed[3, 4:7] = np.nan
    with refused(ErrorCode.OUT_OF_RANGE, "image", "3 of 90000", error=ConfigurationError):
        register(gravel, holed)


def test_frames_that_share_too_few_pixels_are_refused(gravel):
    with refused(ErrorCode.TOO_FEW, "12 pixels", 16, error=UndeterminedError):
        register(gravel[:12, :40], gravel[:12, :40])


def starlight(x, y, seed, fwhm):
    """Normal stars at places moved by (x, y), in noise of 2."""
    positions, noise = np.random.default_rng(1), np.random.default_rng(seed)
    rows, columns = np.mgrid[:200, :200]
    image, sigma = noise.normal(0, 2, (200, 200)), fwhm / 2.355
    for x0, y0, peak in zip(
        *positions.uniform(20, 180, (2, 40)), 10 ** positions.uniform(1, 3, 40), strict=True
    ):
        image += peak * np.exp(-((columns - x0 - x) ** 2 + (rows - y0 - y) ** 2) / (2 * sigma**2))
    return image


def hot_pixels(image):
    image.flat[np.random.default_rng(5).choice(image.size, 65, replace=False)] += 3000


def hot_pairs(image):
    y, x = np.random.default_rng(5).integers(2, 190, (2, 30))
    image[y, x] += 3000
    image[y, x + 1] += 2000


def hot_columns(image):
    image[:, 100] += 500
    image[40:, 150] += 2000


def dead_columns(image):
    image[:, 60] = 0
    image[:, 120:122] = 0


@pytest.mark.parametrize("fwhm", [1.5, 3.5])
@pytest.mark.parametrize("pattern", [hot_pixels, hot_pairs, hot_columns, dead_columns])
@pytest.mark.parametrize(("x", "y"), [(3.4, -2.2), (0.4, 0.3), (12.3, 5.6)])
def test_what_stands_still_does_not_hold_the_drift(x, y, pattern, fwhm):
    frames = starlight(0, 0, 1, fwhm), starlight(x, y, 2, fwhm)
    for frame in frames:
        pattern(frame)
    drift = register(*frames)
    # a FWHM of 1.5 pixels aliases: 0.01 without a pattern
    assert np.hypot(drift.x - x, drift.y - y) < 0.03


def _uneven(shape=(200, 200)):
    return np.random.default_rng(3).standard_normal(shape)


ROWS, COLUMNS = np.mgrid[:200, :200]
HOLDING = {
    "flat field": lambda image: image * (1 + 0.1 * _uneven()),
    "dark current": lambda image: image + 30 * _uneven(),
    "smooth structure": lambda image: image + 40 * gaussian_filter(_uneven(), 2) / 0.14,
    "rows": lambda image: image + 30 * _uneven((200, 1)),
    "columns": lambda image: image + 30 * _uneven((1, 200)),
    "amplifiers": lambda image: image + np.where(COLUMNS < 100, 0, 200),
    "fringes": lambda image: image + 100 * np.sin(2 * np.pi * (COLUMNS + 0.3 * ROWS) / 12),
    "ghost": lambda image: image + 800 * np.exp(-((COLUMNS - 80) ** 2 + (ROWS - 70) ** 2) / 72),
}
"""Patterns that stand still and would hold the drift by 0.05 to 4 pixels."""
HARMLESS = {
    "vignetting": lambda image: image * (1 - 0.25 * np.hypot(COLUMNS - 100, ROWS - 100) ** 2 / 100**2),
    "gradient": lambda image: image + 2.0 * COLUMNS,
    "mosaic": lambda image: image * (1 + 0.3 * ((COLUMNS + ROWS) % 2)),
    "glow": lambda image: image + 2000 * np.exp(-np.hypot(COLUMNS, ROWS) / 40),
}
"""Patterns as smooth as the window, or finer than the band."""


def with_pattern(pattern, x, y):
    """A scene of 100 more a pixel, so that a flat field counts, and the same moved by (x, y)."""
    return [pattern(starlight(a, b, seed, 3.5) + 100) for seed, a, b in ((1, 0, 0), (2, x, y))]


@pytest.mark.parametrize(("x", "y"), [(3.4, -2.2), (0.3, 0.2)])
@pytest.mark.parametrize("pattern", [name for name in HOLDING if name != "flat field"])
def test_a_pattern_that_would_hold_the_drift_is_refused(x, y, pattern):
    with refused(ErrorCode.MODEL_MISMATCH, error=UndeterminedError):
        register(*with_pattern(HOLDING[pattern], x, y))


@pytest.mark.parametrize(("x", "y"), [(0.0, 0.0), (0.0, 1.3), (2.0, 0.0)])
@pytest.mark.parametrize("sigma", [0.0, 0.7])
def test_a_scene_that_did_not_move_along_an_axis_is_registered(x, y, sigma):
    one, two = starlight(0, 0, 1, 3.5), starlight(x, y, 2, 3.5)
    drift = register(one, gaussian_filter(two, sigma))
    assert np.hypot(drift.x - x, drift.y - y) < 5 * drift.errors.max()


def test_what_a_weak_pattern_may_do_is_in_the_error():
    """A flat field of 10 % moves the shift by 1 %, which is 5 errors of noise."""
    frames = with_pattern(HOLDING["flat field"], 3.4, -2.2)
    drift, (noise, bias) = register(*frames), align(*frames)
    assert np.hypot(drift.x - 3.4, drift.y + 2.2) > 4 * noise.errors.max()
    assert np.hypot(drift.x - 3.4, drift.y + 2.2) < 2 * drift.errors.max()
    assert drift.errors[0] == pytest.approx(np.hypot(noise.errors[0], bias))


@pytest.mark.parametrize("pattern", HARMLESS)
@pytest.mark.parametrize(("x", "y"), [(3.4, -2.2), (0.3, 0.2)])
def test_a_pattern_that_does_not_hold_the_drift_is_no_reason_to_refuse(x, y, pattern):
    drift = register(*with_pattern(HARMLESS[pattern], x, y))
    assert np.hypot(drift.x - x, drift.y - y) < 5 * drift.errors.max()


def test_sharp_stars_that_stand_still_are_no_hot_pixels():
    drift = register(starlight(0, 0, 1, 1.5), starlight(0, 0, 2, 1.5))
    assert np.hypot(drift.x, drift.y) < 5 * drift.errors.max()


def test_masked_pixels_may_hold_anything_and_do_not_count(gravel):
    one, two = shifted(gravel, 0, 0), shifted(gravel, 2.6, -1.3, seed=1)
    mask = np.zeros(one.shape, bool)
    mask[:, 50:53], mask[90:100, 80:95] = True, True
    one[mask], two[mask] = np.nan, 1e9
    drift = register(one, two, mask=mask)
    assert drift.x == pytest.approx(2.6, abs=5 * drift.errors[0])
    assert drift.y == pytest.approx(-1.3, abs=5 * drift.errors[1])
    (other,) = drifts([one, two], mask=mask)
    assert (other.x, other.y) == (drift.x, drift.y)


def test_a_mask_of_another_shape_or_of_everything_is_refused(gravel):
    with refused(ErrorCode.WRONG_SHAPE, (300, 300), (299, 300)):
        register(gravel, gravel, mask=np.zeros((299, 300), bool))
    with refused(ErrorCode.NO_DATA, "0 pixels"):
        register(gravel, gravel, mask=np.ones(gravel.shape, bool))
