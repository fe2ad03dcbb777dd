"""The posterior of one frame by Hamiltonian Monte Carlo: the reference for the errors of the refit.

A refit reports Laplace's errors: those of the normal distribution with the curvature that the posterior has
at its top.  Where the posterior is not normal they are an approximation, and draws from the posterior itself
say how good it is.  ``scripts/laplace_check`` found the separation's errors right to 3 %, but for a pair that
is not resolved under a streak that is not detected.  Reach for :func:`sample_posterior` with a frame and its
fit; it needs the extra ``sampling``.
"""

from __future__ import annotations

import time
from types import ModuleType

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jitterkit.errors import ConfigurationError, ErrorCode, UndeterminedError
from jitterkit.forward import Parameters, parameter_names, to_vector
from jitterkit.likelihood import Data, deviance
from jitterkit.metric import Prior
from jitterkit.optics.otf import OTF
from jitterkit.optics.system import Optics
from jitterkit.refit.posterior import Posterior
from jitterkit.refit.priors import Priors
from jitterkit.refit.result import FitResult

_LEAST_DRAWS = 4
"""Of a chain: its halves are compared with each other, and each needs a variance."""

_ACCEPTANCE, _FIRST_STEP = 0.8, 0.5
"""Share of steps to accept, Stan's; and a step to begin with, in standard errors."""


def sample_posterior(
    data: Data,
    optics: Optics,
    fit: FitResult,
    priors: Priors | None = None,
    *,
    draws: int = 500,
    chains: int = 4,
    warmup: int = 300,
    key: Array,
) -> Posterior:
    """Draw from the posterior of a fitted frame, with the No-U-Turn Sampler.

    Parameters
    ----------
    data : Data
        The frame that was fitted.
    optics : Optics
        What it was fitted with.
    fit : FitResult
        Says which parameters vary and where; its covariance sets the scales, so that a unit step is one
        standard error of what it approximates.
    priors : Priors, optional
        Those of the fit.
    draws : int
        Of each chain, after its warm-up.
    chains : int
        Each from a position of its own, drawn from the normal distribution of the fit.
    warmup : int
        Draws of each chain that set its step and are thrown away.
    key : jax.random key
        The same key gives the same draws.

    Returns
    -------
    posterior : Posterior

    Raises
    ------
    ConfigurationError
        If the fit has no free parameters, a number is too small, or blackjax is not installed.
    UndeterminedError
        If the fit has no finite covariance.

    Notes
    -----
    The density is ``exp(-objective/2)`` with the objective of the refit: the deviance of the shifted Poisson
    law plus the priors' quadratic forms.  Beyond those priors it is flat *in the coordinates that are
    fitted*: in the signed moments of a normal, and in ``(L² cos 2phi, L² sin 2phi)`` of a streak.  The
    latter grows as L³ in the length, so that a streak that the frame does not show is drawn longer than it
    is.  Who believes otherwise weighs the draws: by ``1/L³`` for a prior flat in the length.

    *Assumes* optics linear in the aberrations about the fitted ones, as the last round of the fit has them;
    ``scripts/laplace_check`` measures what that leaves out.  A path's regularizing prior is as wide as the
    fitted path, where the fit had that of its start.

    *Fails when* the posterior has maxima far apart (a path bent the other way): chains stay on the fit's.  In
    the bent valleys of a locus with regularizing priors, paths break off: 55 of 3000 for a partial vibration
    of 0.3 arcsec, with an R-hat of 1.08 of its even share; the separation's was 1.002 and its error Laplace's
    within 2 %.

    Source: Hoffman & Gelman, JMLR 15, 1593 (2014), in blackjax; split R-hat by ranks after Vehtari et al.,
    Bayesian Analysis 16, 667 (2021).
    """
    began = time.perf_counter()
    _check(draws, chains, warmup)
    target = _target(data, optics, fit, priors or Priors())
    walked = _walk(target, jax.random.split(key, chains), int(warmup), int(draws))
    values, moments, density, divergent, acceptance = walked
    effective, rhat, error_err = (np.asarray(one) for one in _summarise_draws(values))
    return Posterior(
        fit.names,
        np.asarray(values).reshape(-1, len(fit.names)),
        np.asarray(moments).reshape(-1, 3),
        np.asarray(density).ravel(),
        effective,
        rhat,
        error_err,
        divergences=int(np.sum(divergent)),
        acceptance=float(np.mean(acceptance)),
        seconds=time.perf_counter() - began,
    )


