"""The refit: unbiased, honest about its errors, and not to be fooled by its own start."""

import numpy as np
import pytest
from refusals import refused

from jitterkit.errors import ErrorCode
from jitterkit.forward import GRADIENT, Parameters, expected_image
from jitterkit.likelihood import Data
from jitterkit.linearisation import linearisation_error, relinearised_scoring
from jitterkit.loci import Linear, Mvn, Shm, Stable
from jitterkit.optics import flat_band, grid_for, obstructed_circle
from jitterkit.optics.system import OpticalSystem
from jitterkit.refit import FitOptions, Priors, Status, fit_frame, fit_locus
from jitterkit.refit.fit import convergence_error
from jitterkit.scene import Binary, Star
from jitterkit.scoring import fisher_scoring

SCENE = Binary(5.0, 140.0, 0.3, -0.2, 3e6, 3.0)


def test_pulls_of_every_parameter_are_standard(bench, optics, rng):
    truth = Parameters(SCENE, Mvn.of(0.12, 0.06, 30.0), [4.0, -3.0])
    expected = {"separation": 5.0, "theta": 140.0, "x": 0.3, "y": -0.2, "flux": 3e6, "contrast": 3.0}
    expected |= dict(zip(Mvn.names, np.asarray(truth.locus.coords), strict=True)) | {
        "noll7": 4.0,
        "noll8": -3.0,
        "background": 0.0,
        **dict.fromkeys(GRADIENT, 0.0),
    }
    pulls = []
    for _ in range(60):
        result = fit_frame(bench.draw(truth, rng), optics, bench.near(Mvn.of(0.1)))
        assert result.status is Status.OK
        assert "background" in result.names
        fitted = dict(zip(result.names, _values(result), strict=True))
        pulls.append([(fitted[n] - expected[n]) / result.error(n) for n in result.names])
    # means of 60 unit normals scatter by 0.13, standard deviations by 0.09; four times that, 14 parameters
    np.testing.assert_allclose(np.mean(pulls, axis=0), 0, atol=0.52)
    np.testing.assert_allclose(np.std(pulls, axis=0, ddof=1), 1, atol=0.37)


def test_the_gradient_of_a_sky_is_fitted_and_moves_nothing(bench, optics):
    """The sky is added to the image, pixel by pixel."""
    truth, shape = bench.truth(Mvn.of(0.12, 0.06, 30.0)), optics.nominal.grid.shape
    up, along = np.meshgrid(*(np.arange(n) * optics.nominal.grid.plate_scale for n in shape), indexing="ij")
    sky = 40.0 + 0.8 * (along - along.mean()) - 0.5 * (up - up.mean())
    results = [fit_frame(Data(bench.image(truth) + level, 4.0), optics, truth) for level in (40.0, sky)]
    flat, sloping = ({n: result.error(n) for n in result.names} for result in results)
    for name, value, other in zip(results[1].names, *map(_values, results), strict=True):
        slope = {"background_x": 0.8, "background_y": -0.5}.get(name, 0.0)
        assert other - value == pytest.approx(slope, abs=2e-3 * sloping[name]), name
    assert sloping["separation"] == pytest.approx(flat["separation"], rel=0.01)


def _values(result):
    p = result.parameters
    values = {n: float(getattr(p.scene, n)) for n in ("separation", "theta", "x", "y", "flux", "contrast")}
    values |= dict(zip(p.locus.names, np.asarray(p.locus.coords), strict=True))
    values |= {"noll7": float(p.aberrations[0]), "noll8": float(p.aberrations[1])}
    values |= {"background": float(p.background), **dict(zip(GRADIENT, map(float, p.gradient), strict=True))}
    return [values[n] for n in result.names]


