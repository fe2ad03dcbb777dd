"""Loci weighed by cumulants against the same loci fitted to the image."""

from dataclasses import replace
from math import comb

import numpy as np
import pytest

from jitterkit.estimators.compressed import CLOSE, ORDERS, CompressedLikelihood, _cumulant
from jitterkit.estimators.shape import CumulantStep
from jitterkit.loci import Ellipse, Linear, Mvn, PartialShm, Shaped, Shm, locus_class
from jitterkit.loci.cumulants import form_cumulants
from jitterkit.refit import Status, choose, fit_best_locus, fit_locus, locus_fit, weigh
from jitterkit.refit.evidence import log_evidence
from jitterkit.refit.fit import fit_and_allow

FRAMES = [
    (Linear.of(0.3, 30.0), 3e6),
    (Shm.of(0.4, 100.0), 1e6),
    (Mvn.of(0.08, 0.06, 20.0), 3e6),
    (Ellipse.of(0.2, 0.12, 70.0), 1e6),
    pytest.param(Linear.of(0.6, 60.0), 3e6, marks=pytest.mark.slow),
    pytest.param(Mvn.of(0.25, 0.2, 20.0), 3e5, marks=pytest.mark.slow),
    pytest.param(Shm.of(0.9, 10.0), 3e5, marks=pytest.mark.slow),
]


def compressed(bench, data):
    """The fit of a normal, what cumulants tell, and the names of the aberrations."""
    normal, otf = fit_and_allow(data, bench.optics, bench.near())[:2]
    step = CumulantStep.of(normal.parameters, normal.names, otf, data, ORDERS)
    return replace(normal, locus="mvn"), CompressedLikelihood.of(step, normal.covariance), otf.names


@pytest.mark.parametrize(("locus", "flux"), FRAMES)
def test_gain_and_evidence_are_those_of_fits_to_the_image_within_what_is_left_out(bench, rng, locus, flux):
    data = bench.draw(bench.truth(locus, flux=flux), rng)
    normal, likelihood, aberrations = compressed(bench, data)
    for name in ("linear", "shm", "ellipse"):
        told = likelihood.fit(locus_class(name))
        full = fit_locus(name, data, bench.optics, normal.parameters, normal.moments()[0])
        gain = (normal.objective - full.objective) / 2
        if told.left_out > max(1.0, 0.1 * abs(gain)):  # no more than a hint
            assert told.gain == pytest.approx(gain, rel=0.5)
            continue
        assert abs(told.gain - gain) < max(told.left_out, 0.05)
        if told.left_out < CLOSE:
            as_fit = weigh.as_fit(normal, name, told, aberrations)
            assert log_evidence(as_fit) == pytest.approx(log_evidence(full), abs=0.15)
            off = as_fit.of_scene("separation") - full.of_scene("separation")
            assert abs(off) < 0.02 * full.error("separation")
            assert as_fit.error("separation") == pytest.approx(full.error("separation"), rel=0.01)
            away = as_fit.parameters.aberrations - full.parameters.aberrations
            assert np.all(np.abs(away) < 0.03 * np.array([full.error(mode) for mode in aberrations]))


def test_what_is_no_maximum_has_no_fit_by_cumulants(bench, rng):
    data = bench.draw(bench.truth(Shm.of(0.4, 100.0), flux=1e6), rng)
    _, likelihood, _ = compressed(bench, data)
    assert likelihood.fit(Shaped) is not None
    values, vectors = np.linalg.eigh(likelihood.curvature)
    for lowered in (values - 1.001 * values[-1], np.where(values == values[0], -values, values)):
        bent = replace(likelihood, curvature=(vectors * lowered) @ vectors.T)
        assert all(bent.fit(locus_class(name)) is None for name in ("ellipse", "linear", "shm", "shaped"))


@pytest.mark.slow
def test_a_shape_is_determined_as_by_a_fit(bench, rng):
    data = bench.draw(bench.truth(Shm.of(0.35, 30.0)), rng)
    normal, likelihood, _ = compressed(bench, data)
    told = likelihood.fit(Shaped)
    assert told.left_out < 1
    full = fit_locus("shaped", data, bench.optics, normal.parameters, normal.moments()[0])
    error = full.error("shaped_kurtosis")
    pulled = 1 - error**2 / 4  # by the regularizing prior of 2 on the fit's
    kurtosis = float(told.locus.coords[3]) * pulled
    assert kurtosis == pytest.approx(float(full.parameters.locus.coords[3]), abs=0.1 * error)


@pytest.mark.parametrize("power", [2, 3])
def test_cumulants_of_a_form_are_its_power_and_their_slope_its_derivative(rng, power):
    moments, (fx, fy) = np.array([0.5, -0.2, 0.3]), rng.normal(size=2)
    own, slope = form_cumulants(moments, power)
    terms = [comb(2 * power, k) * fx ** (2 * power - k) * fy**k for k in range(2 * power + 1)]
    form = moments @ [fx**2, 2 * fx * fy, fy**2]
    assert terms @ own == pytest.approx(form**power)
    for n, change in enumerate(1e-6 * np.eye(3)):
        difference = form_cumulants(moments + change, power)[0] - form_cumulants(moments - change, power)[0]
        np.testing.assert_allclose(slope[:, n], difference / 2e-6, atol=1e-8)


