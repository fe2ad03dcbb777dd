"""Maximise the likelihood of a frame that says little about some aberrations.

Of such an aberration the first derivative of the image says less than the second.  Then the maximum of a
linearised likelihood is far from the state of the optics, on one side and, once they are expanded there, on
the other: :func:`~jitterkit.linearisation.relinearised_scoring` does not settle.
"""

from __future__ import annotations

import equinox as eqx
import numpy as np

from jitterkit.forward import Parameters, parameter_names, to_vector
from jitterkit.likelihood import Data
from jitterkit.linearisation import Expanded, error_per_square
from jitterkit.metric import Prior, invert_information
from jitterkit.optics.otf import OTF
from jitterkit.optics.system import Optics
from jitterkit.scoring import fisher_scoring
from jitterkit.scoring_loop import ScoringResult

_BENT, _STIFFER = (0.25, 0.75), 4.0
"""Ratios of a reduction of the deviance to the one foreseen, below and above which the penalty is multiplied
and divided by a factor."""

_STEPS, _SETTLED = 40, 0.02
"""Steps at most, each with an expansion of the optics (11 to 34 of frames of 3,500 to 22,000 electrons
through 18 hexagons); and the length of the step that remains where they end, in standard errors."""


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

    A step maximises the linearised posterior under the penalty.  It is made if the exact posterior becomes
    larger; the penalty follows how well that was foreseen (Levenberg and Marquardt).

    Parameters
    ----------
    start, optics, data, free, prior, max_steps, tolerance
        As for :func:`~jitterkit.linearisation.relinearised_scoring`.

    Returns
    -------
    expanded : Expanded or None
        Its score, information and curvature are without the penalty.  None where the steps ran out: a mode
        that a symmetric pupil shows by its square only has no derivative where it is zero.
    """

    def values_of(result: ScoringResult) -> np.ndarray:
        return np.asarray(to_vector(result.parameters)[0])[list(free)]

    def exact(parameters: Parameters, otf: OTF) -> ScoringResult:
        return fisher_scoring(parameters, otf, data, free, prior, max_steps=0)

    otf = optics.otf(np.asarray(start.aberrations))
    here, iterations = exact(start, otf), 0
    squares = _squared_phases(start, otf, optics, free)
    stiffness = error_per_square(start)  # a change that is off by one sigma costs a deviance of one
    for _ in range(_STEPS):
        if _left(here) < _SETTLED:
            return Expanded(here._replace(converged=np.asarray(True)), otf, iterations)
        limited = _limited(prior, np.diag(stiffness * squares), values_of(here))
        where = here.parameters, otf, data, free, limited
        end = fisher_scoring(*where, max_steps=max_steps, tolerance=tolerance, known=here.information)
        iterations += int(end.iterations)
        there_otf = optics.otf(np.asarray(end.parameters.aberrations))
        there = exact(end.parameters, there_otf)
        gain = float(here.objective - there.objective)
        beside = _cost(limited, values_of(end)) - _cost(prior, values_of(end))
        foreseen = float(here.objective - end.objective) + beside
        if gain > 0:
            here, otf = there, there_otf
        if not gain > _BENT[0] * foreseen:
            stiffness *= _STIFFER
        elif gain > _BENT[1] * foreseen:
            stiffness /= _STIFFER
    return None


def _left(here: ScoringResult) -> float:
    """Return the length of the step that remains without a penalty, in standard errors."""
    covariance, _ = invert_information(here.curvature)
    return float(np.sqrt(here.score @ covariance @ here.score))


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
    known = np.flatnonzero(np.diag(precision) > 0)
    scale = np.sqrt(np.diag(precision)[known])
    mean = np.array(prior.mean, float)
    unit = precision[np.ix_(known, known)] / np.outer(scale, scale)
    mean[known] = np.linalg.lstsq(unit, pull[known] / scale, rcond=None)[0] / scale
    return eqx.tree_at(lambda p: (p.mean, p.precision), prior, (mean, precision))
