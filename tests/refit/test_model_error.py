"""Fits that allow for errors of the model: honest where optics are wrong, unchanged where they are right."""

import numpy as np
import pytest

from jitterkit.forward import Parameters
from jitterkit.likelihood import Data
from jitterkit.loci import Mvn
from jitterkit.refit import FitOptions, Status, fit_frame
from jitterkit.scene import Binary, Star

AUTO = FitOptions(model_error="auto")


def test_a_good_frame_is_fitted_as_without(bench, optics, rng):
    data = bench.draw(bench.truth(Mvn.of(0.12, 0.06, 30.0)), rng)
    usual, auto = (fit_frame(data, optics, bench.near(), options=options) for options in (None, AUTO))
    assert auto.model_error == 0
    assert auto.flags == usual.flags
    np.testing.assert_array_equal(auto.covariance, usual.covariance)


def test_unknown_comas_end_in_an_honest_error(bench, optics, rng):
    hold, pulls = ("noll7", "noll8"), []
    for _ in range(14):
        data = bench.draw(bench.truth(Mvn.of(0.12, 0.06, 30.0), rng.normal(0, 2, 2), flux=1e7), rng)
        usual = fit_frame(data, optics, bench.near(), options=FitOptions(hold=hold))
        fit = fit_frame(data, optics, bench.near(), options=FitOptions(hold=hold, model_error="auto"))
        if usual.chi2_dof < 1.5:
            continue
        assert usual.status is Status.POOR_FIT
        assert fit.status is Status.OK
        assert "model_error" in fit.flags
        own = np.sqrt(fit.error("separation") ** 2 - fit.model_part("separation") ** 2)
        assert own > usual.error("separation")  # the noise's own weights tell most (Gauss and Markov)
        pulls.append((fit.of_scene("separation") - 5.0) / fit.error("separation"))
    assert len(pulls) >= 10
    np.testing.assert_allclose(np.std(pulls), 1, atol=3.5 / np.sqrt(2 * len(pulls)))
    assert abs(np.mean(pulls)) < 3.5 / np.sqrt(len(pulls))


def test_a_pair_taken_for_a_star_stays_poor(bench, optics, rng):
    data = bench.draw(bench.truth(Mvn.of(0.12, 0.06, 30.0)), rng)
    (x, _), (y, _), (flux, _) = Binary(5.0, 140.0, 0.3, -0.2, 3e6, 3.0).sources()
    start = Parameters(Star(x, y, flux), Mvn.of(0.1), np.zeros(2))
    assert fit_frame(data, optics, start, options=AUTO).status is Status.POOR_FIT


def test_a_given_error_is_reported(bench, optics, rng):
    data = bench.draw(bench.truth(Mvn.of(0.12, 0.06, 30.0)), rng)
    fit = fit_frame(data, optics, bench.near(), options=FitOptions(model_error=0.02))
    assert fit.model_error == pytest.approx(0.02, rel=0.05)  # of the light that the fit before found
    assert fit.error("separation") > fit_frame(data, optics, bench.near()).error("separation")
    assert isinstance(data, Data)
    assert data.model_variance is None
