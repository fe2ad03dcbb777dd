"""The loop of Fisher scoring, a single compiled program.

Only the score decides where the iteration ends, so only the score is exact: one image in 64 bits and its
adjoint.  The information takes a derivative of the image by every parameter, several times the work; it is
computed in 32 bits, at the start, and again only where the steps since then show that it is wrong.

Later frames of a run have derivatives by the aberrations on a smaller grid only.  There the image changes
with the aberrations by the derivatives that the information was computed from, for three quarters of the
work.  Score and image are then of first order in the aberrations about the state of the optics: fits end up
to 0.008 of an error off, rms (``scripts/solver_study``).
"""

from __future__ import annotations

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jitterkit.forward import Parameters, parameter_names, to_vector
from jitterkit.likelihood import WavefrontSlopes, deviance_and_score, information_at
from jitterkit.loci.simple import AnySimple
from jitterkit.metric import LEAST_DAMPING, Metric
from jitterkit.optics.otf import OTF

ROUNDING_TOLERANCE = 0.1
"""Largest distance from the maximum, in standard errors, at which rounding may end a fit."""

_KINK_TOLERANCE = 1e-4
"""Largest distance from the maximum, in standard errors, at a kink (a pixel reaches its lower bound)."""

_RENEWAL_ERROR, FINAL_ERROR = 0.25, 0.005
"""Relative error of the information up to which it serves: about a step, for more steps; about the way from
where it was computed, at the end.  Errors are then off by 0.9 % at most, by ``scripts/solver_study``.  With
half as much at the end, it was renewed in four of five later frames of a run, where it served already."""

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


@eqx.filter_jit
def scoring_loop(start, otf, data, free, prior, known, max_steps, tolerance, final_error) -> ScoringResult:
    """Iterate from a start, as :func:`jitterkit.scoring.fisher_scoring` has it, in one compiled program.

    All arguments but ``free`` are arrays or hold some, so that other numbers are no other program.
    ``final_error`` is the relative error of the information that may be left at the end.
    """
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
        where, slopes = (parameters_at(values), otf, data, free), None
        if linear is None:
            given = ~started & jnp.any(known != 0) & jnp.all(jnp.isfinite(known))
            information = jax.lax.cond(given, lambda: known, lambda: information_at(*where)[0])
        else:
            information, every = information_at(*where)
            slopes = every[linear[0]].astype(values.dtype)
        return Metric.of(information, prior.stiffness(jax.jacfwd(moments_at)(values))), slopes

    def step(state: _State) -> _State:
        here, metric, evaluated = state.here, state.metric, state.evaluated
        move = jnp.where(evaluated, metric.step(here.score, state.damping), 0.0)
        there = evaluate(here.values + move, state.slopes)
        better = ~evaluated | (there.objective <= here.objective * (1 + rounding))
        wrong = metric.prediction_error(move, there.score - here.score)
        here = jax.tree.map(lambda new, old: jnp.where(better, new, old), there, here)
        origin = jax.tree.map(lambda old, new: jnp.where(evaluated, old, new), state.origin, here)
        way = here.values - origin.values, here.score - origin.score
        moved = state.moved | (evaluated & better)
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
            damping=jnp.where(evaluated, damping, state.damping),
            left=left,
            wrong=jnp.where(moved, metric.prediction_error(*way), 0.0),
            moved=moved,
            usable=~evaluated | jnp.where(better, wrong < _RENEWAL_ERROR, ~state.moved),
            converged=(left < tolerance) | lost_in_rounding | at_kink,
            # the same point by other slopes is no step
            iterations=state.iterations + (evaluated | (state.iterations < 0)),
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
