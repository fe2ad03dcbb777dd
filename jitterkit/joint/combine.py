"""What all frames together say about what they share: a filter forwards over their messages, a smoother back.

Reach for :func:`combine`.  The messages are quadratic and the laws of change linear, so that the answer is
exact: the posterior of a linear Gaussian model, in one sweep each way, with memory for one frame.  The
error of a constant is the Cramér-Rao bound of all frames together.

The filter is Kalman's, for observations that come as score and information; the smoother is that of Bryson
and Frazier, which inverts nothing.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Reversible
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.stats

from jitterkit.joint.filter import DIFFUSE, Filter, Model, update
from jitterkit.joint.laws import Constant, Law, Polynomial, Wander
from jitterkit.joint.message import Message, Messages
from jitterkit.joint.spool import Spool

__all__ = ["Combined", "Shared", "belonging", "combine", "log_likelihood"]

_UNKNOWN = 0.5
"""Share of the diffuse prior's error above which the frames did not determine a parameter."""

_FALSE_FLAGS = 0.01
"""Frames that chance alone flags in a whole run."""

_ROUNDS = 20

_MOST = 0.25
"""Share of the frames that may be left out."""

_BENDS, _FEW = 2, 12
"""Degree of a constant's slow change while frames are judged, and frames below which there is none."""


class Shared(NamedTuple):
    """The shared parameters at the time of one frame, as all frames know them.

    Attributes
    ----------
    values : (k,) array
    errors : (k,) array
    surprise : float
        Chi-squared of the frame against all the others.
    dof : int
        Parameters that the frame determines.
    """

    values: np.ndarray
    errors: np.ndarray
    surprise: float
    dof: int


@dataclass(frozen=True, eq=False)
class Combined:
    """What the frames of a run say together.

    Attributes
    ----------
    names : tuple of str
        Of the shared parameters.
    values : (k,) array
        Of a constant itself, of what changes its mean over the run, or the mean that it wanders about.
    covariance : (k, k) array
    slopes, slope_errors : (k,) arrays
        Change from the middle of the run to its end, of what has a polynomial; else zero and NaN.
    evidence : float
        Logarithm of the evidence for the laws, up to a constant of the messages.
    kept : (n,) bool array
        False where a frame does not belong with the others, and was not counted.
    frames : Spool
        One record a frame; read it by :meth:`shared`.
    """

    names: tuple[str, ...]
    values: np.ndarray
    covariance: np.ndarray
    slopes: np.ndarray
    slope_errors: np.ndarray
    evidence: float
    kept: np.ndarray
    frames: Spool

    def error(self, name: str) -> float:
        """Standard error of a shared parameter."""
        i = self.names.index(name)
        return float(np.sqrt(self.covariance[i, i]))

    def value(self, name: str) -> float:
        """A shared parameter."""
        return float(self.values[self.names.index(name)])

    def shared(self) -> Iterator[Shared]:
        """The shared parameters at each frame, in order."""
        k = len(self.names)
        for record in self.frames:
            yield Shared(record[:k], record[k : 2 * k], float(record[2 * k]), int(record[2 * k + 1]))


def combine(
    messages: Messages, laws: Mapping[str, Law], *, flag: bool = True, kept: np.ndarray | None = None
) -> Combined:
    """Combine the messages of frames.

    Parameters
    ----------
    messages : Messages
        At least one.
    laws : mapping
        How each shared parameter changes, by name; what is not named is constant.
    flag : bool
        Whether to leave out frames that contradict the others.  Of good frames 0.01 a run is left out.
    kept : (n,) bool array, optional
        The frames to count, where that has been decided.

    Returns
    -------
    combined : Combined
    """
    if kept is None:
        kept = belonging(messages, laws) if flag else np.ones(len(messages), bool)
    return _sweep(Model.of(messages, laws), messages, kept)


def belonging(messages: Messages, laws: Mapping[str, Law]) -> np.ndarray:
    """Which frames belong together.

    Parameters
    ----------
    messages, laws
        As for :func:`combine`.

    Returns
    -------
    kept : (n,) bool array

    Notes
    -----
    What is said to be constant may bend here, so that a slow change is not mistaken for frames that do not
    belong.  Frames are left out from the worst on, each round those with more than a quarter of the greatest
    surprise, and come back when the others no longer contradict them.  Of frames that disagree all over none
    is left out: their scatter says so.
    """
    bending = Polynomial(_BENDS) if len(messages) >= _FEW else Constant()
    loose = {name: laws.get(name, Constant()) for name in messages.names}
    loose = {name: bending if law == Constant() else law for name, law in loose.items()}
    model, kept = Model.of(messages, loose), np.ones(len(messages), bool)
    for _ in range(_ROUNDS):
        surprise, limit = _surprises(_sweep(model, messages, kept), len(messages))
        worst = np.max(surprise / limit, where=kept, initial=0.0)
        now = surprise < limit * np.where(kept, max(1.0, worst / 4), 1.0)
        if np.array_equal(now, kept):
            break
        kept = now
    few = np.sum(~kept) <= max(1, len(kept) * _MOST)
    return kept if few else np.ones(len(kept), bool)  # it is the errors, or a law, that are wrong


