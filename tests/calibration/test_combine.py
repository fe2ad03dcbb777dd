"""Masters: unbiased means and variances, whatever hits the frames and however they are read."""

import numpy as np
import pytest

from jitterkit.calibration import Stack, combine, open_stacks
from jitterkit.calibration.master import kept_variance
from jitterkit.frames import write_fits, write_tiff

LEVEL, SIGMA = 1000.3, 5.0


def normal(rng, count, size=128):
    """Whole numbers; rounding adds 1/12 to the variance."""
    return np.rint(rng.normal(LEVEL, SIGMA, (count, size, size))).astype(np.uint16)


@pytest.mark.parametrize(("count", "clip"), [(2, 5), (3, 5), (10, 4), (10, 5), (30, 3), (30, 5)])
def test_mean_and_variance_are_unbiased_however_many_frames_and_however_they_are_clipped(rng, count, clip):
    master = combine(Stack.of("bias", normal(rng, count)), clip=clip)
    pixels = master.mean.size
    # standard errors of a mean and of a mean variance; half a per cent beside for clipping at 3 and 4 sigma,
    # which is known for a known sigma and a pixel's own is not
    slack = 0.0 if clip == 5 else 0.005
    assert master.mean.mean() == pytest.approx(LEVEL, abs=4 * SIGMA / (count * pixels) ** 0.5)
    expected = SIGMA**2 + 1 / 12
    error = (2 / ((count - 1) * pixels)) ** 0.5
    assert master.variance.mean(dtype=float) == pytest.approx(expected, rel=4 * error + slack)


def test_the_share_that_clipping_leaves_is_the_integral_over_the_normal():
    x = np.linspace(-3, 3, 200_001)
    density = np.exp(-(x**2) / 2)
    integral = np.trapezoid(x**2 * density, x) / np.trapezoid(density, x)
    assert kept_variance(3.0, 10**9) == pytest.approx(integral, abs=1e-8)


def test_errors_of_the_mean_have_pulls_of_one(rng):
    master = combine(Stack.of("bias", normal(rng, 20)))
    pulls = (master.mean - LEVEL) / (SIGMA**2 + 1 / 12) ** 0.5 * 20**0.5
    # of 16,384 pulls the standard deviation is good to 0.55 %
    assert pulls.std() == pytest.approx(1, abs=0.022)
    assert np.mean(master.error**2) == pytest.approx((SIGMA**2 + 1 / 12) / 20, rel=0.01)


@pytest.mark.parametrize("count", [3, 5, 12])
def test_cosmic_rays_leave_no_trace(rng, count):
    clean = normal(rng, count)
    struck = clean.copy()
    hit = rng.random(clean.shape) < 1e-3
    struck[hit] += 2000
    without, master = (combine(Stack.of("bias", pixels)) for pixels in (clean, struck))
    once = hit.sum(axis=0) == 1
    # a frame less: the mean of the others, within five of its errors
    assert np.abs(master.mean - without.mean)[once].max() < 5 * SIGMA * 2**0.5
    assert (master.kept[once] == count - 1).all()
    # chi square of what is left
    error = (2 / ((count - 2) * once.sum())) ** 0.5
    assert master.variance[once].mean(dtype=float) == pytest.approx(SIGMA**2, rel=4 * error)
    assert master.rejected == pytest.approx(hit.sum(), abs=3 + 0.02 * hit.sum())


def test_of_two_frames_the_one_without_the_ray_is_kept(rng):
    pixels = normal(rng, 2)
    pixels[1, 40, 50] += 3000
    master = combine(Stack.of("bias", pixels))
    assert master.mean[40, 50] == pixels[0, 40, 50]
    assert master.kept[40, 50] == 1


def test_a_noisy_pixel_keeps_its_own_noise(rng):
    pixels = normal(rng, 40).astype(float)
    pixels[:, 7, 9] += rng.normal(0, 60, 40)
    master = combine(Stack.of("bias", pixels))
    # chi square of 39: 23 % of a variance
    assert master.variance[7, 9] == pytest.approx(60**2 + 25, rel=0.7)
    assert master.kept[7, 9] >= 39


@pytest.mark.parametrize("lamp", [None, (0.97, 1.0, 1.01, 1.02, 0.99, 1.01)])
def test_bands_of_rows_give_exactly_what_one_piece_gives(rng, lamp):
    pixels = np.rint(rng.normal(LEVEL, SIGMA, (6, 200, 50))).astype(np.uint16)
    pixels[2, 150, 20] += 900
    stack = Stack.of("flat", pixels, 1.0)
    scales = None if lamp is None else np.array(lamp)
    whole, banded = (
        combine(stack, memory=memory, scales=scales, pedestal=100.0) for memory in (1e9, 6 * 70 * 50 * 2)
    )
    assert len(list(stack.bands(6 * 70 * 50 * 2, 64))) == 4
    for name in ("mean", "variance", "kept", "usual"):
        np.testing.assert_array_equal(getattr(whole, name), getattr(banded, name))
    assert whole.neighbours == pytest.approx(banded.neighbours, rel=1e-12)


def test_a_lamp_that_changes_is_scaled_away(rng):
    lamp = np.array([0.9, 1.0, 1.1])
    light = rng.poisson(5000 * lamp[:, None, None], (3, 128, 128)) + 100.0
    master = combine(Stack.of("flat", light, 1.0), scales=lamp, pedestal=100.0)
    # the mean over frames of 5000 l / l²
    expected = 5000 * np.mean(1 / lamp)
    assert master.variance.mean(dtype=float) == pytest.approx(expected, rel=4 * (1 / 16384) ** 0.5)
    assert master.mean.mean() == pytest.approx(5100, abs=4 * (5000 / 3 / 16384) ** 0.5)


def test_files_of_both_formats_and_cubes_are_one_stack(rng, tmp_path):
    pixels = normal(rng, 5, 40)
    write_fits(tmp_path / "a.fits", pixels[:3])
    write_fits(tmp_path / "b.fits", pixels[3])
    write_tiff(tmp_path / "c.tiff", pixels[4])
    (stack,) = open_stacks("bias", [tmp_path])
    assert len(stack) == 5
    assert stack.dtype == np.uint16
    np.testing.assert_array_equal(combine(stack).mean, combine(Stack.of("bias", pixels)).mean)


def test_frames_are_grouped_by_exposure(rng, tmp_path):
    pixels = normal(rng, 6, 16)
    for i, seconds in enumerate((2.0, 0.5, 2.0, 0.5, 2.0, 0.5)):
        write_fits(tmp_path / f"{i}.fits", pixels[i], header={"EXPTIME": seconds})
    short, long = open_stacks("dark", [tmp_path])
    assert (short.exposure, long.exposure) == (0.5, 2.0)
    assert [shot.name for shot in short.shots] == ["1.fits", "3.fits", "5.fits"]
    (told,) = open_stacks("dark", [tmp_path], exposure=3.0)
    assert (len(told), told.exposure) == (6, 3.0)


def test_blank_pixels_are_unusable_and_harm_nobody(rng):
    pixels = normal(rng, 4).astype(float)
    pixels[1, 3, 5] = np.nan
    stack = Stack.of("bias", pixels)
    assert np.argwhere(stack.unusable).tolist() == [[3, 5]]
    assert np.isfinite(combine(stack).mean).all()