@pytest.mark.parametrize(
    ("locus", "fourth", "sixth"),
    [
        (Linear.of(1.0), -6 / 5, 48 / 7),  # of a uniform density
        (Shm.of(1.0), -3 / 2, 10.0),  # of an arcsine law
        (Ellipse.of(1.0, 0.5), -3 / 2, 10.0),
        (Shaped.of(1.0, kurtosis=-6 / 5), -6 / 5, 48 / 7),
        (Shaped.of(1.0, kurtosis=3.0), 3.0, 30.0),  # of Laplace's law
    ],
)
def test_a_locus_has_the_cumulants_of_its_law_and_of_its_transfer_function(locus, fourth, sixth):
    assert _cumulant(locus, 4)[0] == pytest.approx(fourth)
    assert _cumulant(locus, 6)[0] == pytest.approx(sixth)
    w = 0.05  # square of a frequency, in radians for a standard deviation
    frequency = np.sqrt(w / locus.moments()[0]) / (2 * np.pi)
    series = -w / 2 + fourth * w**2 / 24 - sixth * w**3 / 720
    logarithm = float(np.log(np.asarray(locus.transfer(frequency, 0.0)).real))
    # the eighth cumulants of these laws are 45 to 630
    assert logarithm == pytest.approx(series, abs=630 * w**4 / 40320)


@pytest.mark.parametrize("kurtosis", [-1.0, 2.0])
def test_the_slope_of_a_cumulant_is_its_derivative(kurtosis):
    (low, _), (high, _) = (_cumulant(Shaped.of(0.3, kurtosis=kurtosis + by), 6) for by in (-1e-6, 1e-6))
    _, slope = _cumulant(Shaped.of(0.3, kurtosis=kurtosis), 6)
    np.testing.assert_allclose(slope, [0, 0, 0, (high - low) / 2e-6], rtol=1e-6)


@pytest.mark.parametrize(
    "locus",
    [
        Linear.of(0.5, 30.0),
        Mvn.of(0.15, 0.1, 60.0),
        pytest.param(Ellipse.of(0.35, 0.25, 120.0), marks=pytest.mark.slow),
        pytest.param(Shm.of(0.9, 75.0), marks=pytest.mark.slow),
    ],
)
def test_the_choice_is_that_of_fits_to_the_image(bench, rng, monkeypatch, locus):
    data = bench.draw(bench.truth(locus), rng)

    def chosen():
        return fit_best_locus(data, bench.optics, bench.near(), np.asarray(locus.moments()))

    quick = chosen()
    monkeypatch.setattr(choose.CompressedLikelihood, "of", lambda *_: None)
    whole = chosen()
    assert quick.locus == whole.locus
    # of a normal but for how likely the kurtosis, which cumulants tell a little better, makes another shape
    off = 0.01 * (whole.locus == "mvn")
    np.testing.assert_allclose(np.diag(quick.covariance), np.diag(whole.covariance), rtol=off)
    assert {one.locus for one in quick.candidates} == {one.locus for one in whole.candidates}
    assert quick.locus_weight == pytest.approx(whole.locus_weight, abs=0.03)  # 0.1 in ln Z at even odds
    assert quick.shape == pytest.approx(whole.shape, abs=0.1 * whole.shape_err)


def test_what_a_held_moment_or_another_kind_of_locus_needs_is_a_fit(bench, rng):
    data = bench.draw(bench.truth(Mvn.of(0.2, 0.1, 30.0)), rng)
    normal, likelihood, _ = compressed(bench, data)
    assert likelihood.fit(PartialShm) is None
    names = tuple(name for name in normal.names if name != "mvn_xy")
    step = CumulantStep(normal.parameters, names, likelihood.score, likelihood.curvature)
    assert CompressedLikelihood.of(step) is None


def test_a_normal_that_has_not_settled_determines_nothing_of_the_others(bench, rng, monkeypatch):
    """Its expansion is not about a maximum: the candidates are fitted."""
    locus = Linear.of(0.5, 30.0)
    data, fit = bench.draw(bench.truth(locus, flux=1e7), rng), locus_fit.fit_and_allow

    def unsettled(data, optics, start, *rest):
        result, otf, data = fit(data, optics, start, *rest)
        normal = isinstance(start.locus, Mvn)
        return (replace(result, status=Status.NOT_CONVERGED) if normal else result), otf, data

    monkeypatch.setattr(locus_fit, "fit_and_allow", unsettled)
    result = fit_best_locus(data, bench.optics, bench.near(), np.asarray(locus.moments()))
    assert result.status is Status.OK
    assert result.locus != "mvn"
