"""Models of how a parameter that frames share changes with time.

Reach for :func:`parse_time_model`.  A time model is a small linear state: a shared parameter at a time is a
row of numbers times the state, and the state changes by a factor and a noise from one frame to the next.
That is all that a filter needs, so that a constant, a polynomial and a Gaussian process cost the same a
frame.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.polynomial import legendre

from jitterkit.errors import ConfigurationError, ErrorCode

_MOST = 8
"""Degree of a polynomial at most: one that bends more often is an Ornstein-Uhlenbeck process."""


class TimeModel(ABC):
    """Describe how one shared parameter changes with time, as a linear state.

    Attributes
    ----------
    kind : str
        Its name in ``--law`` and in results.
    """

    kind: ClassVar[str]

    @property
    @abstractmethod
    def states(self) -> int:
        """Return how many numbers the state has; the first is about the parameter itself."""

    @abstractmethod
    def row(self, u: float) -> np.ndarray:
        """Return the weights (states,) of the state in the parameter, ``u`` being -1 to 1 over the run."""

    def memory(self, seconds: float) -> np.ndarray:
        """Return the share (states,) of each state that is left after a time."""
        return np.ones(self.states)

    def variance(self) -> np.ndarray:
        """Return the prior variance (states,), in the parameter's unit squared; infinite where unknown.

        A state that decays keeps this variance: noise replaces what it loses.
        """
        return np.full(self.states, math.inf)


@dataclass(frozen=True)
class Constant(TimeModel):
    """Keep the same value in every frame."""

    kind = "constant"

    @property
    def states(self) -> int:
        return 1

    def row(self, u: float) -> np.ndarray:
        return np.ones(1)


@dataclass(frozen=True)
class Polynomial(TimeModel):
    """A polynomial in time, by Legendre's: the first state is the mean over the run.

    Parameters
    ----------
    degree : int
    """

    kind = "polynomial"
    degree: int

    def __post_init__(self) -> None:
        if not 0 <= self.degree <= _MOST:
            problem = f"A polynomial of degree {self.degree} is not offered; give 0 to {_MOST}"
            raise ConfigurationError(ErrorCode.OUT_OF_RANGE, f"{problem}, or 'wander'.")

    @property
    def states(self) -> int:
        return self.degree + 1

    def row(self, u: float) -> np.ndarray:
        return legendre.legvander(np.atleast_1d(u), self.degree)[0]


@dataclass(frozen=True)
class OrnsteinUhlenbeck(TimeModel):
    """A Gaussian process of exponential covariance, ``rms² exp(-|t|/timescale)``, about an unknown mean.

    Parameters
    ----------
    rms : float
        In the parameter's unit.
    timescale : float
        s.
    """

    kind = "wander"
    rms: float
    timescale: float

    def __post_init__(self) -> None:
        for name in ("rms", "timescale"):
            if not 0 < getattr(self, name) < math.inf:
                problem = f"A wander's {name} = {getattr(self, name)} must be positive."
                raise ConfigurationError(ErrorCode.OUT_OF_RANGE, problem)

    @property
    def states(self) -> int:
        return 2

    def row(self, u: float) -> np.ndarray:
        return np.ones(2)

    def memory(self, seconds: float) -> np.ndarray:
        return np.array([1.0, math.exp(-abs(seconds) / self.timescale)])

    def variance(self) -> np.ndarray:
        return np.array([math.inf, self.rms**2])


@dataclass(frozen=True)
class Independent(OrnsteinUhlenbeck):
    """A process so wide and quick that every frame is independent of the others."""

    kind = "free"


def parse_time_model(text: str) -> TimeModel | None:
    """Parse a time model.

    Parameters
    ----------
    text : str
        ``constant``; ``polynomial:2``; ``wander:3:60``, with rms in the parameter's unit and timescale in s;
        or ``wander``, for one whose numbers are estimated from the frames.

    Returns
    -------
    time_model : TimeModel or None
        None for a process that is to be estimated.

    Raises
    ------
    ConfigurationError

    >>> parse_time_model("polynomial:1"), parse_time_model("wander:3:60")
    (Polynomial(degree=1), OrnsteinUhlenbeck(rms=3.0, timescale=60.0))
    """
    kind, *words = text.split(":")
    try:
        numbers = [int(word) if kind == "polynomial" else float(word) for word in words]
    except ValueError:
        numbers = [math.nan] * 3
    match kind, len(numbers):
        case "constant", 0:
            return Constant()
        case "polynomial", 1:
            return Polynomial(int(numbers[0]))
        case "wander", 0:
            return None
        case "wander", 2:
            return OrnsteinUhlenbeck(*numbers)
    problem = f"{text!r} is no law of change; give constant, polynomial:DEGREE, wander"
    raise ConfigurationError(ErrorCode.MALFORMED, f"{problem}, or wander:RMS:SECONDS.")
