"""Whether an image wants more than the locus that was fitted."""

import jax.numpy as jnp
import numpy as np
import pytest
import scipy.stats

from jitterkit.estimators.shape import CumulantStep
from jitterkit.likelihood import Data
from jitterkit.loci import Mvn, PartialShm, Shm, Stable
from jitterkit.loci.cumulants import WithCumulants
from jitterkit.refit.fit import fit_and_allow


def lack_of_fit(fit, otf, data):
    return CumulantStep.of(fit.parameters, fit.names, otf, data).lack_of_fit()


def test_a_right_locus_fits_and_a_lopsided_blur_does_not(bench, rng):
    truth = bench.truth(Shm.of(0.6, 30.0))
    chances = []
    for _ in range(24):
        data = bench.draw(truth, rng)
        fit, otf = fit_and_allow(data, bench.optics, bench.near(Shm.of(0.5, 25.0)))[:2]
        chances.append(lack_of_fit(fit, otf, data).chance)
    # 24 uniform numbers have a mean within 4/sqrt(12 * 24) of a half
    assert abs(np.mean(chances) - 0.5) < 0.24
    lopsided = bench.draw(bench.truth(PartialShm.of(0.8, 30.0, 0.7, 50.0), flux=3e7), rng)
    fit, otf = fit_and_allow(lopsided, bench.optics, bench.near(Shm.of(0.5, 25.0)))[:2]
    assert lack_of_fit(fit, otf, lopsided).chance < 1e-6


@pytest.mark.parametrize("k", [1, 4, 6])
def test_without_noise_all_that_is_left_of_chi_squared_is_the_cumulants(bench, k):
    # of nine, of which a vibration has none of its own that are odd, and one that is even
    cumulants = np.zeros(9)
    cumulants[k] = 5e-5
    blur = WithCumulants(Shm.of(0.6, 30.0), cumulants=cumulants)
    data = Data(bench.image(bench.truth(blur, flux=3e7)), 2.4**2)
    fit, otf = fit_and_allow(data, bench.optics, bench.near(Shm.of(0.5, 25.0)))[:2]
    lack = lack_of_fit(fit, otf, data)
    # beyond first order in a cumulant that changes the spectrum by 1e-3 at most
    assert lack.chi2 == pytest.approx(fit.chi2, rel=0.01)
    assert lack.chance == pytest.approx(scipy.stats.chi2.sf(lack.chi2, 9))


def test_cumulants_are_the_derivatives_of_the_log_of_a_transfer_function():
    # 1/6 of the third derivative of ln E exp(-2 pi i f x) is (-2 pi i)^3 kappa_3/6 = +i (2 pi)^3 kappa_3/6
    f = jnp.array([0.2, -0.3])
    third = WithCumulants(Stable.of(), cumulants=[1e-2] + [0.0] * 8).transfer(f, 0 * f)
    np.testing.assert_allclose(np.angle(third), (2 * np.pi * np.asarray(f)) ** 3 * 1e-2 / 6, rtol=1e-9)
    # of a skewed path: the phase of its transfer function at low frequency
    skewed = PartialShm.of(0.5, 0.0, 0.5, 60.0)
    x = skewed.points(4096)[:, 0]
    low = np.angle(np.asarray(skewed.transfer(jnp.array([0.1]), jnp.array([0.0]))))[0]
    assert low == pytest.approx((2 * np.pi * 0.1) ** 3 * np.mean(x**3) / 6, rel=0.01)


def test_cumulants_are_those_of_a_cloud_of_points_in_any_direction(rng):
    # small, so that the fifth adds a share of 1e-2; cumulants of a sample by their definition
    points = 0.05 * rng.gamma(2.0, size=(40, 2)) @ np.array([[1.0, 0.4], [-0.2, 0.7]])
    points -= points.mean(axis=0)
    sxx, sxy, syy = (np.mean(points[:, i] * points[:, j]) for i, j in ((0, 0), (0, 1), (1, 1)))

    def moment(*axes):
        return np.mean(np.prod(points[:, axes], axis=1))

    pairs = {(0, 0): sxx, (0, 1): sxy, (1, 0): sxy, (1, 1): syy}
    third = [moment(*(0,) * (3 - k), *(1,) * k) for k in range(4)]
    fourth = []
    for k in range(5):
        a, b, c, d = (0,) * (4 - k) + (1,) * k
        gaussian = pairs[a, b] * pairs[c, d] + pairs[a, c] * pairs[b, d] + pairs[a, d] * pairs[b, c]
        fourth.append(moment(a, b, c, d) - gaussian)
    blur = WithCumulants(Mvn(jnp.array([sxx, sxy, syy])), cumulants=np.array(third + fourth))
    for fx, fy in ((0.3, 0.0), (0.0, 0.3), (0.2, -0.25), (-0.1, 0.2)):
        exact = np.mean(np.exp(-2j * np.pi * points @ [fx, fy]))
        found = complex(np.asarray(blur.transfer(jnp.array([fx]), jnp.array([fy])))[0])
        without = complex(np.asarray(blur.inner.transfer(jnp.array([fx]), jnp.array([fy])))[0])
        assert abs(found - exact) < 0.05 * abs(without - exact)


def test_cumulants_of_zero_leave_a_locus_as_it_is():
    skewed = PartialShm.of(0.5, 0.0, 0.5, 60.0)
    f = jnp.array([0.4])
    same = WithCumulants(skewed)
    np.testing.assert_array_equal(same.transfer(f, -f), skewed.transfer(f, -f))
    np.testing.assert_array_equal(same.moments(), skewed.moments())
    np.testing.assert_array_equal(same.points(64), skewed.points(64))
