"""Draws from the posterior: right where the posterior is known, and what Laplace says where it is normal."""

import sys

import equinox as eqx
import jax
import numpy as np
import pytest
import scipy.stats
from refusals import refused

from jitterkit.errors import ErrorCode, UndeterminedError
from jitterkit.forward import expected_image, parameter_names, to_vector
from jitterkit.likelihood import Data
from jitterkit.loci import Linear, Mvn, Stable
from jitterkit.refit import FitOptions, FitResult, Priors, Status, fit_frame
from jitterkit.refit.sampling import _LEAST_DRAWS, _target, sample_posterior

pytest.importorskip("blackjax")

DRAWS, CHAINS, WARMUP = 1000, 2, 200
KEY = jax.random.key(7)
PRIORS = Priors(
    {"noll7": (4.05, 0.03)}, (np.array([0.0188, 0.0062, 0.0118]), 1e-8 * (np.diag([1.0, 0.5, 1.0]) + 0.2))
)
"""About as narrow as what the frame tells."""
_image = eqx.filter_jit(expected_image)


def fit_of(data, optics, start, priors=None, only=None):
    """A fit of all parameters but the background, or of some only."""
    every = parameter_names(start, optics.nominal.names)
    hold = ("background",) if only is None else [name for name in every if name not in only]
    return fit_frame(data, optics, start, options=FitOptions(hold, priors or Priors()))


def draw(data, optics, fit, priors=None, **given):
    given = {"draws": DRAWS, "chains": CHAINS, "warmup": WARMUP, "key": KEY} | given
    return sample_posterior(data, optics, fit, priors, **given)


@pytest.fixture(scope="module")
def faint(bench, optics):
    """Twelve photons whose number alone is in question, and draws of it."""
    start = bench.truth(Stable.of(), flux=12.0)
    rng, image = np.random.default_rng(1), np.clip(bench.image(start), 0, None).ravel()
    counts = rng.multinomial(12, image / image.sum()).reshape(optics.grid.shape)
    data = Data(counts)
    fit = fit_of(data, optics, start, only=("flux",))
    seen = image.sum() / 12.0
    return data, fit, draw(data, optics, fit), scipy.stats.gamma(13, scale=1 / seen)


@pytest.fixture(scope="module")
def fitted(bench, optics):
    """A well-behaved frame and its fit with priors."""
    start = bench.truth(Mvn.of(0.15, 0.09, 30.0), (4.0, -3.0))
    data = Data(np.random.default_rng(2).poisson(bench.image(start)))
    fit = fit_of(data, optics, start, PRIORS)
    assert fit.status is Status.OK
    return data, fit


@pytest.fixture(scope="module")
def bright(fitted, optics):
    """The same, and draws."""
    data, fit = fitted
    return data, fit, draw(data, optics, fit, PRIORS)


@pytest.mark.slow
def test_the_number_of_photons_has_a_gamma_posterior(faint):
    # a flat prior and N photons of which a share s is seen: a gamma law of shape N + 1 and scale 1/s, whose
    # density falls to nothing at the border of valid scenes, three errors away
    _, fit, posterior, law = faint
    flux, effective = posterior.of("flux"), float(posterior.effective[0])
    assert np.all(flux > 0)
    np.testing.assert_allclose(
        posterior.log_density - posterior.log_density[0], law.logpdf(flux) - law.logpdf(flux[0]), atol=1e-4
    )
    # 4 sigma; Laplace's law is that of the mode, 0.28 errors lower
    assert posterior.mean("flux") == pytest.approx(law.mean(), abs=4 * law.std() / np.sqrt(effective))
    assert abs(fit.of_scene("flux") - law.mean()) > 0.2 * law.std()
    assert posterior.error("flux") == pytest.approx(law.std(), abs=4 * posterior.error_err[0])
    for q in (0.05, 0.5, 0.95):
        off = 4 * np.sqrt(2 * q * (1 - q) / effective)  # of a share; half as many draws count for tails
        assert law.cdf(posterior.quantile("flux", q)) == pytest.approx(q, abs=off)


@pytest.mark.slow
def test_the_same_key_gives_the_same_draws_and_another_gives_others(faint, optics):
    data, fit, posterior, _ = faint
    again, other = (draw(data, optics, fit, key=jax.random.key(seed)) for seed in (7, 8))
    np.testing.assert_array_equal(again.draws, posterior.draws)
    assert not np.any(other.draws == posterior.draws)


@pytest.mark.slow
def test_a_scene_that_cannot_be_has_no_density_and_no_slope(faint, optics):
    data, fit, _, _ = faint
    target = _target(data, optics, fit, Priors())
    density, slope = jax.jit(jax.value_and_grad(target.log_density))(np.array([-10.0]))  # errors: no light
    assert density == -np.inf
    assert slope == 0.0


@pytest.fixture(scope="module")
def few(fitted, optics):
    """The same, and few draws."""
    data, fit = fitted
    return data, fit, draw(data, optics, fit, PRIORS, draws=4, warmup=8)


def test_the_density_is_that_of_poisson_counts_and_of_the_priors(few, optics):
    data, fit, posterior = few
    counts, otf = np.asarray(data.electrons), optics.otf(fit.parameters.aberrations)
    vector, unravel = to_vector(fit.parameters)
    (prior,), jitter = PRIORS.terms.values(), PRIORS.moments
    density = []
    for values in posterior.draws:
        parameters = unravel(vector.at[: len(values)].set(values))  # the background comes last
        image = np.asarray(_image(parameters, otf))
        density.append(
            scipy.stats.poisson.logpmf(counts, image).sum()
            + scipy.stats.norm.logpdf(values[fit.names.index("noll7")], *prior)
            + scipy.stats.multivariate_normal.logpdf(values[6:9], *jitter)
        )
    told = posterior.log_density
    np.testing.assert_allclose(told - told[0], np.array(density) - density[0], atol=1e-6)
    np.testing.assert_array_equal(posterior.moments, posterior.draws[:, 6:9])  # of a normal


