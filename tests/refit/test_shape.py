"""One scoring step beyond the moments."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from jitterkit.forward import Parameters, free_parameters
from jitterkit.likelihood import Data, normal_equations
from jitterkit.loci import Linear, Mvn, PartialShm, Product, Shaped, Shm
from jitterkit.refit import FitOptions, fit_locus
from jitterkit.refit.fit import fit_and_expand
from jitterkit.refit.shape import Cumulants, lack_of_fit, measure_shape


def normal_fit(bench, data):
    """A normal fitted to a frame, and the optics where it ended."""
    fit, otf = fit_and_expand(data, bench.optics, bench.near())
    return replace(fit, locus="mvn"), otf


def test_the_step_is_that_of_a_shaped_blur_with_no_kurtosis(bench, rng):
    data = bench.draw(bench.truth(Shm.of(0.5, 30.0)), rng)
    normal, otf = normal_fit(bench, data)
    here = normal.parameters
    shaped = Parameters(
        here.scene, Shaped(jnp.append(here.locus.coords, 0.0)), here.aberrations, here.background
    )
    names, free = free_parameters(shaped, otf)
    equations = normal_equations(shaped, otf, data, free)
    step = np.linalg.solve(equations.information, equations.score)
    covariance = np.linalg.inv(equations.information)
    k = names.index("shaped_kurtosis")
    shape = measure_shape(normal, otf, data)
    # the fit ends within 1e-4 errors of the top, where the score of what is fitted is not quite zero
    assert shape.kurtosis == pytest.approx(step[k], abs=1e-2 * shape.error)
    assert shape.error == pytest.approx(np.sqrt(covariance[k, k]), rel=1e-6)


@pytest.mark.parametrize(("locus", "kurtosis"), [(Linear.of(0.3, 20.0), -1.2), (Shm.of(0.3, 20.0), -1.5)])
def test_a_small_streak_has_the_kurtosis_of_its_density(locus, kurtosis, bench):
    data = Data(bench.image(bench.truth(locus)), 1.0)
    normal, otf = normal_fit(bench, data)
    # what the sixth cumulant adds is a share of (2 pi f L)²/100: at the cutoff of 1.1 cycles/arcsec 4 %, and
    # the step ends a tenth short where it leaves a normal of the wrong width
    assert measure_shape(normal, otf, data).kurtosis == pytest.approx(kurtosis, rel=0.15)


def test_the_response_foretells_the_bias_of_a_normal(bench):
    truth = bench.truth(Shm.of(0.2, 50.0))
    data = Data(bench.image(truth), 1.0)
    normal, otf = normal_fit(bench, data)
    shape = measure_shape(normal, otf, data)
    # to the fourth cumulant: the sixth adds a share of about (2 pi f L)²/50 at f = 1 cycle/arcsec, 3 %
    bias = float(normal.parameters.binary.separation) - 5.0
    assert bias == pytest.approx(shape.response * shape.kurtosis, rel=0.05)
    assert abs(bias) > 1e-7


def test_a_right_locus_fits_and_a_lopsided_blur_does_not(bench, rng):
    truth = bench.truth(Shm.of(0.6, 30.0))
    chances = []
    for _ in range(24):
        data = bench.draw(truth, rng)
        fit, otf = fit_and_expand(data, bench.optics, bench.near(Shm.of(0.5, 25.0)))
        chances.append(lack_of_fit(fit, otf, data).chance)
    # 24 uniform numbers have a mean within 4/sqrt(12 * 24) of a half
    assert abs(np.mean(chances) - 0.5) < 0.24
    lopsided = bench.draw(bench.truth(PartialShm.of(0.8, 30.0, 0.7, 50.0), flux=3e7), rng)
    fit, otf = fit_and_expand(lopsided, bench.optics, bench.near(Shm.of(0.5, 25.0)))
    assert lack_of_fit(fit, otf, lopsided).chance < 1e-6


def test_cumulants_are_the_derivatives_of_the_log_of_a_transfer_function():
    # 1/6 of the third derivative of ln E exp(-2 pi i f x) is (-2 pi i)^3 kappa_3/6 = +i (2 pi)^3 kappa_3/6
    f = jnp.array([0.2, -0.3])
    third = Cumulants(jnp.zeros(9).at[0].set(1e-2)).transfer(f, 0 * f)
    np.testing.assert_allclose(np.angle(third), (2 * np.pi * np.asarray(f)) ** 3 * 1e-2 / 6, rtol=1e-9)
    # of a skewed path: the phase of its transfer function at low frequency
    skewed = PartialShm.of(0.5, 0.0, 0.5, 60.0)
    x = skewed.points(4096)[:, 0]
    low = np.angle(np.asarray(skewed.transfer(jnp.array([0.1]), jnp.array([0.0]))))[0]
    assert low == pytest.approx((2 * np.pi * 0.1) ** 3 * np.mean(x**3) / 6, rel=0.01)
    assert Product(skewed, Cumulants.near(None)).moments() == pytest.approx(np.asarray(skewed.moments()))


def test_what_is_held_stays_held(bench, rng):
    data = bench.draw(bench.truth(Mvn.of(0.15)), rng)
    options = FitOptions(hold=("background", "separation"))
    normal, otf = fit_and_expand(data, bench.optics, bench.near(), None, options)
    assert measure_shape(normal, otf, data).response == 0.0
    assert fit_locus("mvn", data, bench.optics, bench.near(), np.zeros(3), None, options).locus == "mvn"