def log_likelihood(messages: Messages | list[Message], model: Model) -> float:
    """Logarithm of the likelihood of a model of change, up to a constant of the messages."""
    run = Filter(model)
    total = 0.0
    for message in messages:
        run.move(message.time)
        total += run.hear(message)
    return total


class _Step(NamedTuple):
    """The filter at one frame, before it has heard the frame."""

    mean: np.ndarray
    covariance: np.ndarray
    evidence: float


def _filter(model: Model, messages: Iterable[Message], kept: np.ndarray) -> Iterator[_Step]:
    """Predictions frame by frame, and a last one after all; each with the evidence of the frame before."""
    run, evidence = Filter(model), 0.0
    for message, counts in zip(messages, kept, strict=True):
        run.move(message.time)
        yield _Step(run.mean, run.covariance, evidence)
        evidence = run.hear(message) if counts else 0.0
    yield _Step(run.mean, run.covariance, evidence)


def _sweep(model: Model, messages: Messages, kept: np.ndarray) -> Combined:
    """Filter forwards and smooth backwards."""
    n, k = len(model.prior), len(model.names)
    predictions, evidence = Spool(n + n * n), 0.0
    last = None
    for last in _filter(model, messages, kept):
        evidence += last.evidence
        if len(predictions) < len(messages):
            predictions.append(last.mean, last.covariance)
    assert last is not None
    smoothed = _smooth(model, messages, predictions, kept)
    predictions.close()
    means = _final(model, last, model.first_states)
    bends = [
        slot + 1 if law.states > 1 and not isinstance(law, Wander) else slot
        for slot, law in zip(model.first_states, model.laws, strict=True)
    ]
    bent = np.array([b != slot for b, slot in zip(bends, model.first_states, strict=True)])
    slopes = _final(model, last, np.array(bends))
    undetermined = np.sqrt(np.diag(last.covariance))[model.first_states] > _UNKNOWN * DIFFUSE
    covariance = np.where(np.add.outer(undetermined, undetermined), np.nan, means[1])
    return Combined(
        names=model.names,
        values=model.origin + means[0],
        covariance=covariance,
        slopes=np.where(bent, slopes[0], 0.0),
        slope_errors=np.where(bent, np.sqrt(np.diag(slopes[1])), np.nan),
        evidence=evidence,
        kept=kept,
        frames=_turned_round(smoothed, 2 * k + 2),
    )


def _final(model: Model, last: _Step, slots: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values and covariance of some states after all frames, in the parameters' units."""
    return last.mean[slots] * model.scale, last.covariance[np.ix_(slots, slots)] * np.outer(
        model.scale, model.scale
    )


def _smooth(model: Model, messages: Reversible[Message], predictions: Spool, kept: np.ndarray) -> Spool:
    """Records of :class:`Shared`, the last frame first."""
    n, k = len(model.prior), len(model.names)
    found = Spool(2 * k + 2)
    push, stiff, later = np.zeros(n), np.zeros((n, n)), None
    for message, record, counts in zip(reversed(messages), reversed(predictions), kept[::-1], strict=True):
        mean, covariance = record[:n], record[n:].reshape(n, n)
        if later is not None:
            left = model.memory(later - message.time)
            push, stiff = left * push, stiff * np.outer(left, left)
        later = message.time
        rows = model.rows(message.time)
        if counts:
            gain, (tight, firm), rows, _ = update(model, mean, covariance, message)
            keep = np.eye(n) - gain @ firm @ rows
            push = keep.T @ push - rows.T @ tight
            stiff = keep.T @ stiff @ keep + rows.T @ firm @ rows
        state = rows @ (mean - covariance @ push)
        spread = rows @ (covariance - covariance @ stiff @ covariance) @ rows.T
        surprise, dof = _surprise(*model.told(message), state, spread, bool(counts))
        errors = np.sqrt(np.diag(spread).clip(0)) * model.scale
        found.append(model.origin + state * model.scale, errors, surprise, dof)
    return found


def _surprise(at, score, information, state, spread, counted: bool) -> tuple[float, int]:
    """Chi-squared of a message against what all other frames say, and its degrees of freedom."""
    slope = score - information @ (state - at)
    if counted:  # what the frame itself has said is taken out again
        free = np.linalg.solve(
            np.eye(len(at)) - spread @ information, np.column_stack([spread, spread @ slope])
        )
        spread, slope = free[:, :-1], slope + information @ free[:, -1]
    both = information + information @ spread @ information
    values, vectors = np.linalg.eigh((both + both.T) / 2)
    told = values > 1e-9 * values[-1]
    return float(np.sum((vectors[:, told].T @ slope) ** 2 / values[told])), int(told.sum())


def _surprises(combined: Combined, frames: int) -> tuple[np.ndarray, np.ndarray]:
    """Surprise of each frame, and the limit above which it does not belong."""
    both = np.array([(one.surprise, one.dof) for one in combined.shared()])
    chance = _FALSE_FLAGS / frames
    return both[:, 0], np.asarray(scipy.stats.chi2.isf(chance, np.maximum(both[:, 1], 1)))


def _turned_round(spool: Spool, width: int) -> Spool:
    turned = Spool(width)
    for record in reversed(spool):
        turned.append(record)
    spool.close()
    return turned