def test_a_tight_tolerance_makes_the_optics_as_exact(bench, optics):
    truth = bench.truth(Mvn.of(0.1, 0.05, 20.0), (4.0, -3.0), flux=1e8)
    data, away = Data(bench.image(truth), 4.0), np.array([1.0, 1.0])
    away *= np.sqrt(0.09 / 3 / np.sqrt(1e8)) / optics.phase(away)  # so far that a usual fit may just leave it
    otf, off = optics.otf(truth.aberrations + away), []
    assert linearisation_error(optics, truth, otf) == pytest.approx(0.09)
    for tolerance in (1e-4, 1e-5, 1e-6):
        result = fit_frame(data, optics, truth, otf, FitOptions(tolerance=tolerance))
        off.append(abs(result.of_scene("separation") - 5.0) / result.error("separation"))
        assert off[-1] < convergence_error(tolerance, truth.locus, aberrations=True)
    assert off[0] > 1e-5  # there is something to see
    assert off[2] < 0.1 * off[0]


def test_faint_frames_settle_from_a_wavefront_far_off(bench, optics, rng):
    # 40 nm rms of coma, unknown: in noise the maxima of successive expansions overshoot one another
    for flux in (3e4, 3e5):
        for _ in range(4):
            truth = bench.truth(Mvn.of(0.2, 0.1, 30.0), rng.normal(0, 28, 2), flux=flux)
            data, options = bench.draw(truth, rng), FitOptions(("background",), tolerance=1e-6)
            far = Parameters(truth.scene, Mvn.of(0.1), np.zeros(2))
            cold, warm = (fit_frame(data, optics, start, options=options) for start in (far, truth))
            assert cold.status is warm.status is Status.OK
            difference = cold.of_scene("separation") - warm.of_scene("separation")
            left = convergence_error(1e-6, truth.locus, aberrations=True)
            assert abs(difference) < 2 * left * warm.error("separation")


@pytest.mark.parametrize(
    "locus", [Stable.of(), Linear.of(0.5, 20.0), Shm.of(0.5, 20.0), Mvn.of(0.1, 0.05, 20.0)]
)
def test_the_expected_image_gives_back_the_truth(bench, locus, optics):
    truth = Parameters(SCENE, locus, [4.0, -3.0])
    data = Data(bench.image(truth), 4.0)
    result = fit_locus(
        type(locus).__name__.lower(), data, optics, bench.near(locus), np.asarray(locus.moments()) * 1.2
    )
    assert result.status is Status.OK
    # what the expansion of the optics may leave, a tenth of a sigma of the image, the separation hardly shows
    assert float(result.parameters.scene.separation) == pytest.approx(
        5.0, abs=1e-3 * result.error("separation")
    )


def test_without_priors_the_error_is_the_bound(bench, optics, rng):
    truth = Parameters(SCENE, Mvn.of(0.1), [0.0, 0.0])
    result = fit_frame(bench.draw(truth, rng), optics, bench.near(Mvn.of(0.1)))
    np.testing.assert_allclose(result.crlb, np.sqrt(np.diag(result.covariance)), rtol=1e-9)


def test_the_brighter_star_is_a_whatever_the_start_said(bench, optics, rng):
    truth = Parameters(SCENE, Stable.of(), [0.0, 0.0])
    data = bench.draw(truth, rng)
    swapped = Parameters(Binary(-5.0, 140.0, 0.3, -0.2, 3e6, 1.0), Stable.of(), [0.0, 0.0])
    exchanged = Parameters(Binary(5.0, 320.0, 0.3, -0.2, 3e6, 0.4), Stable.of(), [0.0, 0.0])
    for start in (swapped, exchanged):
        scene = fit_frame(data, optics, start).parameters.scene
        assert float(scene.contrast) > 1
        assert float(scene.separation) > 0
        assert float(scene.theta) == pytest.approx(140.0, abs=0.1)


def test_a_prior_can_be_put_on_anything(bench, optics, rng):
    truth = Parameters(SCENE, Mvn.of(0.1), [4.0, -3.0])
    data = bench.draw(truth, rng)
    options = FitOptions(priors=Priors({"contrast": (3.0, 1e-6), "noll7": (4.0, 0.1)}))
    result = fit_frame(data, optics, bench.near(Mvn.of(0.1)), options=options)
    assert float(result.parameters.scene.contrast) == pytest.approx(3.0, abs=1e-5)
    assert result.error("noll7") < 0.1


