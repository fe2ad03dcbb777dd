"""The mean star, and a round core under a line."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import j0

from jitterkit.starfield.core import fit_round_core, moffat_transfer
from jitterkit.starfield.detect import find_stars
from jitterkit.starfield.moments import adaptive_moments
from jitterkit.starfield.psf import Psf, field_psf, stack_psf


def test_the_mean_star_is_the_star_within_its_errors(sharp, star):
    psf = field_psf(sharp[0])
    truth = star(0, 0, half=psf.stamp.shape[0] // 2)
    pulls = (psf.stamp - truth / truth.sum()) / psf.error
    assert psf.stars > 90
    # the backgrounds of the boxes are errors that pixels share; without them 1
    assert np.std(pulls) < 1.5
    assert np.abs(psf.stamp - truth / truth.sum()).max() < 0.01 * truth.max()


def test_pixels_that_a_star_lacks_are_filled_from_the_others(sharp):
    stars = find_stars(sharp[0])
    moments = adaptive_moments(stars)
    whole = stack_psf(stars, moments)
    used = stars.used.copy()
    used[::2, :8] = False
    stars.electrons[::2, :8] = 1e6
    holed = stack_psf(replace(stars, used=used), moments)
    np.testing.assert_allclose(holed.stamp, whole.stamp, atol=1e-3 * whole.stamp.max())
    stars.electrons[::2, :8] = 0.0


@pytest.mark.parametrize("beta", [2.5, 3.0, 4.765])
def test_moffats_transfer_function_is_the_hankel_transform_of_its_profile(beta):
    alpha = 3.0 / 2 / np.sqrt(2 ** (1 / beta) - 1)
    for f in (0.02, 0.1, 0.3):

        def integrand(r, f=f):
            return r * (1 + r * r / alpha**2) ** -beta * j0(2 * np.pi * f * r)

        # it stops at 400 pixels, beyond which (r/a)^(2 - 2 beta) = 1e-6 is left at the least beta
        value = 2 * (beta - 1) / alpha**2 * quad(integrand, 0, 400, limit=2000)[0]
        assert moffat_transfer(np.array(f), 3.0, beta) == pytest.approx(value, abs=2e-6)


@pytest.mark.parametrize(("length", "angle"), [(2.0, 20.0), (4.0, 110.0), (6.0, 65.0)])
def test_a_round_core_under_a_line_gives_the_lines_length(star, length, angle):
    u = length * np.cos(np.radians(angle)), length * np.sin(np.radians(angle))
    image = star(0.0, 0.0, *u, half=20)
    psf = Psf(image, np.full(image.shape, 1e-4), np.zeros(3), np.eye(3), 1)
    start = np.array([2.2 + u[0] ** 2 / 12, u[0] * u[1] / 12, 2.2 + u[1] ** 2 / 12])
    core = fit_round_core(psf, start)
    found = core.line.describe()
    # three nodes a pixel and what aliases at FWHM 3 (transfer 3e-4 at Nyquist)
    assert found["length"] == pytest.approx(length, rel=5e-3)
    assert found["angle"] == pytest.approx(angle, abs=0.1)
    assert core.fwhm == pytest.approx(3.0, rel=0.01)
    assert core.beta == pytest.approx(3.0, rel=0.05)


def test_pixels_that_no_star_shows_do_not_count(star):
    image = star(0.0, 0.0, 4.0, 0.0, half=20)
    error = np.full(image.shape, 1e-4)
    image[:, :6], error[:, :6] = 0.01, 0.0  # a tenth of the peak, under a neighbour
    core = fit_round_core(Psf(image, error, np.zeros(3), np.eye(3), 1), np.array([3.5, 0.0, 2.2]))
    assert core.line.describe()["length"] == pytest.approx(4.0, rel=5e-3)
    assert core.misfit.chi2_dof < 1
