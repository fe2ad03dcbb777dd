"""Maximise the likelihood of a frame that says little about some aberrations.

Of such an aberration the first derivative of the image says less than the second.  Then the maximum of a
linearised likelihood is far from the state of the optics, on one side and, once they are expanded there, on
the other: :func:`~jitterkit.linearisation.relinearised_scoring` does not settle.
"""

from __future__ import annotations

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jitterkit.forward import Parameters, parameter_names, to_vector
from jitterkit.likelihood import Data, deviance
from jitterkit.linearisation import Expanded
from jitterkit.metric import Prior, invert_information
from jitterkit.optics.anchor import SecondOrder
from jitterkit.optics.anchored import THIRD_ORDER, AnchoredOptics, SelfAnchoringOptics
from jitterkit.optics.otf import OTF
from jitterkit.optics.system import OpticalSystem, Optics
from jitterkit.precision import from_parts, to_parts
from jitterkit.scoring import fisher_scoring
from jitterkit.scoring_loop import ScoringResult

_RAISED, _LOWERED, _STUCK = 4.0, 1 / 3, 4.0**16
"""Factors of the penalty: after a step that made things worse, squared after another; at least after one
that did what was foreseen (H. B. Nielsen, IMM-REP-1999-05, Technical University of Denmark); and of the first
to that at which no step makes things better, as at a kink of the likelihood."""

_LEAST = 0.2
"""Share of the information on a combination of aberrations that is left of its curvature at least; 0.1 to 0.6
take the same number of steps."""

_SQUARED = 100.0
"""Ratio to the information from which a mode shows by its square only: 1 to 12 of hexagons, 1e6 and more at
zero of a pupil that is its own mirror image."""

_STEPS, _SETTLED = 40, 0.02
"""Steps at most (3 to 13 of frames of 2,000 to 20,000 electrons through 18 hexagons; up to 27 with the
curvature of the first order); and the length of the step that remains where they end, in standard errors."""


def damped_scoring(
    start: Parameters,
    optics: Optics,
    data: Data,
    free: tuple[int, ...],
    prior: Prior,
    *,
    max_steps: int = 50,
    tolerance: float = 1e-4,
) -> Expanded | None:
    """Maximise the posterior, with a penalty on each change of the wavefront.

    A step maximises the posterior in optics of first order, with what their second order adds to the
    curvature, under the penalty.  It is made if the exact posterior becomes larger; the penalty follows how
    well that was foreseen (Levenberg and Marquardt).

    Parameters
    ----------
    start, optics, data, free, prior, max_steps, tolerance
        As for :func:`~jitterkit.linearisation.relinearised_scoring`.

    Returns
    -------
    expanded : Expanded or None
        Its score, information and curvature are without the penalty.  None where steps ran out or none made
        things better, and at zero of a mode that a symmetric pupil shows by its square only: its information
        is no curvature.
    """

    def values_of(result: ScoringResult) -> np.ndarray:
        return np.asarray(to_vector(result.parameters)[0])[list(free)]

    def exact(parameters: Parameters, otf: OTF) -> ScoringResult:
        return fisher_scoring(parameters, otf, data, free, prior, max_steps=0)

    if isinstance(optics, OpticalSystem):
        optics = SelfAnchoringOptics(optics, abs(float(start.scene.flux)))
    assert isinstance(optics, AnchoredOptics | SelfAnchoringOptics)  # no others have aberrations
    otf = optics.otf(np.asarray(start.aberrations))
    here, iterations = exact(start, otf), 0
    bend, ratio = _bend(here, otf, optics, data, free)
    squares = _squared_phases(start, otf, optics, free)
    # a change that is off by one sigma costs a deviance of one
    stiffness = (THIRD_ORDER * np.sqrt(abs(float(start.scene.flux)))) ** (2 / 3)
    stiffest, raised = _STUCK * stiffness, _RAISED
    for _ in range(_STEPS):
        if stiffness > stiffest:
            break
        if _left(here, bend) < _SETTLED:
            if ratio > _SQUARED:
                break
            return Expanded(here._replace(converged=np.asarray(True)), otf, iterations)
        centre = values_of(here)
        limited = _limited(prior, np.diag(stiffness * squares) + bend, centre)
        where = here.parameters, otf, data, free, limited
        end = fisher_scoring(*where, max_steps=max_steps, tolerance=tolerance, known=here.information)
        iterations += int(end.iterations)
        there_otf = optics.otf(np.asarray(end.parameters.aberrations))
        there = exact(end.parameters, there_otf)
        gain = float(here.objective - there.objective)
        moved = values_of(end) - centre
        beside = _cost(limited, values_of(end)) - _cost(prior, values_of(end)) - moved @ bend @ moved
        foreseen = float(here.objective - end.objective) + beside
        if gain > 0:
            here, otf = there, there_otf
            bend, ratio = _bend(here, otf, optics, data, free)
            share = gain / foreseen if foreseen > 0 else 0.0
            stiffness, raised = stiffness * max(_LOWERED, 1 - (2 * share - 1) ** 3), _RAISED
        else:
            stiffness, raised = stiffness * raised, raised**2
    return None


