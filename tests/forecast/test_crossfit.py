"""Wrong models: the science's biases, another optimiser's, and the same draws fitted in two ways."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize
from paper_draws import refitted_draws

from jitterkit.conventions import FWHM_PER_SIGMA
from jitterkit.detectors import Detector
from jitterkit.forecast import linearised_draws, noise_free_fit
from jitterkit.forward import expected_image, to_vector
from jitterkit.frames import RawFrame
from jitterkit.loci import Linear, Mvn, Shm, Stable
from jitterkit.refit import FitOptions

SIGMA = 0.225 / FWHM_PER_SIGMA


@pytest.mark.parametrize(
    ("truth", "fitted", "expected"),
    [
        (Linear.of(0.375), "mvn", 7.4),
        *(
            pytest.param(*more, marks=pytest.mark.slow)
            for more in (
                (Mvn.sheared(SIGMA, 0.1, 0), "stable", -591),
                (Mvn.sheared(SIGMA, 0.7, 45), "linear", -79),
                (Shm.of(0.75), "mvn", 386),
                (Linear.of(0.75), "shm", -32),
                (Mvn.sheared(SIGMA, 0.1, 45), "stable", -394),
                (Mvn.sheared(SIGMA, 0.1, 90), "stable", -439),
                (Mvn.sheared(SIGMA, 0.7, 0), "linear", 16),
                (Mvn.sheared(SIGMA, 0.7, 90), "linear", -66),
                (Linear.of(0.225), "mvn", 0.9),
                (Linear.of(0.75), "mvn", 133),
                (Shm.of(0.225), "mvn", 2.6),
                (Shm.of(0.375), "mvn", 22),
                (Shm.of(0.75), "linear", 74),
            )
        ),
    ],
)
def test_a_wrong_locus_biases_the_separation_as_the_science_says(paper, truth, fitted, expected):
    held = FitOptions(hold=("background",))  # as there
    found = noise_free_fit(paper.under(truth), fitted, paper.optics, otf=paper.otf, options=held)
    assert 1e6 * found.bias == pytest.approx(expected, rel=0.03, abs=0.1)


def test_the_right_locus_has_no_bias_and_the_scatter_of_its_bound(bench):
    found = noise_free_fit(bench.under(Linear.of(0.5, 30.0)), "linear", bench.optics, otf=bench.otf)
    assert abs(found.bias) < 1e-6 * found.error
    assert found.scatter == pytest.approx(found.error, rel=1e-6)
    assert found.misfit < 1e-6


@pytest.mark.slow
def test_a_hopeless_locus_is_biased_as_another_optimiser_finds(bench):
    truth = bench.under(Mvn.of(0.25, 0.22, 40.0))
    found = noise_free_fit(truth, "linear", bench.optics, otf=bench.otf)
    mean = jnp.asarray(expected_image(truth, bench.otf))
    vector, unravel = to_vector(found.fit.parameters)
    size = np.sqrt(np.diag(found.fit.covariance))

    @jax.value_and_grad
    def lost(moved, otf):
        image = expected_image(unravel(vector + moved * size), otf)
        return jnp.sum(image - mean - mean * jnp.log(image / mean))

    def exact(moved):
        return lost(moved, bench.optics.otf(unravel(vector + moved * size).aberrations))

    away = np.full(len(vector), 3.0)  # three errors off in everything
    end = scipy.optimize.minimize(exact, away, jac=True, method="BFGS", options={"gtol": 1e-3})
    # that optimiser stops within a hundredth of an error
    assert abs(end.x[0]) < 0.01
    assert abs(found.bias) > 0.3 * found.error  # there was something to find


@pytest.fixture(scope="module")
def fits(bench):
    truth = bench.under(Linear.of(0.6, 20.0))
    return [noise_free_fit(truth, name, bench.optics, otf=bench.otf) for name in ("linear", "mvn", "stable")]


def test_linearised_draws_scatter_as_the_linear_response_does(fits):
    drawn = linearised_draws(fits, 2000, np.random.default_rng(4))
    assert drawn.separations.shape == drawn.evidence.shape == (3, 2000)
    for values, fit in zip(drawn.separations, fits, strict=True):
        # standard errors of mean and deviation of 2000 draws; four of them
        assert abs(values.mean() - 5.0 - fit.bias) < 4 * fit.scatter / np.sqrt(2000)
        assert values.std() == pytest.approx(fit.scatter, rel=4 / np.sqrt(4000))
    assert fits[0].scatter == pytest.approx(fits[0].error, rel=1e-6)
    assert fits[2].scatter > 1.02 * fits[2].error  # a wrong locus scatters by more than it believes


@pytest.mark.slow
def test_the_same_generator_draws_the_same_frames_for_both_ways_of_fitting(fits, bench):
    quick = linearised_draws(fits[:2], 12, np.random.default_rng(9))
    full = refitted_draws(fits[:2], bench.optics, 12, np.random.default_rng(9), auto=True)
    assert (quick.loci, full.loci) == (("linear", "mvn"), ("linear", "mvn", "auto"))
    off = full.separations[:2] - quick.separations
    # a step leaves out a few hundredths of an error; another draw would be off by one
    assert np.all(np.abs(off) < 0.2 * fits[0].error)
    assert np.std(off[0]) < 0.05 * fits[0].error
    # so do differences of evidence of forty nats, which scatter by five to ten from frame to frame, but for
    # cubic terms of the likelihood, where mvn is wrong: 0.3 to 1.5 nats rms over two telescopes and two seeds
    known = [d.evidence[0] - d.evidence[1] for d in (quick, full)]
    assert np.sqrt(np.mean((known[0] - known[1]) ** 2)) < 0.05 * np.mean(known[1])
    assert np.corrcoef(*known)[0, 1] > 0.95
    assert np.all(np.isfinite(full.separations[2]))
    again = linearised_draws(fits[:2], 12, np.random.default_rng(9))
    np.testing.assert_array_equal(quick.separations, again.separations)
    assert not np.any(quick.separations == linearised_draws(fits[:2], 12, np.random.default_rng(10))[1])


def test_a_wrong_locus_scatters_as_full_refits_of_its_frames_do(bench):
    truth = bench.under(Mvn.of(0.3, 0.2, 40.0))
    fits = [noise_free_fit(truth, "stable", bench.optics, otf=bench.otf)]
    quick = linearised_draws(fits, 60, np.random.default_rng(5)).separations[0]
    full = refitted_draws(fits, bench.optics, 60, np.random.default_rng(5)).separations[0]
    assert np.all(np.isfinite(full))  # poor fits, all of them
    slope = np.polyfit(quick - quick.mean(), full - full.mean(), 1)[0]
    # by the expected information, as for a right locus, the slope is off by more
    believed = fits[0].fit.covariance[0] @ fits[0].slopes.reshape(len(fits[0].slopes), -1)
    variance = np.asarray(fits[0].data.electrons).ravel()
    assert slope == pytest.approx(1, abs=0.02)
    assert np.sqrt(believed**2 @ variance) / fits[0].scatter != pytest.approx(1, abs=0.03)


def test_the_evidence_of_many_frames_finds_the_locus_that_one_frame_cannot(fits):
    drawn = linearised_draws(fits, 400, np.random.default_rng(2))
    name, separations = drawn.by_sequence()
    assert name == "linear"
    np.testing.assert_array_equal(separations, drawn.separations[0])
    chosen = drawn.by_frame()
    assert np.all((chosen == drawn.separations[0]) | (chosen == drawn.separations[1]))
    assert np.all(np.isneginf(drawn.evidence[2]))  # stable has no evidence, and is never chosen


def test_a_stable_telescope_fitted_with_a_normal_is_unbiased(bench):
    found = noise_free_fit(bench.under(Stable.of()), "mvn", bench.optics, otf=bench.otf)
    assert abs(found.bias) < 1e-6 * found.error


@pytest.fixture(scope="module")
def uneven(otf):
    """A detector whose response is a quarter under the stars of what it is about them."""
    y, x = np.indices(otf.grid.shape) - 0.5 * (np.array(otf.grid.shape)[:, None, None] - 1)
    flat = np.where(np.hypot(x, y) < 14, 0.4, 1.6)
    return Detector(gain=1.0, bias=100.0, read_noise=3.0, flat=flat / flat.mean())


@pytest.fixture(scope="module")
def flattened(bench, uneven):
    truth = bench.under(Linear.of(0.6, 20.0))
    return [noise_free_fit(truth, name, bench.optics, uneven, bench.otf) for name in ("linear", "shm")]


@pytest.mark.slow
def test_frames_divided_by_a_flat_scatter_as_those_that_a_detector_reads(flattened, uneven, bench, rng):
    fit = flattened[0]
    assert fit.scatter == pytest.approx(fit.error, rel=1e-6)  # as of every right locus
    image = np.asarray(expected_image(fit.truth, bench.otf))
    read = [uneven.calibrate(RawFrame.from_array(uneven.expose(image, rng))).electrons for _ in range(400)]
    drawn = linearised_draws([fit], 400, rng).separations[0]
    # four times what a deviation of 400 draws scatters by
    for values in (np.tensordot(np.array(read) - image, fit.leverage, 2), drawn):
        assert np.std(values) == pytest.approx(fit.scatter, rel=4 / np.sqrt(800))


@pytest.mark.slow
def test_frames_divided_by_a_flat_are_fitted_alike_in_both_ways(flattened, bench):
    quick = linearised_draws(flattened, 12, np.random.default_rng(9))
    full = refitted_draws(flattened, bench.optics, 12, np.random.default_rng(9))
    # both loci are streaks, far from any bound: a step leaves out a hundredth of an error, and of a nat
    assert np.all(np.abs(full.separations - quick.separations) < 0.05 * flattened[0].error)
    known = [d.evidence[0] - d.evidence[1] for d in (quick, full)]
    np.testing.assert_allclose(*known, rtol=0, atol=0.05)
    assert np.std(known[0]) > 1
