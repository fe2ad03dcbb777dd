import numpy as np
import pytest
from refusals import refused

from jitterkit.errors import ErrorCode
from jitterkit.optics import DEFAULT_PAD, Grid, expand, grid_for, lines, obstructed_circle


def test_the_crop_takes_the_pixel_centres_out_of_the_fine_array():
    grid = Grid((3, 5), 0.6, pad=2, refine=3)
    fine = np.arange(np.prod(grid.fine_shape)).reshape(grid.fine_shape)
    frame = grid.crop(fine)
    assert frame.shape == (3, 5)
    assert frame[0, 0] == fine[6, 6]
    assert frame[2, 4] == fine[12, 18]


def test_the_centre_is_the_frames_middle_seen_from_the_first_fine_sample():
    grid = Grid((4, 5), 0.6, pad=2, refine=3)
    # Pixel (i, j) is the fine sample 3 (2 + i), 0.2 arcsec apart; the middle pixel is 1.5 and 2.
    assert grid.centre == pytest.approx((0.2 * 3 * 3.5, 0.2 * 3 * 4.0), rel=1e-15)
    assert grid.pitch == pytest.approx(0.2, rel=1e-15)


def test_frequencies_are_in_cycles_per_arcsec_up_to_the_fine_nyquist():
    grid = Grid((16, 16), 0.375, pad=0)
    fy, fx = grid.frequencies
    assert fy.shape == (16, 1)
    assert fx.shape == (1, 9)
    assert np.abs(fy).max() == fx.max() == pytest.approx(4 / 3, rel=1e-15) == grid.nyquist
    assert fx[0, 1] == pytest.approx(1 / (16 * 0.375), rel=1e-15)


def test_the_fine_array_is_at_least_the_padded_frame():
    grid = Grid((127, 61), 0.375)
    assert all(m >= n + 2 * DEFAULT_PAD for m, n in zip(grid.fine_shape, grid.shape, strict=True))


def test_light_of_a_star_at_the_edge_of_undersampled_pixels_does_not_return_at_the_other():
    """Five samples a pixel: with 64 samples of padding, up to 4e-7 of the light in a pixel came back."""
    pupil, spectrum, shape, edge = obstructed_circle(0.125, samples=512), lines(575.0), (8, 48), 44.0
    images = []
    for pad in (None, 64):
        grid = grid_for(pupil, spectrum, shape, 2.0, pad)
        fy, fx = grid.frequencies
        y, x = grid.centre
        shifted = np.asarray(expand(pupil, spectrum, grid, derivatives=False).value)
        shifted = shifted * np.exp(-2j * np.pi * (fy * y + fx * (x + edge)))
        shifted = shifted * np.sinc(2 * fx) * np.sinc(2 * fy)
        images.append(grid.crop(np.fft.irfft2(shifted, s=grid.fine_shape)) * grid.refine**2)
    assert grid.refine == 5
    np.testing.assert_allclose(images[0], images[1], rtol=1e-3, atol=1e-9)


@pytest.mark.parametrize(
    ("arguments", "code", "values"),
    [
        (((0, 4), 0.1), ErrorCode.WRONG_SHAPE, ((0, 4),)),
        (((4,), 0.1), ErrorCode.WRONG_SHAPE, ((4,),)),
        (((4, 4), 0.0), ErrorCode.OUT_OF_RANGE, ("plate scale", 0.0)),
        (((4, 4), float("nan")), ErrorCode.OUT_OF_RANGE, ("plate scale", "nan")),
        (((4, 4), 0.1, -1), ErrorCode.OUT_OF_RANGE, ("pad", "-1 and 1")),
        (((4, 4), 0.1, 0, 0), ErrorCode.OUT_OF_RANGE, ("refine", "0 and 0")),
    ],
)
def test_impossible_grids_are_refused(arguments, code, values):
    with refused(code, *values):
        Grid(*arguments)
