"""The bound against laws and against derivatives taken the plain way."""

import numpy as np
import pytest
from refusals import refused

from jitterkit.detectors import Detector
from jitterkit.errors import ErrorCode
from jitterkit.forecast import Forecast, degenerate_directions, forecast
from jitterkit.forecast.bound import expected_data
from jitterkit.forward import expected_image, parameter_names, to_vector
from jitterkit.loci import Linear, Mvn, PartialShm, Shm, Smear
from jitterkit.refit import FitOptions, Priors, fit_frame, moments_prior
from jitterkit.report.forecast_table import parameter_table

SCENE = ("separation", "theta", "x", "y", "flux", "contrast")


def test_all_else_known_the_flux_has_the_error_of_the_photons_counted(bench):
    truth = bench.under()
    hold = [name for name in parameter_names(truth, bench.otf.names) if name != "flux"]
    found = forecast(truth, bench.otf, options=FitOptions(hold=hold))
    counted = float(np.sum(np.asarray(expected_image(truth, bench.otf))))
    # every photon has the same derivative: N photons know the flux to one part in sqrt(N)
    assert found.error("flux") == pytest.approx(3e6 / np.sqrt(counted), rel=1e-9)
    assert found.inflation("flux") == pytest.approx(1.0)


@pytest.mark.parametrize("locus", [Mvn.of(0.2, 0.1, 20.0), Linear.of(0.5, 70.0)], ids=["mvn", "linear"])
def test_the_bound_is_that_of_differences_of_images(bench, locus):
    truth = bench.under(locus)
    found = forecast(truth, bench.otf, Detector(gain=2.0, read_noise=5.0))
    vector, unravel = to_vector(truth)
    image, rows = np.asarray(expected_image(truth, bench.otf)), []
    for i in range(len(found.names)):
        # a step of a hundredth of an error: the third derivative then weighs 1e-4, rounding 1e-7
        step = 0.01 * found.error(found.names[i]) * np.eye(len(vector))[i]
        up, down = (np.asarray(expected_image(unravel(vector + s * step), bench.otf)) for s in (1, -1))
        rows.append(((up - down) / (2 * step[i])).ravel())
    variance = image.ravel() + 25.0 + 4.0 / 12  # photons, read-out, rounding to 2 e-
    size = np.linalg.norm(rows, axis=1)
    unit = (np.array(rows) / size[:, None]) / np.sqrt(variance)
    errors = np.linalg.norm(np.linalg.pinv(unit), axis=0) / size
    np.testing.assert_allclose([found.error(name) for name in found.names], errors, rtol=1e-4)


def test_saturated_pixels_determine_nothing(bench):
    truth = bench.under(flux=3e5)
    image = np.asarray(expected_image(truth, bench.otf))
    level = 0.5 * image.max()
    found = forecast(truth, bench.otf, Detector(gain=1.0, saturation=level))
    assert found.masked == np.sum(np.rint(image) >= level)
    data = expected_data(truth, bench.otf, Detector(gain=1.0, saturation=level))
    np.testing.assert_array_equal(np.asarray(data.used), np.rint(image) < level)
    assert found.error("separation") > 1.01 * forecast(truth, bench.otf).error("separation")


def test_a_fit_without_noise_has_the_errors_forecast(bench):
    truth = bench.under(Mvn.of(0.2, 0.1, 20.0))
    # a prior about the truth leaves the fit there
    known = moments_prior(truth.locus.moments(), np.eye(3) * 1e-8)
    options = FitOptions(("background",), priors=Priors({"noll7": (0.0, 0.05)}).joined(known))
    found = forecast(truth, bench.otf, options=options)
    fitted = fit_frame(expected_data(truth, bench.otf), bench.optics, truth, bench.otf, options)
    unit = np.sqrt(np.outer(np.diag(found.covariance), np.diag(found.covariance)))
    np.testing.assert_allclose(found.covariance / unit, fitted.covariance / unit, atol=1e-5)  # 32-bit slopes
    assert found.error("noll7") < 0.05  # the prior counts
    assert found.error("noll7") < 0.999 * forecast(truth, bench.otf).error("noll7")


@pytest.mark.parametrize("kind", [Linear, Shm])
def test_a_streaks_length_has_the_error_that_small_changes_of_it_would(bench, kind):
    truth = bench.under(kind.of(0.6, 35.0))
    found = forecast(truth, bench.otf)
    length, error = found.jitter()["length"]
    slots = [found.names.index(name) for name in truth.locus.names]
    slope = []
    for i in range(2):
        step = 1e-6 * np.eye(2)[i]
        longer, shorter = (kind(truth.locus.coords + s * step).describe()["length"] for s in (1, -1))
        slope.append((longer - shorter) / 2e-6)
    expected = np.sqrt(slope @ found.covariance[np.ix_(slots, slots)] @ slope)
    assert (length, error) == (pytest.approx(0.6), pytest.approx(expected, rel=1e-5))
    assert found.jitter()["jitter_minor"] == (pytest.approx(0.0, abs=1e-6), 0.0)
    assert found.jitter()["jitter_angle"][0] == pytest.approx(35.0)


