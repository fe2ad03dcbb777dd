"""The folded matrix transform against the sum it stands for."""

import numpy as np
import pytest

from jitterkit.optics.focal import focal_field


def plain_sum(pupil, step, shape):
    """Every term of the Fourier sum, on grids symmetric about zero."""
    jy, jx = ((np.arange(n) - (n - 1) / 2) for n in pupil.shape[1:])
    ty, tx = ((np.arange(n) - (n - 1) / 2) for n in shape)
    rows = np.exp(-1j * step * np.outer(ty, jy))
    columns = np.exp(-1j * step * np.outer(jx, tx))
    return np.array([rows @ p @ columns for p in pupil])


@pytest.mark.parametrize("pupil_shape", [(8, 8), (7, 7), (6, 9)])
@pytest.mark.parametrize("focal_shape", [(5, 5), (4, 7), (2, 1)])
def test_the_focal_field_is_the_fourier_sum_for_odd_even_and_rectangular_grids(pupil_shape, focal_shape, rng):
    pupil = rng.normal(size=(2, *pupil_shape)) + 1j * rng.normal(size=(2, *pupil_shape))
    real, imaginary = np.asarray(focal_field(np.stack([pupil.real, pupil.imag]), 0.37, focal_shape))
    # Rounding of a sum of up to 64 terms of modulus about one.
    assert real + 1j * imaginary == pytest.approx(plain_sum(pupil, 0.37, focal_shape), abs=1e-13)


def test_a_uniform_pupil_gives_its_number_of_samples_on_the_axis():
    field = focal_field(np.stack([np.ones((1, 6, 4)), np.zeros((1, 6, 4))]), 0.2, (3, 5))
    assert np.asarray(field[:, 0, 1, 2]) == pytest.approx([24, 0], rel=1e-15)
