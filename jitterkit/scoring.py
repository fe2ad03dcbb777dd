"""Damped Fisher scoring: the one way in which jitterkit maximises a likelihood.

The step is ``(F + λ diag F)⁻¹ g`` with the expected information F and the score g (Levenberg and
Marquardt's damping of what the paper calls natural gradient descent).  It is invariant to the units
of the parameters, and the loop is a single compiled program: no Python between its steps.

Only the score decides where the iteration ends, so only the score is exact: one image in 64 bits and its
adjoint.  The information takes a derivative of the image by every parameter, several times the work; it is
computed in 32 bits, at the start, and again only where the steps since then show that it is wrong.

Of frames like one before, derivatives by the aberrations are on a smaller grid only.  There the image changes
with the aberrations by the derivatives that the information was computed from, which costs a third.  Score
and image are then of first order in the aberrations about the state of the optics: fits end up to 0.01 of an
error off, rms.
"""

from __future__ import annotations

from collections.abc import Collection
from itertools import pairwise
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jitterkit.errors import ErrorCode, refuse_if
from jitterkit.forward import Parameters, free_parameters, parameter_names, to_vector
from jitterkit.likelihood import Data, WavefrontSlopes, deviance_and_score, information_at
from jitterkit.loci.simple import AnySimple
from jitterkit.metric import LEAST_DAMPING, Metric, Prior, invert_information
from jitterkit.optics.otf import OTF

ROUNDING_TOLERANCE = 0.1
"""Largest distance from the maximum, in standard errors, at which rounding may end a fit."""

_KINK_TOLERANCE = 1e-4
"""Largest distance from the maximum, in standard errors, at a kink (a pixel reaches its lower bound)."""

_RENEWAL_ERROR, _FINAL_ERROR = 0.25, 0.005
"""Relative error of the information up to which it serves: about a step, for more steps; about the way from
where it was computed, at the end.  Errors are then off by 0.9 % at most, by ``scripts/solver_study``.  With
half as much at the end, it was renewed in four of five frames like one before, where it served already."""

_DAMPING_START, _DAMPING_MOST = 1e-3, 1e8


class ScoringResult(NamedTuple):
    """Hold the end point of an iteration.

    Attributes
    ----------
    parameters : Parameters
    information : (p, p) array
        Of the frame alone, at the end or so near that errors differ by less than 1 %.
    curvature : (p, p) array
        Of the posterior: the information plus the prior's.
    objective : float
        Deviance plus the prior's quadratic forms.
    score : (p,) array
        Slope of the log-posterior at the end: zero at a maximum, but not at a streak of zero length.
    converged : bool
        Whether the step that remains is shorter than the tolerance.
    iterations : int
    """

    parameters: Parameters
    information: Float[Array | np.ndarray, "p p"]
    curvature: Float[Array | np.ndarray, "p p"]
    objective: Float[Array | np.ndarray, ""]
    score: Float[Array | np.ndarray, " p"]
    converged: Bool[Array | np.ndarray, ""]
    iterations: Int[Array | np.ndarray, ""]


class _Point(NamedTuple):
    """Hold a point of the iteration, with the posterior and its slope there."""

    values: Array
    objective: Array
    score: Array


class _State(NamedTuple):
    """Hold the state of an iteration.

    Attributes
    ----------
    here : _Point
    origin : _Point
        Where the metric was computed, or first used.
    metric : Metric
    slopes : (k, ny, nx) array or None
        Derivatives of the image by aberrations, where the metric was computed; None where the optics have
        them.
    evaluated : bool
        Whether the posterior at ``here`` is known, by these slopes.
    left : float
        Standard errors that the step from here would be long.
    wrong : float
        By how much the metric is wrong about the way from the origin, as a share of it.
    moved : bool
        Whether a step has been made since then.
    usable : bool
        Whether the metric is good enough to go on with.
    iterations : int
        Steps tried; -1 until the start is evaluated.
    finished : bool
        Whether the metric is that of the end too.
    """

    here: _Point
    origin: _Point
    metric: Metric
    slopes: Array | None
    evaluated: Array
    damping: Array
    left: Array
    wrong: Array
    moved: Array
    usable: Array
    converged: Array
    iterations: Array
    finished: Array