def test_a_prior_on_nothing_is_refused(bench, optics, rng):
    truth = Parameters(SCENE, Stable.of(), [0.0, 0.0])
    data = bench.draw(truth, rng)
    with refused(ErrorCode.UNKNOWN_NAME, "'jitter'"):
        fit_frame(data, optics, truth, options=FitOptions(priors=Priors({"jitter": (0.0, 1.0)})))
    with refused(ErrorCode.OUT_OF_RANGE, " x ", 0.0, -1.0):
        Priors({"x": (0.0, -1.0)})


def test_a_frame_without_pixels_is_a_status(bench, optics):
    empty = Data(np.zeros((48, 44)), 1.0, np.zeros((48, 44), bool))
    result = fit_frame(empty, optics, bench.near(Stable.of()))
    assert (result.status, result.reason) == (Status.NO_DATA, "no_data")
    assert np.isnan(result.chi2_dof)


def test_a_wrong_model_is_called_poor(bench, optics, rng):
    truth = Parameters(SCENE, Mvn.of(0.3), [0.0, 0.0])
    result = fit_locus("stable", bench.draw(truth, rng), optics, bench.near(Stable.of()), np.zeros(3))
    assert (result.status, result.reason) == (Status.POOR_FIT, "model_mismatch")
    assert f"{result.chi2_dof:.4g}" in result.message


def test_sky_is_fitted(bench, optics, rng):
    truth = Parameters(SCENE, Stable.of(), [0.0, 0.0], 50.0)
    data = bench.draw(truth, rng)
    result = fit_frame(data, optics, bench.near(Stable.of()))
    assert result.status is Status.OK
    assert abs(float(result.parameters.background) - 50.0) < 4 * result.error("background")


def test_a_start_with_the_stars_exchanged_gives_the_same_covariance(bench, optics, rng):
    data = bench.draw(Parameters(SCENE, Stable.of(), [0.0, 0.0]), rng)
    plain = fit_frame(data, optics, bench.near(Stable.of()))
    turned = Parameters(Binary(-5.1, 321.0, 0.35, -0.15, 2.8e6, 2.8), Stable.of(), np.zeros(2))
    other = fit_frame(data, optics, turned)
    scale = np.sqrt(np.diag(plain.covariance))
    # correlations agree with their signs; a wrong turn would exchange those of separation and place
    np.testing.assert_allclose(
        other.covariance / np.outer(scale, scale), plain.covariance / np.outer(scale, scale), atol=1e-3
    )


@pytest.mark.parametrize("name", ["linear", "shm"])
def test_a_streak_fitted_to_a_still_frame_ends_at_zero_length(bench, name, optics, rng):
    unsettled = 0
    for _ in range(12):
        data = bench.draw(Parameters(SCENE, Stable.of(), [0.0, 0.0]), rng)
        result = fit_locus(name, data, optics, bench.near(Stable.of()), np.array([1e-3, 0.0, 1e-4]))
        unsettled += result.status is Status.NOT_CONVERGED
        assert result.status in (Status.OK, Status.NOT_CONVERGED), result.message
        assert abs(float(result.parameters.scene.separation) - 5.0) < 5 * result.error("separation")
    assert unsettled <= 3  # 5 % do not settle in 50 steps (7 of 150): more than 3 of 12 once in 500 times


