"""How much, and how fast, something wanders: from the frames themselves.

Reach for :func:`settle_laws`, which measures what nobody gave.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence

import numpy as np
import scipy.optimize

from jitterkit.joint.combine import log_likelihood
from jitterkit.joint.filter import Model
from jitterkit.joint.laws import Constant, Free, Law, Wander
from jitterkit.joint.message import Message, Messages

__all__ = ["loose_laws", "measure_wander", "settle_laws"]

_WORTH = 2.0
"""Logarithm of the likelihood that a wander's two numbers must gain over a constant."""

_STEP, _FORGETS = 3.0, 1e3
"""Errors of one frame by which what changes may change from frame to frame until all have been seen, and
frames over which that adds up."""

_FEW, _ANYWHERE = 8, 300.0
"""Frames below which nothing is said of how much they wander, and errors of a frame that it may be then."""

_ENOUGH = 2000
"""Messages from which a wander is measured: 2,000 steps tell their variance to sqrt(2/2000), 3 %."""


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


def loose_laws(laws: Mapping[str, Law | None], message: Message, exposure: float) -> dict[str, Law]:
    """Laws for a first look, frame after frame: what may change may change quickly.

    Parameters
    ----------
    laws : mapping
        As the user has them, by name, in the order of the message; None for a wander to be measured.
    message : Message
        Of a frame: its errors are the measure.
    exposure : float
        s.
    """
    loose = [
        Wander(_STEP * error * math.sqrt(_FORGETS / 2), _FORGETS * exposure) for error in _errors(message)
    ]
    pairs = zip(laws.items(), loose, strict=True)
    return {name: law if isinstance(law, Constant) else wander for (name, law), wander in pairs}


def settle_laws(
    laws: Mapping[str, Law | None], messages: Messages, aberrations: Collection[str], exposure: float
) -> dict[str, Law]:
    """Laws with the wanders measured that nobody gave.

    Parameters
    ----------
    laws, exposure
        As for :func:`loose_laws`.
    messages : Messages
    aberrations : collection of str
        Names of what wanders by the same numbers.

    Returns
    -------
    laws : dict
        Of fewer than 8 frames, what wanders may be anywhere in each.
    """
    known = {name: law for name, law in laws.items() if law is not None}
    unknown = [name for name in laws if laws[name] is None]
    if len(messages) < _FEW:
        first = next(iter(messages))
        errors = dict(zip(messages.names, _errors(first), strict=True))
        return known | {name: Free(_ANYWHERE * errors[name], exposure / 1000) for name in unknown}
    together = [name for name in unknown if name in aberrations]
    for group in (together, *([name] for name in unknown if name not in aberrations)):
        known |= dict.fromkeys(group, measure_wander(messages, group, known)) if group else {}
    return known


def _errors(message: Message) -> np.ndarray:
    """Errors of a frame on what is shared, all else known."""
    told = np.diag(message.information)
    return 1 / np.sqrt(np.where(told > 0, told, 1.0))
