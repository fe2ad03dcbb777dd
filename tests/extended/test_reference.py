"""The blur of a frame against a sharp one."""

import numpy as np
import pytest
from refusals import refused
from scipy.ndimage import gaussian_filter, zoom
from scipy.special import j0

from jitterkit.errors import ConfigurationError, ErrorCode, UndeterminedError
from jitterkit.extended import estimate_from_reference
from jitterkit.loci import Linear, Mvn


@pytest.fixture(scope="session")
def coins(coins):
    """A part of them: a fit takes a third of the time."""
    return coins[:160, :192]


def pair(blur, scene, length, angle, decibels=30.0):
    image = blur(scene, length, angle, decibels)
    y, x = ((a - b) // 2 for a, b in zip(scene.shape, image.shape, strict=True))
    sharp = scene[y : y + image.shape[0], x : x + image.shape[1]]
    noise = np.random.default_rng(9).normal(0, sharp.std() * 10 ** (-decibels / 20), sharp.shape)
    return sharp + noise, image


@pytest.mark.parametrize(
    ("length", "angle", "shift"),
    [(3.0, 53.0, (0, 0)), (11.0, 160.0, (2, -3))],  # columns by one amount, rows by another
)
def test_a_streak_is_found_against_the_sharp_frame_and_moved(length, angle, shift, blur, coins):
    sharp, image = pair(blur, coins, length, angle)
    estimate = estimate_from_reference(sharp, np.roll(image, shift, axis=(0, 1)), plate_scale=0.5)
    found = estimate.locus.describe()
    assert isinstance(estimate.locus, Linear)
    # frames end, and what has left one is not in the other: a hundredth of the length was measured
    assert found["length"] == pytest.approx(0.5 * length, abs=0.02 * length)
    assert found["angle"] == pytest.approx(angle, abs=1.0)


def test_moments_of_a_normal_blur(coins):
    rng = np.random.default_rng(1)
    soft = gaussian_filter(coins, (1.5, 0.8), truncate=8)
    estimate = estimate_from_reference(
        coins + rng.normal(0, 1, coins.shape), soft + rng.normal(0, 1, coins.shape)
    )
    assert isinstance(estimate.locus, Mvn)
    # 2 % for the borders
    np.testing.assert_allclose(estimate.moments, [0.64, 0.0, 2.25], atol=0.045)


@pytest.mark.parametrize("length", [pytest.param(25.0, marks=pytest.mark.slow), 40.0])
def test_a_long_streak_is_not_taken_for_one_of_its_nulls(blur, coins, length):
    estimate = estimate_from_reference(*pair(blur, coins, length, 30.0))
    size = estimate.locus.describe()
    assert abs(size["length"] - length) < 4 * estimate.length_err < 0.01 * length
    assert size["angle"] == pytest.approx(30.0, abs=0.5)


def moved(scene, transfer, margin=24, decibels=40.0):
    """Return a scene and its blur by a transfer function of the frequency along 20 degrees and its square."""
    fy, fx = np.meshgrid(np.fft.fftfreq(scene.shape[0]), np.fft.rfftfreq(scene.shape[1]), indexing="ij")
    along = np.cos(np.radians(20)) * fx + np.sin(np.radians(20)) * fy
    image = np.fft.irfft2(np.fft.rfft2(scene) * transfer(along, fx**2 + fy**2), scene.shape)
    rng, cut = np.random.default_rng(4), (slice(margin, -margin),) * 2
    return [
        f[cut] + rng.normal(0, scene.std() * 10 ** (-decibels / 20), f[cut].shape) for f in (scene, image)
    ]


@pytest.mark.parametrize(
    ("form", "variance", "round_variance"),
    [
        (lambda f: np.sinc(9 * f), 81 / 12, 1.0),  # a drift
        (lambda f: j0(2 * np.pi * 5 * f), 12.5, 0.5),  # a vibration
    ],
)
def test_motion_along_a_line_under_jitter_has_the_moments_of_both(coins, form, variance, round_variance):
    frames = moved(coins, lambda along, square: form(along) * np.exp(-2 * np.pi**2 * round_variance * square))
    estimate = estimate_from_reference(*frames)
    c, s = np.cos(np.radians(20)), np.sin(np.radians(20))
    truth = variance * np.array([c * c, c * s, s * s]) + round_variance * np.array([1, 0, 1])
    assert np.all(np.abs(estimate.moments - truth) < 4 * estimate.errors)
    assert estimate.errors[0] < 0.02 * truth[0]


@pytest.mark.slow
def test_a_jump_is_refused(coins):
    with refused(ErrorCode.MODEL_MISMATCH, "pattern", error=UndeterminedError):
        estimate_from_reference(*moved(coins, lambda along, _: np.cos(np.pi * 8 * along)))


def test_a_reference_whose_stars_are_cut_off_is_refused():
    """A fit then raises the ratio of the fluxes without end, to no number: of 9000 e-, 100 are left."""
    rng = np.random.default_rng(2)
    y, x = np.mgrid[:48, :44]
    squares = [(flux, (x - a) ** 2 + (y - b) ** 2) for flux, a, b in ((9e3, 16, 20), (3e3, 29, 27))]
    stars = sum(flux * (np.exp(-r2 / 3) + 0.01 / (1 + r2 / 20)) for flux, r2 in squares)
    sharp, blurred = (rng.poisson(frame + 10) for frame in (stars, gaussian_filter(stars, 0.8)))
    with refused(ErrorCode.TOO_FEW, "40 x 48", error=UndeterminedError):
        estimate_from_reference(np.minimum(sharp, 100), blurred)


@pytest.mark.parametrize(
    ("sigma", "noise"), [pytest.param(0.0, 1.7, marks=pytest.mark.slow), (0.0, 15.0), (1.5, 15.0)]
)
def test_noise_is_not_taken_for_a_scene(coins, sigma, noise):
    # a blur that smooths the reference's noise must not look better than none
    soft, rng = gaussian_filter(coins, sigma, truncate=8), np.random.default_rng(5)
    frames = [frame + rng.normal(0, noise, coins.shape) for frame in (coins, soft)]
    estimate = estimate_from_reference(*frames)
    assert np.all(np.abs(estimate.moments - np.array([1, 0, 1]) * sigma**2) < 4 * estimate.errors)


@pytest.mark.slow
def test_frames_without_noise(coins):
    np.testing.assert_allclose(estimate_from_reference(coins, 2 * coins + 5).moments, 0, atol=1e-6)
    soft = gaussian_filter(coins, (0, 5), truncate=8)
    np.testing.assert_allclose(estimate_from_reference(coins, soft).moments, [25, 0, 0], atol=0.02)


def test_a_frame_that_is_smaller_than_its_blur_is_refused(coins):
    soft = gaussian_filter(coins, 1)
    with refused(ErrorCode.TOO_FEW, "20 x 20", error=UndeterminedError):
        estimate_from_reference(coins[100:120, 100:120], soft[100:120, 100:120])


def test_the_pixel_kernel_lies_along_the_streak(blur, coins):
    kernel = estimate_from_reference(*pair(blur, coins, 11.0, 20.0), kernel_side=31).kernel
    assert kernel.shape == (31, 31)
    assert kernel.sum() == pytest.approx(1.0)
    y, x = np.mgrid[-15:16, -15:16]
    core = np.where(kernel > 0.3 * kernel.max(), kernel, 0)
    sxx, sxy, syy = ((core * q).sum() / core.sum() for q in (x * x, x * y, y * y))
    assert np.degrees(np.arctan2(2 * sxy, sxx - syy)) / 2 == pytest.approx(20.0, abs=4.0)


def turned_normal(scene, sigma_y, sigma_x):
    return gaussian_filter(scene, (sigma_y, sigma_x), truncate=8)[30:-30, 30:-30]


def in_noise(scene, seed):
    return scene + np.random.default_rng(seed).normal(0, 1, scene.shape)


@pytest.mark.parametrize("length", [pytest.param(3.0, marks=pytest.mark.slow), 30.0])
def test_sharp_and_streaked_exchanged_are_refused(blur, coins, length):
    sharp, streaked = pair(blur, coins, length, 40.0, 45.0)
    with refused(ErrorCode.BAD_REFERENCE, "pixel²", error=UndeterminedError):
        estimate_from_reference(streaked, sharp)


@pytest.mark.parametrize(
    ("reference", "frame"),
    [
        pytest.param((2.0, 2.0), (0.5, 0.5), marks=pytest.mark.slow),  # all round
        ((1.5, 0.5), (0.5, 0.5)),  # along one axis
        ((2.0, 0.8), (0.8, 2.0)),  # each along another
        # behind a blur eight times as large
        pytest.param((2.0, 0.5), (0.5, 4.0), marks=pytest.mark.slow),
    ],
)
def test_a_reference_that_is_blurrier_along_any_axis_is_refused(coins, reference, frame):
    one, two = (in_noise(turned_normal(coins, *sigma), k) for k, sigma in enumerate((reference, frame)))
    with refused(ErrorCode.BAD_REFERENCE, "pixel²", error=UndeterminedError):
        estimate_from_reference(one, two)


def test_a_streak_is_found_in_spite_of_hot_pixels_and_a_mask(blur, coins):
    sharp, image = pair(blur, coins, 11.0, 20.0)
    rng, dead = np.random.default_rng(2), np.zeros(sharp.shape, bool)
    for frame in (sharp, image):
        frame.flat[::997] += 5 * np.ptp(frame)
    dead[:, 100] = True
    dead.flat[rng.choice(dead.size, 200, replace=False)] = True
    sharp[dead], image[dead] = np.nan, np.nan
    found = estimate_from_reference(sharp, image, mask=dead).locus.describe()
    # as without them: 2 % for the borders
    assert found["length"] == pytest.approx(11.0, abs=0.22)
    assert found["angle"] == pytest.approx(20.0, abs=1.0)


def test_frames_that_are_too_small_for_their_streak_name_what_is_wrong(blur, coins):
    with refused(ErrorCode.MODEL_MISMATCH, "shift", 2, "larger", error=UndeterminedError):
        estimate_from_reference(*pair(blur, coins, 50.0, 30.0))  # the correlation of 0.48 is high enough


def test_bad_input_is_refused(coins):
    with refused(ErrorCode.WRONG_SHAPE, 40, error=ConfigurationError):
        estimate_from_reference(coins, coins, kernel_side=40)
    rng = np.random.default_rng(0)
    with refused(ErrorCode.MODEL_MISMATCH, "correlation", 0.3, error=UndeterminedError):
        estimate_from_reference(coins, rng.normal(size=coins.shape))


def behind(pattern, coins, shift):
    """A scene and its blur, moved by whole pixels (y, x), behind a pattern that stands still."""
    soft = np.roll(gaussian_filter(coins, (1.5, 0.8), truncate=8), shift, axis=(0, 1))
    rng = np.random.default_rng(1)
    return [frame + pattern + rng.normal(0, 1, coins.shape) for frame in (coins, soft)]


@pytest.mark.parametrize(("strength", "shift"), [(1.0, (0, 0)), (10.0, (2, -3))])
@pytest.mark.slow
def test_a_pattern_that_stands_still_is_not_taken_for_a_sharp_scene(coins, shift, strength):
    texture = gaussian_filter(np.random.default_rng(3).standard_normal(coins.shape), 2) / 0.14
    with pytest.raises(UndeterminedError) as caught:
        estimate_from_reference(*behind(strength * coins.std() * texture, coins, shift))
    assert caught.value.code in (ErrorCode.MODEL_MISMATCH, ErrorCode.BAD_REFERENCE)


@pytest.mark.parametrize(("columns", "shift"), [(False, (2, -3)), (True, (0, 0))])
def test_fringes_and_columns_do_not_change_the_blur(coins, columns, shift):
    y, x = np.indices(coins.shape)
    pattern = np.sin(2 * np.pi * (x + 0.3 * y) / 12)
    if columns:
        pattern = np.random.default_rng(3).standard_normal(coins.shape[1])[None, :]
    found = estimate_from_reference(*behind(coins.std() * pattern, coins, shift))
    apart = np.abs(found.moments - [0.64, 0.0, 2.25])
    assert np.all(apart < np.minimum(0.2, 3.5 * found.errors)), (found.moments, found.errors)


def copies(scene, path, sub=4):
    """Sum copies of a scene on sub-pixels along a path (n, 2) of whole ones (x, y); bin it and the scene."""
    fine = gaussian_filter(zoom(scene, sub, order=1), 0.7 * sub)
    summed = np.mean([np.roll(fine, (y, x), axis=(0, 1)) for x, y in path], axis=0)
    (ny, nx), inside = scene.shape, (slice(12, -12),) * 2  # what is rolled over the borders is cut off
    binned = [f.reshape(ny, sub, nx, sub).mean((1, 3))[inside] for f in (fine, summed)]
    off = (path - path.mean(0)) / sub
    return *binned, (off.T @ off / len(off))[[0, 0, 1], [0, 1, 1]]


def counted(frame, electrons, seed):
    rng = np.random.default_rng(seed)
    return rng.poisson(frame * electrons / frame.max()) + rng.normal(0, 5, frame.shape)


def on_a_circle(radius):
    angles = 2 * np.pi * np.arange(48) / 48
    return np.rint(4 * radius * np.stack([np.cos(angles), np.sin(angles)], -1)).astype(int)


def test_what_a_motion_on_a_circle_leaves_counts_as_an_error(coins):
    # no known blur is a ring: a streak under a normal has 1.2 times its variance
    sharp, image, truth = copies(coins, on_a_circle(1.5))
    estimate = estimate_from_reference(counted(sharp, 20000, 1), counted(image, 20000, 2))
    assert np.all(np.abs(estimate.moments - truth) < 3.5 * estimate.errors)
    assert estimate.errors.max() < 0.3 * (truth[0] + truth[2])


def test_a_kind_that_is_preferred_for_few_photons_has_the_error_of_the_next(coins):
    # of a streak under so little jitter, a streak alone fits nearly as well, and has other moments
    rng = np.random.default_rng(2)
    path = np.rint(np.outer(np.linspace(-6, 6, 97), [0.84, 0.54]) + rng.normal(0, 1.2, (97, 2))).astype(int)
    sharp, image, truth = copies(coins, path)
    estimate = estimate_from_reference(counted(sharp, 2000, 8), counted(image, 2000, 17))
    assert np.all(np.abs(estimate.moments - truth) < 3.5 * estimate.errors)


def test_a_copy_of_a_frame_is_no_blur_and_not_blurrier(coins):
    for gain in (1.0, 2.0):
        estimate = estimate_from_reference(coins, gain * coins + 5)
        assert estimate.is_undetected
        assert estimate.errors.max() < 1e-5


@pytest.mark.slow
def test_rays_in_the_sharp_frame_do_not_make_it_blurrier(coins):
    sharp, image, _ = copies(coins, np.zeros((1, 2), int))
    sharp = counted(sharp, 10000, 1)
    sharp.flat[np.random.default_rng(3).choice(sharp.size, 20, replace=False)] += 8000
    with refused(ErrorCode.MODEL_MISMATCH, error=UndeterminedError):
        estimate_from_reference(sharp, counted(image, 10000, 2))


def test_frames_that_show_their_border_alone_are_refused(coins):
    dark = np.zeros_like(coins)
    dark[:8] = coins[40:48]
    with refused(ErrorCode.NO_SIGNAL, "192 x 160", error=UndeterminedError):
        estimate_from_reference(dark, dark)