class _Target(eqx.Module):
    """A posterior in coordinates in which its Laplace approximation is the standard normal distribution."""

    fitted: Parameters
    otf: OTF
    data: Data
    prior: Prior
    scale: Float[Array, "p p"]
    free: tuple[int, ...] = eqx.field(static=True)

    def values(self, position):
        """Return the free parameters at a position."""
        return self._centre() + self.scale @ position

    def moments(self, position):
        """Second moments of the pointing there."""
        return self._parameters(self.values(position)).locus.moments()

    def log_density(self, position):
        """Minus half the objective; minus infinity, and no slope, where a scene cannot be."""
        values = self.values(position)
        valid = self._parameters(values).scene.is_valid()
        values = jnp.where(valid, values, self._centre())  # where the slope is finite
        parameters = self._parameters(values)
        costs = self.prior.costs(values, parameters.locus.moments())
        objective = sum(costs, deviance(parameters, self.otf, self.data))
        return jnp.where(valid & jnp.isfinite(objective), -objective / 2, -jnp.inf)

    def _centre(self):
        return to_vector(self.fitted)[0][np.asarray(self.free)]

    def _parameters(self, values) -> Parameters:
        vector, unravel = to_vector(self.fitted)
        return unravel(vector.at[np.asarray(self.free)].set(values))


def _target(data, optics, fit: FitResult, priors: Priors) -> _Target:
    if fit.parameters is None or not fit.names:
        problem = f"This fit has no free parameters to draw ({fit.message.rstrip('.')})"
        remedy = "fit the frame first, with some of them free"
        raise ConfigurationError(ErrorCode.TOO_FEW, f"{problem}; {remedy}.")
    if not np.all(np.isfinite(fit.covariance)):
        problem = "The frame does not determine all its parameters, so their posterior has no end"
        remedy = "hold some of them or give priors in the fit"
        raise UndeterminedError(ErrorCode.NOT_CONSTRAINED, f"{problem}; {remedy}.")
    otf = optics.otf(np.asarray(fit.parameters.aberrations))
    every = parameter_names(fit.parameters, otf.names)
    prior = priors.over(fit.names, fit.parameters.locus)
    scale = jnp.asarray(np.linalg.cholesky(fit.covariance))
    free = tuple(every.index(name) for name in fit.names)
    return _Target(fit.parameters, otf, data, prior, scale, free)


@eqx.filter_jit
def _walk(target: _Target, keys, warmup: int, draws: int):
    """Chains one after the other: a processor gains nothing from walking them side by side."""
    return jax.lax.map(lambda key: _chain(target, key, warmup, draws), keys)


def _chain(target: _Target, key, warmup: int, draws: int):
    """One chain: values, moments, log density, whether the path broke off, acceptance; of each draw.

    A single loop, so that the sampler is compiled once: while it warms up, dual averaging sets the step.  The
    metric stays the unit one of coordinates that the fit has made round.
    """
    kernel = _blackjax().nuts.build_kernel()
    begin, learn, learnt = _blackjax().adaptation.step_size.dual_averaging_adaptation(_ACCEPTANCE)
    start_key, key = jax.random.split(key)
    start = jax.random.normal(start_key, target.scale.shape[:1], target.scale.dtype)
    start = jnp.where(jnp.isfinite(target.log_density(start)), start, 0.0)
    round_metric = jnp.ones_like(start)

    def draw(carry, turn):
        state, steps = carry
        key, warm = turn
        size = jnp.where(warm, jnp.exp(steps.log_step_size), learnt(steps))
        state, info = kernel(key, state, target.log_density, size, round_metric)
        steps = jax.tree.map(
            lambda new, old: jnp.where(warm, new, old), learn(steps, info.acceptance_rate), steps
        )
        position = state.position
        sample = target.values(position), target.moments(position), state.logdensity
        return (state, steps), (*sample, info.is_divergent, info.acceptance_rate)

    turns = jax.random.split(key, warmup + draws), jnp.arange(warmup + draws) < warmup
    first = _blackjax().nuts.init(start, target.log_density), begin(_FIRST_STEP)
    walked = jax.lax.scan(draw, first, turns)[1]
    return jax.tree.map(lambda each: each[warmup:], walked)


@jax.jit
def _summarise_draws(values):
    """Effective size, R-hat and Monte-Carlo error of the standard deviation: of draws (chains, draws, p)."""
    diagnostics = _blackjax().diagnostics
    squares = (values - values.mean(axis=(0, 1))) ** 2
    independent = diagnostics.effective_sample_size(squares)
    error_err = squares.std(axis=(0, 1)) / jnp.sqrt(independent * squares.mean(axis=(0, 1))) / 2
    summaries = diagnostics.effective_sample_size(values), diagnostics.rhat(values), error_err
    return tuple(jnp.atleast_1d(one) for one in summaries)


def _blackjax() -> ModuleType:
    try:
        import blackjax
        import blackjax.diagnostics
    except ImportError:
        raise ConfigurationError(
            ErrorCode.MISSING_PACKAGE,
            "Draws from the posterior need blackjax, which is not installed; "
            'run: pip install "jitterkit[sampling]"',
        ) from None
    return blackjax


def _check(draws: int, chains: int, warmup: int) -> None:
    _blackjax()  # says how to install it
    for what, given, least in (("draws", draws, _LEAST_DRAWS), ("chains", chains, 1), ("warmup", warmup, 1)):
        if given < least:
            problem = f"Sampling needs at least {least} for {what}, got {given}."
            raise ConfigurationError(ErrorCode.OUT_OF_RANGE, problem)
