"""The shape of a blur beside everything else that a frame is fitted with."""

import numpy as np
import pytest

from jitterkit.estimators.shape import measure_shape
from jitterkit.forward import parameter_names
from jitterkit.likelihood import Data, normal_equations
from jitterkit.loci import Linear, Mvn, Shm
from jitterkit.refit import FitOptions, fit_locus
from jitterkit.refit.fit import fit_and_expand
from jitterkit.refit.lack_of_fit import WithCumulants


def normal_fit(bench, data):
    """The normal that fits a frame, and the optics where the fit ended."""
    fit, otf = fit_and_expand(data, bench.optics, bench.near(), options=FitOptions(tolerance=1e-6))
    return fit.parameters, otf


def test_the_step_is_that_of_fourth_cumulants_in_proportion_to_the_square_of_the_moments(bench, rng):
    data = bench.draw(bench.truth(Shm.of(0.5, 30.0)), rng)
    normal, otf = normal_fit(bench, data)
    wider = normal.with_locus(WithCumulants(normal.locus))
    names = parameter_names(wider, otf.names)
    free = tuple(i for i, name in enumerate(names) if name != "background")
    equations = normal_equations(wider, otf, data, free)
    sxx, sxy, syy = np.asarray(normal.locus.moments())
    # of an elliptical density of kurtosis k: kappa_ijkl = k (S_ij S_kl + S_ik S_jl + S_il S_jk)/3
    fourth = [sxx**2, sxx * sxy, (sxx * syy + 2 * sxy**2) / 3, sxy * syy, syy**2]
    turn = np.zeros((len(free) - 8, len(free)))
    first = names.index("cumulant30")
    others = [i for i in range(len(free)) if not first <= i < first + 9]
    turn[np.arange(len(others)), others] = 1.0
    turn[-1, first + 4 : first + 9] = fourth
    information = turn @ np.asarray(equations.information) @ turn.T
    step = np.linalg.solve(information, turn @ np.asarray(equations.score))
    shape = measure_shape(normal, otf, data, ("background",))
    # to the precision of 32-bit slopes
    assert shape.kurtosis == pytest.approx(step[-1], abs=1e-4 * shape.error)
    assert shape.error == pytest.approx(np.sqrt(np.linalg.inv(information)[-1, -1]), rel=1e-5)


@pytest.mark.parametrize(("locus", "kurtosis"), [(Linear.of(0.3, 20.0), -1.2), (Shm.of(0.3, 20.0), -1.5)])
def test_a_small_streak_has_the_kurtosis_of_its_density(locus, kurtosis, bench):
    data = Data(bench.image(bench.truth(locus)), 1.0)
    normal, otf = normal_fit(bench, data)
    # what the sixth cumulant adds is a share of (2 pi f L)²/100: at the cutoff of 1.1 cycles/arcsec 4 %, and
    # the step ends a tenth short where it leaves a normal of the wrong width
    found = measure_shape(normal, otf, data, ("background",)).kurtosis
    assert found == pytest.approx(kurtosis, rel=0.15)


def test_the_response_foretells_the_bias_of_a_normal(bench):
    truth = bench.truth(Shm.of(0.2, 50.0))
    data = Data(bench.image(truth), 1.0)
    normal, otf = normal_fit(bench, data)
    shape = measure_shape(normal, otf, data, ("background",))
    # to the fourth cumulant: the sixth adds a share of about (2 pi f L)²/50 at f = 1 cycle/arcsec, 3 %
    bias = float(normal.binary.separation) - 5.0
    assert bias == pytest.approx(shape.response["separation"] * shape.kurtosis, rel=0.05)
    assert abs(bias) > 1e-7


@pytest.mark.slow
def test_what_is_held_stays_held(bench, rng):
    data = bench.draw(bench.truth(Mvn.of(0.15)), rng)
    options = FitOptions(hold=("background", "separation"))
    normal, otf = fit_and_expand(data, bench.optics, bench.near(), None, options)
    assert "separation" not in measure_shape(normal.parameters, otf, data, options.hold).response
    assert fit_locus("mvn", data, bench.optics, bench.near(), np.zeros(3), None, options).locus == "mvn"
