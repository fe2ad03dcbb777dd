"""The filter that listens to one frame after the other: Kalman's, for scores and information.

Reach for :class:`Filter`, or for :func:`jitterkit.joint.combine.combine`, which runs it over all frames and
back.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from jitterkit.joint.laws import Constant, Law
from jitterkit.joint.message import Message, Messages

__all__ = ["DIFFUSE", "Filter", "Model", "update"]

DIFFUSE = 1e3
"""Prior error of what nothing is known about, in errors of the first frame: costs a millionth of a frame."""


class Model:
    """The linear state behind the shared parameters, in units of one frame's errors.

    Parameters
    ----------
    names : tuple of str
        Of the shared parameters.
    laws : mapping
        Of each, by name; what is not named is constant.
    first : Message
        Of a frame; gives the units and the origin.
    span : (float, float)
        Times of the first and the last frame.
    """

    def __init__(
        self, names: tuple[str, ...], laws: Mapping[str, Law], first: Message, span: tuple[float, float]
    ) -> None:
        self.names = names
        self.laws = [laws.get(name, Constant()) for name in names]
        self.origin = first.at
        told = np.diag(first.information)
        self.scale = 1 / np.sqrt(np.where(told > 0, told, 1.0))
        self.owner = np.repeat(np.arange(len(self.laws)), [law.states for law in self.laws])
        self.first_states = np.searchsorted(self.owner, np.arange(len(self.laws)))
        self.middle, self.half = (span[0] + span[1]) / 2, max((span[1] - span[0]) / 2, 1e-12)
        variance = np.concatenate([law.variance() for law in self.laws]) / self.scale[self.owner] ** 2
        self.prior = np.where(np.isinf(variance), DIFFUSE**2, variance)

    @classmethod
    def of(cls, messages: Messages, laws: Mapping[str, Law]) -> Model:
        """The model of a run that has been taken."""
        first, last = next(iter(messages)), next(iter(reversed(messages)))
        return cls(messages.names, laws, first, (first.time, last.time))

    def rows(self, time: float) -> np.ndarray:
        """The shared parameters (k, states) in terms of the state."""
        u = (time - self.middle) / self.half
        rows = np.zeros((len(self.laws), len(self.owner)))
        rows[self.owner, np.arange(len(self.owner))] = np.concatenate([law.row(u) for law in self.laws])
        return rows

    def memory(self, seconds: float) -> np.ndarray:
        """Share of each state that is left after a time."""
        return np.concatenate([law.memory(seconds) for law in self.laws])

    def told(self, message: Message) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Point, score and information of a message in the model's units."""
        at = (message.at - self.origin) / self.scale
        return at, message.score * self.scale, message.information * np.outer(self.scale, self.scale)


class Filter:
    """What the frames so far say.

    Parameters
    ----------
    model : Model
    """

    def __init__(self, model: Model) -> None:
        self.model = model
        self.mean, self.covariance = np.zeros(len(model.prior)), np.diag(model.prior)
        self._time: float | None = None

    def move(self, time: float) -> None:
        """Go on to a time."""
        if self._time is not None and time != self._time:
            left = self.model.memory(time - self._time)
            self.mean = left * self.mean
            noise = np.diag(self.model.prior * (1 - left**2))
            self.covariance = self.covariance * np.outer(left, left) + noise
        self._time = time

    def hear(self, message: Message) -> float:
        """Take a frame in, and return the logarithm of its likelihood given those before."""
        gain, (tight, firm), _, evidence = update(self.model, self.mean, self.covariance, message)
        self.mean = self.mean + gain @ tight
        covariance = self.covariance - gain @ firm @ gain.T
        self.covariance = (covariance + covariance.T) / 2
        return evidence

    def shared(self) -> np.ndarray:
        """The shared parameters (k,) as they are known now."""
        assert self._time is not None
        return self.model.origin + self.model.rows(self._time) @ self.mean * self.model.scale


def update(model: Model, mean, covariance, message: Message):
    """What a message changes.

    Returns
    -------
    gain : (states, k) array
        Covariance of the state with the shared parameters.
    surprise : ((k,), (k, k)) arrays
        Score and information of the message, softened by what was not known before.
    rows : (k, states) array
    evidence : float
        Logarithm of the message's likelihood under the prediction.
    """
    rows = model.rows(message.time)
    at, score, information = model.told(message)
    gain = covariance @ rows.T
    spread = rows @ gain
    off = rows @ mean - at
    slope = score - information @ off
    softened = np.eye(len(at)) + information @ spread
    both = np.linalg.solve(softened, np.column_stack([slope, information]))
    tight, firm = both[:, 0], (both[:, 1:] + both[:, 1:].T) / 2
    evidence = -np.linalg.slogdet(softened)[1] / 2 + slope @ spread @ tight / 2
    evidence += off @ score - off @ information @ off / 2
    return gain, (tight, firm), rows, float(evidence)