def test_weakly_visible_aberrations_settle_too(bench, rng):
    # three struts make defocus and astigmatism show, but to second order first
    pupil = obstructed_circle(0.125, 0.04, strut_width=0.002, struts=3, samples=64)
    band = flat_band(530, 640, 3)
    system = OpticalSystem(pupil, band, grid_for(pupil, band, (48, 44), 0.375, pad=16))
    scene = Binary(5.0, 140.0, 0.3, -0.2, 1.2e5, 3.0)
    truth = Parameters(scene, Mvn.of(0.1, 0.05, 20.0), np.zeros(7))
    for _ in range(4):
        result = fit_frame(type(bench)(system).draw(truth, rng), system, truth)
        assert result.status is Status.OK, result.message
        exact = expected_image(result.parameters, system.otf(result.parameters.aberrations))
        assert np.sum((np.asarray(exact) - result.image) ** 2 / result.image) < 0.1**2


@pytest.fixture
def deviances(monkeypatch):
    """Deviance a pixel at the end of every maximisation."""
    levels = []

    def noted(start, otf, data, *rest, **options):
        end = fisher_scoring(start, otf, data, *rest, **options)
        levels.append(float(end.objective) / int(np.sum(np.asarray(data.used))))
        return end

    monkeypatch.setattr("jitterkit.linearisation.fisher_scoring", noted)
    return levels


def test_a_frame_of_another_scene_is_given_up_soon(bench, optics, deviances):
    """Ten maximisations of fifty steps took twenty seconds to the same result."""
    image = np.array(bench.image(Parameters(SCENE, Mvn.of(0.1), [4.0, -3.0])))
    for _ in range(3):
        image[:44] = np.rot90(image[:44])
        result = fit_frame(Data(image + 3e4 * np.eye(48, 44)[::-1], 4.0), optics, bench.near())
        assert result.status is Status.POOR_FIT
    assert min(deviances) > 30
    assert len(deviances) <= 3 * 6


def test_one_star_is_given_up_where_two_are_far_nearer_to_the_frame(bench, optics, deviances):
    """But for a normal blur, from which the others start."""
    data = Data(bench.image(Parameters(SCENE, Mvn.of(0.1), [4.0, -3.0])), 4.0)
    star, moments = Star(0.3, -0.2, 3e6), [3.0, 0.0, 3.0]
    start, options = (
        Parameters(star, Mvn.near(moments), np.zeros(2)),
        FitOptions(rival=float(data.used.sum())),
    )
    took = {}
    for locus in ("mvn", "linear", "path"):
        for known in (FitOptions(), options):
            deviances.clear()
            result = fit_locus(locus, data, optics, start, moments, options=known, sure=True)
            assert result.status is not Status.OK
            took[locus, known.rival] = len(deviances)
    assert took["linear", options.rival] < took["linear", np.inf]


@pytest.mark.parametrize(
    ("locus", "patient"), [("mvn", False), ("linear", False), ("partial", True), ("path", True)]
)
def test_fits_in_valleys_are_patient(locus, patient, bench, optics, monkeypatch):
    """They may end before they are exact: after four rounds one was accepted that was off by 0.6 errors."""
    told = []

    def noted(*args, patient, **options):
        told.append(patient)
        return relinearised_scoring(*args, patient=patient, **options)

    monkeypatch.setattr("jitterkit.refit.fit.relinearised_scoring", noted)
    truth = bench.truth(Mvn.of(0.12, 0.06, 30.0))
    fit_locus(locus, Data(bench.image(truth), 4.0), optics, truth, truth.locus.moments(), sure=True)
    assert told[0] is patient


def test_a_bright_frame_far_off_is_not_given_up(bench, optics, deviances):
    truth = Parameters(Binary(5.0, 140.0, 0.3, -0.2, 1e8, 3.0), Mvn.of(0.1, 0.05, 20.0), [30.0, -25.0])
    near = bench.near()
    start = Parameters(Binary(5.1, 141.0, 0.35, -0.15, 9e7, 2.8), near.locus, near.aberrations)
    result = fit_frame(Data(bench.image(truth), 4.0), optics, start)
    assert deviances[0] > 30
    assert result.status is Status.OK
    np.testing.assert_allclose(result.parameters.aberrations, [30.0, -25.0], atol=1e-2)