@pytest.mark.parametrize(
    "locus",
    [PartialShm.of(0.6, 30.0, 0.7, 30.0), pytest.param(Smear.of(0.6, 20.0, 0.2), marks=pytest.mark.slow)],
    ids=["partial", "smear"],
)
def test_a_length_that_is_not_the_rms_alone_has_its_own_error(bench, locus):
    found = forecast(bench.under(locus), bench.otf)
    slots = [found.names.index(name) for name in locus.names]
    covariance = found.covariance[np.ix_(slots, slots)]
    # lengths of loci drawn within a hundredth of the errors: linear there to a hundredth
    drawn = np.random.default_rng(3).multivariate_normal(np.zeros(len(slots)), covariance * 1e-4, 4000)
    lengths = [locus.at(locus.coords + step).describe()["length"] for step in drawn]
    length, error = found.jitter()["length"]
    assert length == pytest.approx(0.6)
    assert error == pytest.approx(100 * np.std(lengths), rel=0.05)
    major, major_err = found.jitter()["jitter_major"]
    assert error > 1.2 * length * major_err / major


def test_the_angle_of_a_round_jitter_and_the_length_of_none_are_not_known(bench):
    assert forecast(bench.under(Mvn.of(0.1)), bench.otf).jitter()["jitter_angle"][1] > 1e6
    assert forecast(bench.under(Linear.of(0.0)), bench.otf).jitter()["length"] == (0.0, np.inf)
    assert forecast(bench.under(), bench.otf).jitter() == {}


def test_a_hundred_times_the_frames_are_ten_times_as_exact(bench):
    found = forecast(bench.under(), bench.otf)
    error = found.error("separation")
    assert found.frames(error / 10) == pytest.approx(100)
    with refused(ErrorCode.OUT_OF_RANGE, "separation", 0):
        found.frames(0)
    with refused(ErrorCode.UNKNOWN_NAME, "'noll99'", "separation, theta"):
        found.error("noll99")


def test_the_midpoint_is_confused_with_what_moves_the_brighter_star_as_it_does(bench):
    # x of A, where most photons are, moves with x and, along the pair, with the separation
    (worst, *_) = degenerate_directions(forecast(bench.under(theta=180.0), bench.otf), least=1.1)
    assert set(list(worst.weights)[:2]) in ({"separation", "x"}, {"theta", "y"})


def test_the_table_correlates_every_error_with_the_separations(bench):
    found = forecast(bench.under(Mvn.of(0.2, 0.1, 20.0)), bench.otf)
    table = parameter_table(found)
    rows = {row["parameter"]: row for row in table}
    own, x = (found.names.index(name) for name in ("separation", "x"))
    expected = found.covariance[own, x] / (found.error("separation") * found.error("x"))
    assert rows["x"]["correlation"] == pytest.approx(expected)
    assert rows["separation"]["correlation"] == pytest.approx(1)
    assert np.isnan(rows["jitter_major"]["correlation"])
    assert list(rows)[: len(found.names)] == list(found.names)


def test_a_direction_says_how_much_less_it_is_known_than_its_parts():
    rho = 0.96
    information = np.array([[4.0, 2.0 * rho, 0], [2.0 * rho, 1.0, 0], [0, 0, 9.0]])
    found = Forecast(
        None, ("separation", "sxx", "flux"), information, np.linalg.inv(information), np.zeros(3)
    )
    (direction,) = degenerate_directions(found)
    # the smaller eigenvalue of the correlated pair is 1 - rho, its vector (1, -1)/sqrt 2
    assert direction.stretch == pytest.approx((1 - rho) ** -0.5)
    assert {name: abs(w) for name, w in direction.weights.items()} == {
        "separation": pytest.approx(0.5**0.5),
        "sxx": pytest.approx(0.5**0.5),
        "flux": pytest.approx(0.0, abs=1e-12),
    }
    assert str(direction) in (
        "separation up and sxx down change the image 5.0 times less than each alone",
        "sxx up and separation down change the image 5.0 times less than each alone",
    )
    assert direction.share == pytest.approx(1 / (1 - rho) / (1 / (1 - rho) + 1 / (1 + rho)))
    np.testing.assert_allclose(found.correlation[0, 1], -rho)
