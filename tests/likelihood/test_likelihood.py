"""The shifted-Poisson likelihood: against scipy's laws, and by its own statistics."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from jitterkit.forward import Parameters, expected_image, parameter_names
from jitterkit.likelihood import Data, deviance, normal_equations, pearson
from jitterkit.loci import Mvn
from jitterkit.scene import Binary


@pytest.fixture(scope="module")
def truth():
    return Parameters(Binary(3.0, 40.0, 0.2, -0.1, 2e4, 2.0), Mvn.of(0.1, 0.05, 30.0), [3.0, -2.0], 5.0)


@pytest.fixture
def free(truth, otf):
    return tuple(range(len(parameter_names(truth, otf.names))))


def test_the_deviance_is_twice_the_poisson_log_likelihood_lost(truth, otf, rng):
    image = np.asarray(expected_image(truth, otf))
    counts = rng.poisson(image)
    reference = -2 * (
        stats.poisson.logpmf(counts, image) - stats.poisson.logpmf(counts, np.maximum(counts, 1e-300))
    )
    # at zero counts the saturated model has likelihood one
    reference = np.where(counts == 0, 2 * image, reference)
    assert float(deviance(truth, otf, Data(counts))) == pytest.approx(reference.sum(), rel=1e-10)


def test_read_noise_that_dominates_makes_the_likelihood_normal(truth, otf, rng):
    image = np.asarray(expected_image(truth, otf))
    variance = 1e8
    counts = image + rng.normal(0, np.sqrt(variance), image.shape)
    normal = ((counts - image) ** 2 / (variance + image)).sum()
    # next order of the Stirling series: skewness, of relative size 1/sigma
    assert float(deviance(truth, otf, Data(counts, variance))) == pytest.approx(
        normal, rel=20 / np.sqrt(variance)
    )


def test_the_deviance_is_exact_where_counts_are_large_beside_their_residuals(truth, otf, rng):
    """As errors of the model make them; numbers of 80 bits have nothing of the rounding of 64."""
    image = np.asarray(expected_image(truth, otf), np.longdouble)
    variance = 1e10
    counts = (image + rng.normal(0, 1e5, image.shape)).astype(float)
    mean, count = image + variance, counts.astype(np.longdouble) + variance
    exact = 2 * np.sum(mean - count + count * np.log(count / mean))
    assert float(deviance(truth, otf, Data(counts, variance))) == pytest.approx(
        float(exact), rel=1e-10
    )  # counts of 1e10 are rounded by 2e-6, 2e-11 of their scatter


def test_the_score_is_the_slope_of_the_deviance(truth, otf, free, rng):
    image = np.asarray(expected_image(truth, otf))
    data = Data(rng.poisson(image) + rng.normal(0, 3, image.shape), 9.0)
    score = np.asarray(normal_equations(truth, otf, data, free).score)
    for name, change, slot in (("flux", 1.0, 4), ("separation", 1e-5, 0), ("contrast", 1e-5, 5)):
        values = {
            n: float(getattr(truth.scene, n)) for n in ("separation", "theta", "x", "y", "flux", "contrast")
        }
        ends = []
        for sign in (1, -1):
            scene = Binary(**{**values, name: values[name] + sign * change})
            moved = Parameters(scene, truth.locus, truth.aberrations, truth.background)
            ends.append(float(deviance(moved, otf, data)))
        assert -(ends[0] - ends[1]) / (4 * change) == pytest.approx(score[slot], rel=1e-5)


def test_the_information_is_the_covariance_of_the_score(truth, otf, free, rng):
    image = np.asarray(expected_image(truth, otf))
    scores = []
    for _ in range(400):
        data = Data(rng.poisson(image) + rng.normal(0, 3, image.shape), 9.0)
        equations = normal_equations(truth, otf, data, free)
        scores.append(np.asarray(equations.score))
    information = np.asarray(equations.information)
    scale = np.sqrt(np.diag(information))
    sampled = np.cov(np.array(scores).T) / np.outer(scale, scale)
    # the variance of 400 draws scatters by sqrt(2/399) = 0.07; five times that for the worst of 121
    np.testing.assert_allclose(sampled, information / np.outer(scale, scale), atol=0.36)
    # the mean score is zero within 4 standard errors
    assert np.all(np.abs(np.mean(scores, axis=0) / scale) < 4 / np.sqrt(400))


def test_masked_pixels_do_not_count(truth, otf, free, rng):
    image = np.asarray(expected_image(truth, otf))
    counts = rng.poisson(image).astype(float)
    used = rng.uniform(size=image.shape) > 0.3
    spoilt = np.where(used, counts, rng.choice([np.nan, 1e9, -1e9], image.shape))
    clean = normal_equations(truth, otf, Data(counts, 4.0, used), free)
    dirty = normal_equations(truth, otf, Data(spoilt, 4.0, used), free)
    for a, b in zip(clean, dirty, strict=True):
        np.testing.assert_array_equal(a, b)


def test_pearson_is_about_the_number_of_used_pixels(truth, otf, rng):
    image = np.asarray(expected_image(truth, otf))
    used = np.ones(image.shape, bool)
    used[:3] = False
    chi2, pixels, spread, residual = pearson(image, Data(rng.poisson(image), 0.0, used))
    assert pixels == used.sum()
    assert spread == pytest.approx(np.sqrt((2 + 1 / image[used]).sum()))
    assert abs(chi2 - pixels) < 5 * spread
    assert np.isnan(residual[~used]).all()
    assert np.isfinite(residual[used]).all()


def test_a_model_that_goes_negative_stays_finite(otf):
    dark = Parameters(
        Binary(3.0, 0.0, 0.0, 0.0, 10.0, 1.0), Mvn(jnp.array([-0.2, 0.0, -0.2])), [0.0, 0.0], -1.0
    )
    counts = Data(np.ones(otf.grid.shape))
    assert np.isfinite(float(deviance(dark, otf, counts)))


def test_the_score_is_the_slope_where_read_noise_takes_counts_below_zero(otf, free, rng):
    faint = Parameters(Binary(3.0, 40.0, 0.2, -0.1, 500.0, 2.0), Mvn.of(0.1), [0.0, 0.0])
    image = np.asarray(expected_image(faint, otf))
    data = Data(rng.poisson(np.clip(image, 0, None)) + rng.normal(0, 0.6, image.shape), 0.36)
    assert np.mean(np.asarray(data.electrons) + 0.36 < 0) > 0.05
    score = np.asarray(normal_equations(faint, otf, data, free).score)
    ends = []
    for sign in (1, -1):
        moved = Binary(3.0, 40.0, 0.2, -0.1, 500.0 + sign * 0.01, 2.0)
        ends.append(float(deviance(Parameters(moved, faint.locus, faint.aberrations), otf, data)))
    assert -(ends[0] - ends[1]) / 0.04 == pytest.approx(score[4], rel=1e-5)


def test_a_pixel_that_the_model_holds_below_nothing_carries_no_information(otf, free):
    dark = Parameters(Binary(3.0, 0.0, 0.0, 0.0, 100.0, 1.0), Mvn.of(0.1), [0.0, 0.0], -0.5)
    image = np.asarray(expected_image(dark, otf))
    assert (image < 0).any()
    data = Data(np.ones(otf.grid.shape))
    kept = Data(np.ones(otf.grid.shape), 0.0, image > 1e-3)
    bound = normal_equations(dark, otf, data, free).information[0, 0]
    assert float(bound) == pytest.approx(
        float(normal_equations(dark, otf, kept, free).information[0, 0]), rel=0.05
    )