@pytest.mark.slow
def test_laplace_agrees_where_the_posterior_is_normal(bright):
    _, fit, posterior = bright
    laplace = np.array([fit.error(name) for name in fit.names])
    errors = np.array([posterior.error(name) for name in fit.names])
    # 4 sigma of 11 parameters, and 2 % by which the curvature at the data differs from the expected one
    assert np.all(np.abs(errors / laplace - 1) < 4 * posterior.error_err / laplace + 0.02)
    fitted = np.asarray(to_vector(fit.parameters)[0])[: len(fit.names)]  # the background comes last
    moved = (posterior.draws.mean(axis=0) - fitted) / laplace
    assert np.all(np.abs(moved) < 4 / np.sqrt(posterior.effective) + 0.02)
    np.testing.assert_allclose(np.corrcoef(posterior.draws.T), correlation(fit.covariance), atol=0.12)
    assert posterior.divergences == 0
    # four halves of 200 independent squares: R-hat² - 1 is a 200th of chi²(3)/3, and may be 12 times that
    assert np.all(posterior.rhat < 1.03)


def correlation(covariance):
    spread = np.sqrt(np.diag(covariance))
    return covariance / np.outer(spread, spread)


@pytest.mark.slow
def test_what_is_left_uncertain_of_an_error_is_the_scatter_between_batches(bright):
    _, _, posterior = bright
    batches = posterior.draws.reshape(20, -1, len(posterior.names))
    scatter = batches.std(axis=1, ddof=1).std(axis=0, ddof=1) / np.sqrt(20)
    # one scatter of 20 is good to 16 %, the mean of 11 to 5 %; short batches miss some of the correlation
    assert np.mean(scatter / posterior.error_err) == pytest.approx(1, abs=0.3)


@pytest.mark.slow
def test_a_prior_is_counted(bright, bench, optics):
    data, _, posterior = bright
    free = fit_of(data, optics, bench.truth(Mvn.of(0.15, 0.09, 30.0), (4.0, -3.0)))
    without = draw(data, optics, free)
    for name in ("noll7", "mvn_xx"):
        assert posterior.error(name) < 0.8 * without.error(name)
        assert without.error(name) == pytest.approx(free.error(name), rel=0.12)


@pytest.mark.slow
def test_a_streak_of_almost_zero_length_has_the_posterior_that_quadrature_finds(bench, optics, rng):
    # only the two coordinates vary: their posterior on a grid of 61 by 61 places is known to rounding, flat
    # prior in them included; Laplace's normal law is far off
    start = bench.truth(Linear.of(0.08, 25.0), flux=1e5)
    data = Data(rng.poisson(bench.image(start)))
    fit = fit_of(data, optics, start, only=Linear.names)
    posterior = draw(data, optics, fit)
    reach = np.linspace(-1, 1, 61) * 1.3 * np.abs(posterior.draws).max()
    positions = np.stack(np.meshgrid(reach, reach), axis=-1).reshape(-1, 2)
    otf, counts = optics.nominal, np.asarray(data.electrons)

    @jax.jit
    def log_likelihood(position):
        image = expected_image(start.with_locus(Linear(position)), otf)
        return jax.scipy.stats.poisson.logpmf(counts, image).sum()

    density = np.asarray(jax.lax.map(log_likelihood, positions))
    weights = np.exp(density - density.max())
    lengths = np.sqrt(np.hypot(*positions.T))
    mean = np.average(lengths, weights=weights)
    spread = np.sqrt(np.average((lengths - mean) ** 2, weights=weights))
    drawn = np.sqrt(12 * (posterior.moments[:, 0] + posterior.moments[:, 2]))
    np.testing.assert_allclose(drawn, np.sqrt(np.hypot(*posterior.draws.T)), rtol=1e-9)
    assert drawn.mean() == pytest.approx(mean, abs=4 * spread / np.sqrt(posterior.effective.min()))
    assert drawn.std() == pytest.approx(spread, rel=4 / np.sqrt(posterior.effective.min()))


def test_what_cannot_be_sampled_says_why(few, optics):
    data, fit, posterior = few
    empty = FitResult(Status.NO_DATA, Status.NO_DATA.value)
    with refused(ErrorCode.TOO_FEW, Status.NO_DATA.value):
        draw(data, optics, empty)
    for what, least in (("draws", _LEAST_DRAWS), ("chains", 1), ("warmup", 1)):
        with refused(ErrorCode.OUT_OF_RANGE, least, what, 0):
            draw(data, optics, fit, **{what: 0})
    unknown = FitResult(
        Status.OK,
        "",
        parameters=fit.parameters,
        names=fit.names,
        covariance=np.full_like(fit.covariance, np.nan),
    )
    with refused(ErrorCode.NOT_CONSTRAINED, error=UndeterminedError):
        draw(data, optics, unknown)
    with refused(ErrorCode.UNKNOWN_NAME, "'fluxx'", *posterior.names):
        posterior.error("fluxx")


def test_without_blackjax_the_message_names_the_extra(fitted, optics, monkeypatch):
    data, fit = fitted
    monkeypatch.setitem(sys.modules, "blackjax", None)
    with refused(ErrorCode.MISSING_PACKAGE, "jitterkit[sampling]"):
        draw(data, optics, fit)
