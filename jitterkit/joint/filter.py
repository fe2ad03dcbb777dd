"""A Kalman filter for observations that are scores and information.

Reach for :class:`Filter`, or for :func:`jitterkit.joint.combine.combine`, which runs it over all frames and
back.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from jitterkit.joint.likelihood_summary import LikelihoodSummaries, LikelihoodSummary
from jitterkit.joint.time_models import Constant, TimeModel

DIFFUSE = 1e3
"""Prior error of what nothing is known about, in errors of the first frame: costs a millionth of a frame."""


class Model:
    """The linear state behind the shared parameters, in units of one frame's errors.

    Parameters
    ----------
    names : tuple of str
        Of the shared parameters.
    time_models : mapping
        Of each, by name; what is not named is constant.
    first : LikelihoodSummary
        Of a frame; gives the units and the origin.
    span : (float, float)
        Times of the first and the last frame.
    """

    def __init__(
        self,
        names: tuple[str, ...],
        time_models: Mapping[str, TimeModel],
        first: LikelihoodSummary,
        span: tuple[float, float],
    ) -> None:
        self.names = names
        self.time_models = [time_models.get(name, Constant()) for name in names]
        self.origin = first.at
        self.scale = first.errors
        self.owner = np.repeat(np.arange(len(self.time_models)), [each.states for each in self.time_models])
        self.first_states = np.searchsorted(self.owner, np.arange(len(self.time_models)))
        self.middle, self.half = (span[0] + span[1]) / 2, max((span[1] - span[0]) / 2, 1e-12)
        variance = (
            np.concatenate([each.variance() for each in self.time_models]) / self.scale[self.owner] ** 2
        )
        self.prior = np.where(np.isinf(variance), DIFFUSE**2, variance)

    @classmethod
    def of(cls, summaries: LikelihoodSummaries, time_models: Mapping[str, TimeModel]) -> Model:
        """Build the model of a run from its likelihood summaries."""
        first, last = next(iter(summaries)), next(iter(reversed(summaries)))
        return cls(summaries.names, time_models, first, (first.time, last.time))

    def rows(self, time: float) -> np.ndarray:
        """Return the matrix (k, states) that gives the shared parameters from the state."""
        u = (time - self.middle) / self.half
        rows = np.zeros((len(self.time_models), len(self.owner)))
        rows[self.owner, np.arange(len(self.owner))] = np.concatenate(
            [each.row(u) for each in self.time_models]
        )
        return rows

    def memory(self, seconds: float) -> np.ndarray:
        """Return the share of each state that is left after a time."""
        return np.concatenate([each.memory(seconds) for each in self.time_models])

    def scaled(self, summary: LikelihoodSummary) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return point, score and information of a summary in the model's units."""
        at = (summary.at - self.origin) / self.scale
        return at, summary.score * self.scale, summary.information * np.outer(self.scale, self.scale)


class Filter:
    """Hold what the frames so far say about the state.

    Parameters
    ----------
    model : Model
    """

    def __init__(self, model: Model) -> None:
        self.model = model
        self.mean, self.covariance = np.zeros(len(model.prior)), np.diag(model.prior)
        self._time: float | None = None

    def predict(self, time: float) -> None:
        """Predict the state at a time."""
        if self._time is not None and time != self._time:
            left = self.model.memory(time - self._time)
            self.mean = left * self.mean
            noise = np.diag(self.model.prior * (1 - left**2))
            self.covariance = self.covariance * np.outer(left, left) + noise
        self._time = time

    def update(self, summary: LikelihoodSummary) -> float:
        """Update the state by a frame, and return its log-likelihood given those before."""
        gain, (innovation, innovation_information), _, evidence = measurement_update(
            self.model, self.mean, self.covariance, summary
        )
        self.mean = self.mean + gain @ innovation
        covariance = self.covariance - gain @ innovation_information @ gain.T
        self.covariance = (covariance + covariance.T) / 2
        return evidence

    def shared(self) -> np.ndarray:
        """Return the shared parameters (k,) as they are known now."""
        assert self._time is not None
        return self.model.origin + self.model.rows(self._time) @ self.mean * self.model.scale


def measurement_update(model: Model, mean, covariance, summary: LikelihoodSummary):
    """Compute the update of a state by a likelihood summary.

    Returns
    -------
    gain : (states, k) array
        Covariance of the state with the shared parameters.
    innovation : ((k,), (k, k)) arrays
        Score and information of the summary, weighted by the uncertainty of the prediction.
    rows : (k, states) array
    evidence : float
        Logarithm of the summary's likelihood under the prediction.
    """
    rows = model.rows(summary.time)
    at, score, information = model.scaled(summary)
    gain = covariance @ rows.T
    spread = rows @ gain
    off = rows @ mean - at
    slope = score - information @ off
    weighted = np.eye(len(at)) + information @ spread
    both = np.linalg.solve(weighted, np.column_stack([slope, information]))
    innovation, innovation_information = both[:, 0], (both[:, 1:] + both[:, 1:].T) / 2
    evidence = -np.linalg.slogdet(weighted)[1] / 2 + slope @ spread @ innovation / 2
    evidence += off @ score - off @ information @ off / 2
    return gain, (innovation, innovation_information), rows, float(evidence)