def fisher_scoring(
    start: Parameters,
    otf: OTF,
    data: Data,
    free: tuple[int, ...],
    prior: Prior,
    *,
    max_steps: int = 50,
    tolerance: float = 1e-4,
    known: Float[Array | np.ndarray, "p p"] | None = None,
    errors: bool = True,
) -> ScoringResult:
    """Maximise the posterior from a starting point.

    Parameters
    ----------
    start : Parameters
    otf : OTF
        Aberrations enter to first order about its state.
    data : Data
    free : tuple of int
        Positions in the parameter vector that vary, ascending.
    prior : Prior
    max_steps : int
        Largest number of evaluations, rejected ones included.
    tolerance : float
        Length of a step, in standard errors, below which the iteration has converged.
    known : (p, p) array, optional
        Information near the start, to begin with: it is renewed where it turns out to be wrong.  Not used
        where the derivatives that belong to it are needed too.
    errors : bool
        Whether errors at the end are wanted; otherwise the information is the last that served for a step.

    Returns
    -------
    result : ScoringResult

    Raises
    ------
    ConfigurationError
        If the positions do not ascend.
    """
    problem = f"The positions of free parameters must ascend, and {free} do not; sort them."
    refuse_if(any(one >= other for one, other in pairwise(free)), ErrorCode.MALFORMED, problem)
    known = np.zeros((len(free), len(free))) if known is None else known
    # as arrays, so that another number of steps is not another program
    limits = np.asarray(max_steps), np.asarray(tolerance), np.asarray(_FINAL_ERROR if errors else np.inf)
    # nor is a ceiling that the likelihood does not ask for, nor another simple locus
    data, simple = data.for_likelihood, AnySimple.instead_of(start.locus)
    if simple is None:
        return _in_numpy(_scoring_loop(start, otf, data, free, prior, known, *limits))
    filled, own = _filled_up(start, simple, free)
    places, square = np.eye(len(filled))[:, own], np.ix_(own, own)
    prior, known = _in_numpy((prior, known))
    precision = places @ prior.precision @ places.T + np.diag(1 - places.sum(axis=1))
    wider = Prior(places @ prior.mean, precision, prior.moments, prior.moments_precision)
    known = places @ known @ places.T
    end = _in_numpy(_scoring_loop(start.with_locus(simple), otf, data, filled, wider, known, *limits))
    coords = end.parameters.locus.coords[: len(start.locus.names)]
    return end._replace(
        parameters=end.parameters.with_locus(start.locus.at(coords)),
        information=end.information[square],
        curvature=end.curvature[square],
        score=end.score[own],
    )


def _filled_up(
    start: Parameters, simple: AnySimple, free: tuple[int, ...]
) -> tuple[tuple[int, ...], np.ndarray]:
    """Return the positions of what varies with a locus in its common form, and which of these are its own."""
    size = len(start.locus.names)
    first = sum(np.size(leaf) for leaf in jax.tree.leaves(start.scene)) + size
    lacking = range(first, first + len(simple.names) - size)
    before = sum(index < first for index in free)
    filled = (*free[:before], *lacking, *(index + len(lacking) for index in free[before:]))
    own = np.delete(np.arange(len(filled)), range(before, before + len(lacking)))
    return filled, own


def _in_numpy(tree):
    """Return a tree with arrays of NumPy, with which small sums are fast, but for what a program traces."""
    return jax.tree.map(lambda a: a if isinstance(a, jax.core.Tracer) else np.asarray(a), tree)


