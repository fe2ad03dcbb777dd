"""Combine the likelihood summaries of all frames: a filter forwards, a smoother back.

Reach for :func:`combine`.  The summaries are quadratic and the time models linear, so that the answer is
exact: the posterior of a linear Gaussian model, in one sweep each way, with memory for one frame.  The
error of a constant is the Cramér-Rao bound of all frames together.

The filter is Kalman's, for observations that come as score and information; the smoother is that of Bryson
and Frazier, which inverts nothing.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Reversible
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.stats

from jitterkit.joint.filter import DIFFUSE, Filter, Model, measurement_update
from jitterkit.joint.likelihood_summary import LikelihoodSummaries, LikelihoodSummary
from jitterkit.joint.records import RecordFile
from jitterkit.joint.time_models import Constant, OrnsteinUhlenbeck, Polynomial, TimeModel

_UNKNOWN = 0.5
"""Share of the diffuse prior's error above which the frames did not determine a parameter."""

_FALSE_FLAGS = 0.01
"""Frames that chance alone flags in a whole run."""

_ROUNDS = 20

_MOST = 0.25
"""Share of the frames that may be left out."""

_BENDS, _FEW = 2, 12
"""Degree of a constant's slow change while outliers are searched, and frames below which there is none."""


class Shared(NamedTuple):
    """Hold the shared parameters at the time of one frame, as all frames determine them.

    Attributes
    ----------
    values : (k,) array
    errors : (k,) array
    leave_one_out_chi2 : float
        Chi-squared of the frame against all the others.
    dof : int
        Parameters that the frame determines.
    """

    values: np.ndarray
    errors: np.ndarray
    leave_one_out_chi2: float
    dof: int


@dataclass(frozen=True, eq=False)
class Combined:
    """Hold the shared parameters of a run, with their covariance.

    Attributes
    ----------
    names : tuple of str
        Of the shared parameters.
    values : (k,) array
        Of a constant itself, of what changes its mean over the run, or the mean about which it varies.
    covariance : (k, k) array
    slopes, slope_errors : (k,) arrays
        Change from the middle of the run to its end, of what has a polynomial; else zero and NaN.
    evidence : float
        Logarithm of the evidence for the time models, up to a constant of the summaries.
    kept : (n,) bool array
        False where a frame does not belong with the others, and was not counted.
    frames : RecordFile
        One record a frame; read it by :meth:`shared`.
    """

    names: tuple[str, ...]
    values: np.ndarray
    covariance: np.ndarray
    slopes: np.ndarray
    slope_errors: np.ndarray
    evidence: float
    kept: np.ndarray
    frames: RecordFile

    def error(self, name: str) -> float:
        """Return the standard error of a shared parameter."""
        i = self.names.index(name)
        return float(np.sqrt(self.covariance[i, i]))

    def value(self, name: str) -> float:
        """Return a shared parameter."""
        return float(self.values[self.names.index(name)])

    def contradicting(self) -> np.ndarray:
        """Return which frames (n,) contradict all the others by more than chance does in 0.01 of the runs."""
        chi2, limit = _chi2_and_limits(self, len(self.kept))
        return chi2 > limit

    def shared(self) -> Iterator[Shared]:
        """Yield the shared parameters at each frame, in order."""
        k = len(self.names)
        for record in self.frames:
            yield Shared(record[:k], record[k : 2 * k], float(record[2 * k]), int(record[2 * k + 1]))


def combine(
    summaries: LikelihoodSummaries, time_models: Mapping[str, TimeModel], kept: np.ndarray | None = None
) -> Combined:
    """Combine the likelihood summaries of frames.

    Parameters
    ----------
    summaries : LikelihoodSummaries
        At least one.
    time_models : mapping
        How each shared parameter changes, by name; what is not named is constant.
    kept : (n,) bool array, optional
        The frames to count; by default all that do not contradict the others.  Of good frames 0.01 a run is
        left out.

    Returns
    -------
    combined : Combined
    """
    if kept is None:
        kept = consistent_frames(summaries, time_models)
    return _sweep(Model.of(summaries, time_models), summaries, kept)


def consistent_frames(summaries: LikelihoodSummaries, time_models: Mapping[str, TimeModel]) -> np.ndarray:
    """Find the frames that agree with each other.

    Parameters
    ----------
    summaries, time_models
        As for :func:`combine`.

    Returns
    -------
    kept : (n,) bool array

    Notes
    -----
    A constant parameter may change slowly here, so that a slow change is not mistaken for outliers.  Frames
    are excluded from the worst on, each round those with more than a quarter of the greatest chi-squared, and
    are included again when the others no longer contradict them.  If too many frames disagree, none is
    excluded: their scatter shows it.
    """
    bending = Polynomial(_BENDS) if len(summaries) >= _FEW else Constant()
    loose = {name: time_models.get(name, Constant()) for name in summaries.names}
    loose = {name: bending if each == Constant() else each for name, each in loose.items()}
    model, kept = Model.of(summaries, loose), np.ones(len(summaries), bool)
    for _ in range(_ROUNDS):
        chi2, limit = _chi2_and_limits(_sweep(model, summaries, kept), len(summaries))
        worst = np.max(chi2 / limit, where=kept, initial=0.0)
        now = chi2 < limit * np.where(kept, max(1.0, worst / 4), 1.0)
        if np.array_equal(now, kept):
            break
        kept = now
    few = np.sum(~kept) <= max(1, len(kept) * _MOST)
    return kept if few else np.ones(len(kept), bool)  # the errors are wrong, or a time model


