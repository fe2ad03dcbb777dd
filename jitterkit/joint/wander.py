"""How much, and how fast, something wanders: from the frames themselves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import scipy.optimize

from jitterkit.joint.combine import log_likelihood
from jitterkit.joint.filter import Model
from jitterkit.joint.laws import Constant, Law, Wander
from jitterkit.joint.message import Messages

__all__ = ["measure_wander"]

_WORTH = 2.0
"""Logarithm of the likelihood that a wander's two numbers must gain over a constant."""

_ENOUGH = 2000
"""Messages from which a wander is measured: its numbers are good to 5 % then, and need not be better."""


def measure_wander(messages: Messages, names: Sequence[str], laws: Mapping[str, Law]) -> Law:
    """The wander common to some shared parameters that makes the frames likeliest.

    Parameters
    ----------
    messages : Messages
    names : sequence of str
        Of the parameters, of one unit.
    laws : mapping
        Of the others.

    Returns
    -------
    law : Wander or Constant
        From the first 2,000 frames; a constant where a wander does not make them likelier.
    """
    some = [message for message, _ in zip(messages, range(_ENOUGH), strict=False)]
    at = np.array([m.at for m in some])[:, [messages.names.index(name) for name in names]]
    times = np.array([m.time for m in some])
    span = max(float(np.ptp(times)), 1e-9)
    spread = max(float(np.std(at, axis=0).mean()), 1e-12)

    def cost(logs) -> float:
        rms, timescale = np.exp(np.clip(logs, [-30, -30], [30, 30]))
        wander = Wander(float(rms), float(timescale))
        return -log_likelihood(some, Model.of(messages, {**laws, **dict.fromkeys(names, wander)}))

    start = np.log([spread, span / 5])
    simplex = start + np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.5]])
    found = scipy.optimize.minimize(
        cost,
        start,
        method="Nelder-Mead",
        options={"initial_simplex": simplex, "xatol": 0.05, "fatol": 0.1, "maxiter": 60},
    )
    still = -log_likelihood(some, Model.of(messages, {**laws, **dict.fromkeys(names, Constant())}))
    if still - found.fun < _WORTH:
        return Constant()
    rms, timescale = np.exp(found.x)
    held = min(timescale, 100 * span)  # of one much slower than the run only rms²/timescale shows
    return Wander(float(rms * np.sqrt(held / timescale)), float(held))
