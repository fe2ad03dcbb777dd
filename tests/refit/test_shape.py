"""The shape of a blur beside everything else that a frame is fitted with."""

import numpy as np
import pytest
from refusals import refused

from jitterkit.errors import ErrorCode
from jitterkit.estimators.shape import CumulantStep
from jitterkit.forward import free_parameters
from jitterkit.likelihood import Data, normal_equations
from jitterkit.loci import Linear, Mvn, Shaped, Shm
from jitterkit.refit import FitOptions, fit_locus
from jitterkit.refit.fit import fit_and_allow


def normal_fit(bench, data, hold=()):
    """The normal that fits a frame, and the optics where the fit ended."""
    return fit_and_allow(data, bench.optics, bench.near(), options=FitOptions(hold, tolerance=1e-6))[:2]


def shape_of(fit, otf, data):
    return CumulantStep.of(fit.parameters, fit.names, otf, data).shape()


def test_the_step_is_that_of_a_shaped_locus_from_no_kurtosis(bench, rng):
    data = bench.draw(bench.truth(Shm.of(0.5, 30.0)), rng)
    normal, otf = normal_fit(bench, data)
    shaped = normal.parameters.with_locus(Shaped.near(normal.parameters.locus.moments()))
    names, free = free_parameters(shaped, otf)
    equations = normal_equations(shaped, otf, data, free)
    information, slot = np.asarray(equations.information), names.index("shaped_kurtosis")
    covariance = np.linalg.inv(information)
    step = CumulantStep.of(normal.parameters, normal.names, otf, data)
    shape, scale = step.shape(), np.sqrt(np.diag(information))
    # to the precision of 32-bit slopes
    kurtosis = covariance[slot] @ np.asarray(equations.score)
    assert shape.kurtosis == pytest.approx(kurtosis, abs=1e-4 * shape.error)
    assert shape.error == pytest.approx(np.sqrt(covariance[slot, slot]), rel=1e-5)
    unlike = (step.information_of_shaped() - information) / np.outer(scale, scale)
    np.testing.assert_allclose(unlike, 0, atol=1e-5)
    assert list(shape.response) == list(names)
    for name, slope in shape.response.items():
        position = names.index(name)
        expected = -covariance[slot, position] / covariance[slot, slot]
        assert slope == pytest.approx(expected, rel=1e-3, abs=1e-4 / scale[position])


@pytest.mark.parametrize(("locus", "kurtosis"), [(Linear.of(0.3, 20.0), -1.2), (Shm.of(0.3, 20.0), -1.5)])
def test_a_small_streak_has_the_kurtosis_of_its_density(locus, kurtosis, bench):
    data = Data(bench.image(bench.truth(locus)), 1.0)
    normal, otf = normal_fit(bench, data)
    # what the sixth cumulant adds is a share of (2 pi f L)²/100: at the cutoff of 1.1 cycles/arcsec 4 %, and
    # the step ends a tenth short where it leaves a normal of the wrong width
    found = shape_of(normal, otf, data).kurtosis
    assert found == pytest.approx(kurtosis, rel=0.15)


def test_the_response_foretells_the_bias_of_a_normal(bench):
    truth = bench.truth(Shm.of(0.2, 50.0))
    data = Data(bench.image(truth), 1.0)
    normal, otf = normal_fit(bench, data, ("background",))
    shape = shape_of(normal, otf, data)
    # to the fourth cumulant: the sixth adds a share of about (2 pi f L)²/50 at f = 1 cycle/arcsec, 3 %
    bias = normal.of_scene("separation") - 5.0
    assert bias == pytest.approx(shape.response["separation"] * shape.kurtosis, rel=0.05)
    assert abs(bias) > 1e-7


def test_beside_a_moment_that_is_held_no_shape_is_determined(bench, rng):
    data = bench.draw(bench.truth(Mvn.of(0.15)), rng)
    options = FitOptions(hold=("background", "mvn_xy"))
    normal, otf = fit_and_allow(data, bench.optics, bench.near(), None, options)[:2]
    with refused(ErrorCode.NOT_CONSTRAINED, "'mvn_xy'"):
        shape_of(normal, otf, data)


@pytest.mark.slow
def test_what_is_held_stays_held(bench, rng):
    data = bench.draw(bench.truth(Mvn.of(0.15)), rng)
    options = FitOptions(hold=("background", "separation"))
    normal, otf = fit_and_allow(data, bench.optics, bench.near(), None, options)[:2]
    assert "separation" not in shape_of(normal, otf, data).response
    assert fit_locus("mvn", data, bench.optics, bench.near(), np.zeros(3), None, options).locus == "mvn"
