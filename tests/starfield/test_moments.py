"""Adaptive moments: laws of the normal, an independent fit, and errors that mean something."""

import numpy as np
import pytest
from refusals import refused
from scipy.optimize import least_squares

from jitterkit.errors import ErrorCode, UndeterminedError
from jitterkit.starfield.moments import Moments, Stars, adaptive_moments
from jitterkit.starfield.psf import common_moments

GRID = np.arange(-16, 17)


def normal(x, y, sxx, sxy, syy):
    """A normal star of unit flux, sampled at the middle of pixels."""
    dx, dy = GRID - x, (GRID - y)[:, None]
    det = sxx * syy - sxy**2
    return np.exp(-0.5 * (syy * dx**2 - 2 * sxy * dx * dy + sxx * dy**2) / det) / (2 * np.pi * np.sqrt(det))


def as_stars(images, sky=1.0, response=1.0):
    images = np.asarray(images, float)
    flat = np.zeros(len(images))
    even = np.ones(images.shape)
    return Stars(flat, flat, images, sky * even, response * even, even > 0, (512, 512))


def test_a_normal_star_gives_its_own_covariance_and_flux():
    truth = np.array([[2.0, 0.0, 2.0], [4.0, 0.7, 2.0], [1.6, -0.8, 3.9]])
    positions = np.array([[0.0, 0.0], [0.3, -0.4], [-0.5, 0.2]])
    measured = adaptive_moments(
        as_stars([9e4 * normal(*p, *s) for p, s in zip(positions, truth, strict=True)])
    )
    assert measured.sound.all()
    # the narrowest star, under its weight, has variance 0.67: its sum over pixels is wrong by
    # exp(-2 pi² 0.67) = 2e-6, its second moment by 4 pi² 0.67² times that
    np.testing.assert_allclose(measured.moments, truth, atol=4e-5)
    np.testing.assert_allclose(measured.centre, positions, atol=4e-5)
    np.testing.assert_allclose(measured.flux, 9e4, rtol=4e-5)


def test_they_are_those_of_the_best_normal_in_least_squares(star):
    image = 1e4 * star(0.2, -0.3, 3.0, 2.0, half=16)

    def left(p):
        return (p[0] * normal(*p[1:]) - image).ravel()

    fit = least_squares(left, [1e4, 0, 0, 3, 0.5, 3], xtol=1e-14, ftol=1e-14, gtol=1e-14, x_scale="jac")
    measured = adaptive_moments(as_stars([image]))
    np.testing.assert_allclose(measured.moments[0], fit.x[3:], rtol=1e-6)
    np.testing.assert_allclose(measured.centre[0], fit.x[1:3], atol=1e-6)


def test_a_pixel_that_is_not_used_counts_as_background(star):
    image = 2e4 * star(0.1, 0.3, 3.0, 2.0, half=16)
    stars = as_stars([image, image])
    stars.used[:, 4, 5] = False
    stars.electrons[0, 4, 5], stars.electrons[1, 4, 5] = 0.0, 1e6
    measured = adaptive_moments(stars)
    np.testing.assert_array_equal(measured.moments[1], measured.moments[0])


def test_x_and_y_change_places_in_the_errors_too(star):
    image = 2e4 * star(0.45, -0.4, 3.0, 2.0, half=16)
    upright, turned = (adaptive_moments(as_stars([one], 50.0)).covariance[0] for one in (image, image.T))
    np.testing.assert_allclose(turned, upright[::-1, ::-1], rtol=1e-6)


@pytest.mark.parametrize("response", [1.0, 0.3])
def test_errors_are_the_scatter_of_noisy_draws(response, star, rng):
    image, draws = 2e4 * star(0.1, 0.3, 3.0, 2.0, half=16), 400
    noisy = rng.poisson(np.tile(response * (image + 50.0), (draws, 1, 1))) / response - 50.0
    measured = adaptive_moments(as_stars(noisy, 50.0 / response, response))
    truth = adaptive_moments(as_stars([image])).moments[0]
    pulls = (measured.moments - truth) / np.sqrt(np.einsum("nii->ni", measured.covariance))
    # 400 draws: a mean scatters by 0.05, a standard deviation by 0.035; four times that
    np.testing.assert_allclose(pulls.mean(0), 0, atol=0.2)
    np.testing.assert_allclose(pulls.std(0), 1, atol=0.14)
    correlation = np.corrcoef(measured.moments.T)[0, 1]
    covariance = measured.covariance.mean(0)
    assert correlation == pytest.approx(
        covariance[0, 1] / np.sqrt(covariance[0, 0] * covariance[1, 1]), abs=0.2
    )


def test_noise_alone_is_not_sound(rng):
    assert adaptive_moments(as_stars(rng.normal(0, 1, (40, 33, 33)))).sound.mean() < 0.5
    assert not adaptive_moments(as_stars(np.zeros((2, 33, 33)))).sound.any()


def made(values, noise):
    """Moments that scatter with a given noise."""
    n = len(values)
    return Moments(np.zeros((n, 2)), values, noise, np.ones(n), np.ones(n, bool))


def test_the_mean_of_a_field_is_honest_and_knows_its_scatter(rng):
    pulls, found = [], []
    scatter = np.array([[0.02, 0.01, 0.0], [0.01, 0.02, 0.0], [0.0, 0.0, 0.04]])
    for _ in range(200):
        noise = np.einsum("n,ij->nij", rng.uniform(0.001, 0.1, 60), np.eye(3))
        values = np.stack([rng.multivariate_normal([3, 1, 2], scatter + c) for c in noise])
        common = common_moments(made(values, noise))
        pulls.append((common.moments - [3, 1, 2]) / np.sqrt(np.diag(common.covariance)))
        found.append(common.scatter)
    np.testing.assert_allclose(np.mean(pulls, 0), 0, atol=4 / np.sqrt(200))
    # 4 x 5 %, and the scatter's own uncertainty (60 stars) makes tails
    np.testing.assert_allclose(np.std(pulls, 0), 1, atol=0.25)
    np.testing.assert_allclose(np.mean(found, 0), scatter, atol=0.004)


def test_a_blend_among_the_stars_is_left_out(rng):
    noise = np.tile(0.01 * np.eye(3), (30, 1, 1))
    values = rng.normal([3.0, 1.0, 2.0], 0.1, (30, 3))
    values[4] += [3.0, 0.0, 0.0]
    common = common_moments(made(values, noise))
    assert np.flatnonzero(~common.used).tolist() == [4]
    assert common.dof == 3 * 28
    assert common.chi2 == pytest.approx(common.dof, abs=4 * np.sqrt(2 * common.dof))


def test_two_stars_are_averaged_with_the_noise_alone():
    common = common_moments(made(np.array([[3.0, 1.0, 2.0], [4.0, 0.0, 2.0]]), np.tile(np.eye(3), (2, 1, 1))))
    np.testing.assert_allclose(common.moments, [3.5, 0.5, 2.0])
    np.testing.assert_allclose(common.covariance, np.eye(3) / 2)


def test_a_field_without_a_sound_star_is_refused():
    nothing = made(np.ones((2, 3)), np.tile(np.eye(3), (2, 1, 1)))._replace(sound=np.zeros(2, bool))
    with refused(ErrorCode.TOO_FEW_STARS, error=UndeterminedError):
        common_moments(nothing)
