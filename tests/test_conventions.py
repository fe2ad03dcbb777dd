import numpy as np
import pytest

from jitterkit.conventions import (
    ARCSEC,
    FWHM_PER_SIGMA,
    axis_angle,
    direction_angle,
    offsets,
)


@pytest.mark.parametrize("n", [1, 4, 5])
def test_pixel_offsets_are_antisymmetric_about_the_middle_of_the_row(n):
    row = offsets(n, 0.375)
    assert np.array_equal(row, -row[::-1])
    assert np.allclose(np.diff(row), 0.375, rtol=1e-15)


def test_an_arcsecond_is_a_1296000th_of_a_turn():
    turn = ARCSEC * 1_296_000
    assert turn == pytest.approx(2 * np.pi, rel=1e-15)


def test_a_gaussian_falls_to_half_at_half_its_fwhm():
    assert np.exp(-0.5 * (FWHM_PER_SIGMA / 2) ** 2) == pytest.approx(0.5, rel=1e-15)


@pytest.mark.parametrize(
    ("given", "axis", "direction"),
    [
        (0.0, 0.0, 0.0),
        (180.0, 0.0, 180.0),
        (-90.0, 90.0, 270.0),
        (359.0, 179.0, 359.0),
        (360.0, 0.0, 0.0),
        (-1e-20, 0.0, 0.0),
    ],
)
def test_angles_fold_into_half_open_intervals(given, axis, direction):
    assert axis_angle(given) == axis
    assert direction_angle(given) == direction