def log_likelihood(summaries: LikelihoodSummaries | list[LikelihoodSummary], model: Model) -> float:
    """Return the log-likelihood of a state model, up to a constant of the summaries."""
    run = Filter(model)
    total = 0.0
    for summary in summaries:
        run.predict(summary.time)
        total += run.update(summary)
    return total


def _sweep(model: Model, summaries: LikelihoodSummaries, kept: np.ndarray) -> Combined:
    """Filter forwards and smooth backwards."""
    n = len(model.prior)
    run, predictions, evidence = Filter(model), RecordFile(n + n * n), 0.0
    for summary, counts in zip(summaries, kept, strict=True):
        run.predict(summary.time)
        predictions.append(run.mean, run.covariance)
        evidence += run.update(summary) if counts else 0.0
    smoothed = _smooth(model, summaries, predictions, kept)
    predictions.close()
    bent = np.array([m.states > 1 and not isinstance(m, OrnsteinUhlenbeck) for m in model.time_models])
    means = _final(run, model.first_states)
    slopes = _final(run, model.first_states + bent)  # the state after the mean
    undetermined = np.sqrt(np.diag(run.covariance))[model.first_states] > _UNKNOWN * DIFFUSE
    covariance = np.where(np.add.outer(undetermined, undetermined), np.nan, means[1])
    return Combined(
        names=model.names,
        values=model.origin + means[0],
        covariance=covariance,
        slopes=np.where(bent, slopes[0], 0.0),
        slope_errors=np.where(bent, np.sqrt(np.diag(slopes[1])), np.nan),
        evidence=evidence,
        kept=kept,
        frames=_reversed(smoothed),
    )


def _final(run: Filter, index: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return values and covariance of some states after all frames, in the parameters' units."""
    scale = run.model.scale
    return run.mean[index] * scale, run.covariance[np.ix_(index, index)] * np.outer(scale, scale)


def _smooth(
    model: Model, summaries: Reversible[LikelihoodSummary], predictions: RecordFile, kept: np.ndarray
) -> RecordFile:
    """Return the records of :class:`Shared`, the last frame first."""
    n, k = len(model.prior), len(model.names)
    found = RecordFile(2 * k + 2)
    adjoint, adjoint_information, later = np.zeros(n), np.zeros((n, n)), None
    for summary, record, counts in zip(reversed(summaries), reversed(predictions), kept[::-1], strict=True):
        mean, covariance = record[:n], record[n:].reshape(n, n)
        if later is not None:
            left = model.memory(later - summary.time)
            adjoint, adjoint_information = left * adjoint, adjoint_information * np.outer(left, left)
        later = summary.time
        rows = model.rows(summary.time)
        if counts:
            gain, (innovation, innovation_information), rows, _ = measurement_update(
                model, mean, covariance, summary
            )
            keep = np.eye(n) - gain @ innovation_information @ rows
            adjoint = keep.T @ adjoint - rows.T @ innovation
            adjoint_information = keep.T @ adjoint_information @ keep + rows.T @ innovation_information @ rows
        state = rows @ (mean - covariance @ adjoint)
        spread = rows @ (covariance - covariance @ adjoint_information @ covariance) @ rows.T
        chi2, dof = _leave_one_out_chi2(*model.scaled(summary), state, spread, bool(counts))
        errors = np.sqrt(np.diag(spread).clip(0)) * model.scale
        found.append(model.origin + state * model.scale, errors, chi2, dof)
    return found


def _leave_one_out_chi2(at, score, information, state, spread, counted: bool) -> tuple[float, int]:
    """Return chi-squared of a summary against all other frames, and its degrees of freedom."""
    slope = score - information @ (state - at)
    if counted:  # exclude the frame's own contribution
        free = np.linalg.solve(
            np.eye(len(at)) - spread @ information, np.column_stack([spread, spread @ slope])
        )
        spread, slope = free[:, :-1], slope + information @ free[:, -1]
    both = information + information @ spread @ information
    values, vectors = np.linalg.eigh((both + both.T) / 2)
    determined = values > 1e-9 * values[-1]
    return float(np.sum((vectors[:, determined].T @ slope) ** 2 / values[determined])), int(determined.sum())


def _chi2_and_limits(combined: Combined, frames: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the leave-one-out chi-squared of each frame, and the limit above which it is an outlier."""
    both = np.array([(one.leave_one_out_chi2, one.dof) for one in combined.shared()])
    chance = _FALSE_FLAGS / frames
    return both[:, 0], np.asarray(scipy.stats.chi2.isf(chance, np.maximum(both[:, 1], 1)))


def _reversed(records: RecordFile) -> RecordFile:
    turned = RecordFile(records.width)
    for record in reversed(records):
        turned.append(record)
    records.close()
    return turned