def _bend(
    here: ScoringResult, otf: OTF, optics, data: Data, free: tuple[int, ...]
) -> tuple[np.ndarray, float]:
    """Return what second derivatives by the aberrations add to the information on free parameters.

    Where they would make the curvature negative, a share of the information is left of it.

    Returns
    -------
    added : (p, p) array
    ratio : float
        Its largest ratio to the information.
    """
    second = optics.second_order(np.asarray(here.parameters.aberrations))
    names = parameter_names(here.parameters, otf.names)
    modes = [i for i in range(len(second.curvature)) if names.index(otf.names[i]) in free]
    added = np.zeros((len(free), len(free)))
    covariance, sound = invert_information(here.curvature)
    if not (modes and sound):
        return added, 0.0
    places = np.ix_(*[[free.index(names.index(otf.names[i])) for i in modes]] * 2)
    bend = np.asarray(_products(here.parameters, otf, data.for_likelihood, second))[np.ix_(modes, modes)]
    unit = np.linalg.cholesky(covariance[places])
    ratios, axes = np.linalg.eigh(unit.T @ bend @ unit)
    way = np.linalg.solve(unit.T, axes)
    added[places] = (way * np.maximum(ratios, _LEAST - 1)) @ way.T
    return added, float(ratios[-1])


@eqx.filter_jit
def _products(parameters: Parameters, otf: OTF, data: Data, second: SecondOrder):
    """Return half of the deviance's derivatives by products of two modes (k, k), by its adjoint."""

    def at(parts):
        return deviance(parameters, replace(otf, value=from_parts(parts)), data)

    adjoint, (i, j) = jax.grad(at)(to_parts(otf.value)), np.indices(2 * (len(second.curvature),))
    rows = second.rows(i.ravel(), j.ravel(), otf.grid)
    return (jnp.tensordot(rows, adjoint.astype(rows.dtype), 3) / 2).reshape(i.shape)


def _left(here: ScoringResult, bend: np.ndarray) -> float:
    """Return the length of the step that remains without a penalty, in standard errors."""
    inverse, _ = invert_information(here.curvature + bend)
    step = inverse @ here.score
    return float(np.sqrt(step @ here.curvature @ step))


def _squared_phases(start: Parameters, otf: OTF, optics: Optics, free: tuple[int, ...]) -> np.ndarray:
    """Return the squared rms phase [rad²] of a unit of each free parameter; zero for all but aberrations."""
    units = np.eye(len(start.aberrations))
    squares = {name: optics.phase(unit) ** 2 for name, unit in zip(otf.names, units, strict=False)}
    names = parameter_names(start, otf.names)
    return np.array([squares.get(names[index], 0.0) for index in free])


def _cost(prior: Prior, values: np.ndarray) -> float:
    """Return a prior's cost of values, without that of the moments."""
    return float((values - prior.mean) @ np.asarray(prior.precision) @ (values - prior.mean))


def _limited(prior: Prior, penalty: np.ndarray, centre: np.ndarray) -> Prior:
    """Return a prior together with a penalty on the distance from a point, but for a constant."""
    precision = np.asarray(prior.precision) + penalty
    pull = np.asarray(prior.precision) @ np.asarray(prior.mean) + penalty @ centre
    known = np.flatnonzero(np.any(precision, axis=1))
    scale = np.sqrt(np.max(np.abs(precision[known]), axis=1))
    mean = np.array(prior.mean, float)
    unit = precision[np.ix_(known, known)] / np.outer(scale, scale)
    mean[known] = np.linalg.lstsq(unit, pull[known] / scale, rcond=None)[0] / scale
    return eqx.tree_at(lambda p: (p.mean, p.precision), prior, (mean, precision))
