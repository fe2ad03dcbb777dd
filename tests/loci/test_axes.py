"""Second moments along and across an axis, against rotations of matrices and of samples."""

import numpy as np
import pytest

from jitterkit.loci import Mvn, axis_variances, covariance_on_axis, moments_on_axis, principal_axes

MOMENTS = np.array([0.03, 0.011, 0.014])
COVARIANCE = np.array([[4.0, 1.0, -0.5], [1.0, 2.0, 0.3], [-0.5, 0.3, 5.0]]) * 1e-6
ANGLES = (0.0, 17.0, 45.0, 118.0, -60.0)


def rotation(angle):
    """Columns: the axis at ``angle``, and the one 90 degrees on, in x and y."""
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    return np.array([[c, -s], [s, c]])


def matrix(moments):
    return np.array(moments)[[0, 1, 1, 2]].reshape(2, 2)


@pytest.mark.parametrize("angle", ANGLES)
def test_moments_on_an_axis_are_those_of_the_rotated_matrix(angle):
    own = rotation(angle).T @ matrix(MOMENTS) @ rotation(angle)
    assert moments_on_axis(MOMENTS, angle) == pytest.approx(own[[0, 0, 1], [0, 1, 1]], abs=1e-17)


@pytest.mark.parametrize("angle", ANGLES)
def test_their_covariance_is_that_of_rotated_matrices_drawn_at_random(angle, rng):
    n = 40000
    drawn = rng.multivariate_normal(MOMENTS, COVARIANCE, n)
    turned = rotation(angle).T @ drawn[:, [0, 1, 1, 2]].reshape(n, 2, 2) @ rotation(angle)
    sample, found = np.cov(turned[:, [0, 0, 1], [0, 1, 1]].T), covariance_on_axis(COVARIANCE, angle)
    # a sample covariance of normal variables scatters by sqrt((v_i v_j + c_ij²)/n)
    error = np.sqrt((np.outer(np.diag(found), np.diag(found)) + found**2) / n)
    assert np.abs(sample - found).max() < 5 * error.max()
    assert np.all(np.abs(sample - found) < 5 * error)


def test_the_opposite_angle_leads_back():
    assert moments_on_axis(moments_on_axis(MOMENTS, 17.0), -17.0) == pytest.approx(MOMENTS, abs=1e-17)
    there = covariance_on_axis(COVARIANCE, 17.0)
    np.testing.assert_allclose(covariance_on_axis(there, -17.0), COVARIANCE, atol=1e-20)


@pytest.mark.parametrize("moments", [MOMENTS, [0.02, -0.01, 0.03], [1e-4, 2e-4, -3e-4], [-1.0, 0.0, -2.0]])
def test_variances_along_the_principal_axes_are_eigenvalues_with_their_signs(moments):
    major, minor, angle = axis_variances(moments)
    assert (minor, major) == pytest.approx(np.linalg.eigvalsh(matrix(moments)), abs=1e-16)
    # on its own axes a matrix is diagonal, the greater eigenvalue first
    assert moments_on_axis(moments, angle) == pytest.approx([major, 0.0, minor], abs=1e-15)
    assert 0 <= angle < 180


def test_principal_sizes_are_roots_and_none_of_a_negative_variance():
    moments = np.asarray(Mvn.of(0.3, 0.1, 118.0).moments())
    assert principal_axes(moments) == pytest.approx((0.3, 0.1, 118.0), rel=1e-12)
    assert principal_axes([1e-4, 2e-4, -3e-4])[1] == 0.0