@eqx.filter_jit
def _scoring_loop(start, otf, data, free, prior, known, max_steps, tolerance, final_error) -> ScoringResult:
    vector, unravel = to_vector(start)
    index = np.asarray(free, int)
    varies = np.isin(np.arange(len(vector)), index)
    cuts = np.flatnonzero(np.diff(varies)) + 1
    own_cuts = np.cumsum(varies)[cuts - 1]

    def parameters_at(values):
        # in pieces, since a scatter and its derivatives are compiled to loops
        pieces = zip(jnp.split(vector, cuts), jnp.split(values, own_cuts), strict=True)
        return unravel(jnp.concatenate([new if new.size else held for held, new in pieces]))

    def moments_at(values):
        return parameters_at(values).locus.moments()

    linear = _linear_aberrations(start, otf, free)

    def evaluate(values, slopes) -> _Point:
        wavefront = None
        if linear is not None:
            places, rows = linear
            wavefront = WavefrontSlopes(places, otf.state[rows], slopes)
        deviance, score = deviance_and_score(parameters_at, values, otf, data, wavefront)
        moments, adjoint = jax.vjp(moments_at, values)
        objective = sum(prior.costs(values, moments), deviance)
        (beside,) = adjoint(prior.moments_precision @ (moments - prior.moments))
        valid = parameters_at(values).scene.is_valid() & jnp.isfinite(objective)
        pull = prior.precision @ (values - prior.mean) + beside
        return _Point(values, jnp.where(valid, objective, jnp.inf), score - pull)

    def metric_at(values, started) -> tuple[Metric, Array | None]:
        def computed():
            return information_at(parameters_at(values), otf, data, free)

        if linear is None:
            given = ~started & jnp.any(known != 0) & jnp.all(jnp.isfinite(known))
            information, slopes = jax.lax.cond(given, lambda: known, lambda: computed()[0]), None
        else:
            information, slopes = computed()
            slopes = slopes[linear[0]].astype(values.dtype)
        return Metric.of(information, prior.stiffness(jax.jacfwd(moments_at)(values))), slopes

    def step(state: _State) -> _State:
        here, metric, known_here = state.here, state.metric, state.evaluated
        move = jnp.where(known_here, metric.step(here.score, state.damping), 0.0)
        there = evaluate(here.values + move, state.slopes)
        better = ~known_here | (there.objective <= here.objective * (1 + rounding))
        wrong = metric.prediction_error(move, there.score - here.score)
        here = jax.tree.map(lambda new, old: jnp.where(better, new, old), there, here)
        origin = jax.tree.map(lambda old, new: jnp.where(known_here, old, new), state.origin, here)
        way = here.values - origin.values, here.score - origin.score
        moved = state.moved | (known_here & better)
        damping = jnp.where(better, state.damping / 10, state.damping * 10)
        damping = jnp.clip(damping, LEAST_DAMPING, _DAMPING_MOST)
        left = metric.length(here.score)
        # a step of so many standard errors changes the objective by their square, which rounding may hide
        lost_in_rounding = (
            ~better & (left**2 < rounding * jnp.abs(here.objective)) & (left < ROUNDING_TOLERANCE)
        )
        at_kink = ~better & (damping == _DAMPING_MOST) & (left < _KINK_TOLERANCE)
        return state._replace(
            here=here,
            origin=origin,
            evaluated=jnp.asarray(True),
            damping=jnp.where(known_here, damping, state.damping),
            left=left,
            wrong=jnp.where(moved, metric.prediction_error(*way), 0.0),
            moved=moved,
            usable=~known_here | jnp.where(better, wrong < _RENEWAL_ERROR, ~state.moved),
            converged=(left < tolerance) | lost_in_rounding | at_kink,
            # the same point by other slopes is no step
            iterations=state.iterations + (known_here | (state.iterations < 0)),
        )

    def renew_and_iterate(state: _State) -> _State:
        """Renew the metric, and iterate while it serves."""
        out_of_steps, started = state.iterations >= max_steps, state.iterations >= 0
        metric, slopes = metric_at(state.here.values, started)
        evaluated = started if linear is None else jnp.asarray(False)  # by these slopes it is not
        left = jnp.where(started, metric.length(state.here.score), jnp.inf)
        state = state._replace(
            metric=metric,
            slopes=slopes,
            evaluated=evaluated,
            origin=state.here,
            left=left,
            wrong=jnp.zeros_like(left),
            moved=jnp.asarray(False),
            usable=jnp.asarray(True),
            converged=evaluated & (left < tolerance),
        )
        state = jax.lax.while_loop(
            lambda s: (~s.converged & s.usable & (s.iterations < max_steps)) | ~s.evaluated, step, state
        )
        return state._replace(finished=out_of_steps | (state.converged & (state.wrong < final_error)))

    # what rounding leaves to be decided: of the deviance, and of a step in standard errors
    rounding = 10 * jnp.finfo(vector.dtype).eps
    tolerance = jnp.maximum(tolerance, 30 * jnp.sqrt(jnp.finfo(vector.dtype).eps))
    kind, size = vector.dtype, len(index)
    infinite, no, square = jnp.asarray(jnp.inf, kind), jnp.asarray(False), jnp.zeros((size, size), kind)
    unknown = _Point(vector[index], infinite, jnp.zeros(size, kind))
    state = _State(
        unknown,
        unknown,
        Metric(square, square, square[0], square),
        None if linear is None else jnp.zeros((len(linear[0]), *otf.grid.shape), kind),
        no,
        jnp.asarray(_DAMPING_START, kind),
        infinite,
        jnp.zeros((), kind),
        no,
        jnp.asarray(True),
        no,
        jnp.asarray(-1),  # the first only evaluates the start
        no,
    )
    last = jax.lax.while_loop(lambda s: ~s.finished, renew_and_iterate, state)
    return ScoringResult(
        parameters_at(last.here.values),
        last.metric.information,
        last.metric.curvature,
        last.here.objective,
        last.here.score,
        last.converged,
        last.iterations,
    )


def _linear_aberrations(
    start: Parameters, otf: OTF, free: tuple[int, ...]
) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the places, among what is free and among the optics' names, of aberrations without slopes.

    None where the optics have the slopes of all, or where one of them is not free; and for loci that are not
    simple, whose fits take many steps: these ended at other maxima by slopes that are renewed in each.
    """
    lacking = {*otf.names[: otf.apart], *otf.names[otf.rows :]} & set(otf.varied(start.scene))
    every = parameter_names(start, otf.names)
    fitted = [every[i] for i in free]
    if not otf.apart or not isinstance(start.locus, AnySimple) or not lacking.issubset(fitted):
        return None
    rows = [i for i, name in enumerate(otf.names) if name in lacking]
    return np.array([fitted.index(otf.names[i]) for i in rows]), np.array(rows)


def fisher_scoring_without_prior(
    start: Parameters,
    otf: OTF,
    data: Data,
    hold: Collection[str],
    max_steps: int,
    known: Float[Array | np.ndarray, "p p"] | None = None,
) -> tuple[ScoringResult, np.ndarray]:
    """Take a few steps of Fisher scoring without a prior.

    Parameters
    ----------
    start : Parameters
    otf : OTF
    data : Data
    hold : collection of str
        Parameters to keep as they are.
    max_steps : int
        Largest number of evaluations, rejected ones included.
    known : (p, p) array, optional
        Information near the start.

    Returns
    -------
    end : ScoringResult
    covariance : (k, k) array
        Of the locus's free coordinates there; NaN where the frame does not determine the parameters.
    """
    names, free = free_parameters(start, otf, hold)
    end = fisher_scoring(start, otf, data, free, Prior.none(len(free)), max_steps=max_steps, known=known)
    index = [names.index(name) for name in start.locus.names if name in names]
    covariance, _ = invert_information(end.information)
    return end, covariance[np.ix_(index, index)]
