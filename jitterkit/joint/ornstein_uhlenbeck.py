"""Estimate rms and timescale of an Ornstein-Uhlenbeck process from the frames themselves.

Reach for :func:`complete_time_models`, which estimates those that the user did not give.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence

import numpy as np
import scipy.optimize

from jitterkit.joint.combine import log_likelihood
from jitterkit.joint.filter import Model
from jitterkit.joint.likelihood_summary import LikelihoodSummaries, LikelihoodSummary
from jitterkit.joint.time_models import Constant, Independent, OrnsteinUhlenbeck, TimeModel

_LEAST_GAIN = 2.0
"""Least gain in log-likelihood of the process's two numbers over a constant."""

_STEP, _FORGETS = 3.0, 1e3
"""Change from frame to frame, in errors of one frame, that is allowed on the first pass, and frames over
which it adds up."""

_FEW, _ANYWHERE = 8, 300.0
"""Frames below which the process is not estimated, and its rms then, in errors of a frame."""

_ENOUGH = 2000
"""Summaries from which the process is estimated: 2,000 steps give their variance to sqrt(2/2000), 3 %."""


def fit_ornstein_uhlenbeck(
    summaries: LikelihoodSummaries, names: Sequence[str], time_models: Mapping[str, TimeModel]
) -> TimeModel:
    """Fit the process common to some shared parameters by maximum likelihood.

    Parameters
    ----------
    summaries : LikelihoodSummaries
    names : sequence of str
        Of the parameters, of one unit.
    time_models : mapping
        Of the others.

    Returns
    -------
    time_model : OrnsteinUhlenbeck or Constant
        From the first 2,000 frames; a constant where a process does not make them likelier.
    """
    some = [summary for summary, _ in zip(summaries, range(_ENOUGH), strict=False)]
    at = np.array([m.at for m in some])[:, [summaries.names.index(name) for name in names]]
    times = np.array([m.time for m in some])
    span = max(float(np.ptp(times)), 1e-9)
    spread = max(float(np.std(at, axis=0).mean()), 1e-12)

    def cost(logs) -> float:
        rms, timescale = np.exp(np.clip(logs, [-30, -30], [30, 30]))
        process = OrnsteinUhlenbeck(float(rms), float(timescale))
        return -log_likelihood(some, Model.of(summaries, {**time_models, **dict.fromkeys(names, process)}))

    start = np.log([spread, span / 5])
    simplex = start + np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.5]])
    settings = {"initial_simplex": simplex, "xatol": 0.05, "fatol": 0.1, "maxiter": 60}
    found = scipy.optimize.minimize(cost, start, method="Nelder-Mead", options=settings)
    still = -log_likelihood(some, Model.of(summaries, {**time_models, **dict.fromkeys(names, Constant())}))
    if still - found.fun < _LEAST_GAIN:
        return Constant()
    rms, timescale = np.exp(found.x)
    held = min(timescale, 100 * span)  # of one much slower than the run only rms²/timescale shows
    return OrnsteinUhlenbeck(float(rms * np.sqrt(held / timescale)), float(held))


def initial_time_models(
    time_models: Mapping[str, TimeModel | None], summary: LikelihoodSummary, exposure: float
) -> dict[str, TimeModel]:
    """Return the time models of the first pass: what may change may change quickly.

    Parameters
    ----------
    time_models : mapping
        As the user has them, by name, in the order of the summary; None for a process to be estimated.
    summary : LikelihoodSummary
        Of a frame: its errors are the measure.
    exposure : float
        s.
    """
    loose: dict[str, TimeModel] = {}
    for (name, time_model), error in zip(time_models.items(), summary.errors, strict=True):
        process = OrnsteinUhlenbeck(_STEP * error * math.sqrt(_FORGETS / 2), _FORGETS * exposure)
        loose[name] = time_model if isinstance(time_model, Constant) else process
    return loose


def complete_time_models(
    time_models: Mapping[str, TimeModel | None],
    summaries: LikelihoodSummaries,
    aberrations: Collection[str],
    exposure: float,
) -> dict[str, TimeModel]:
    """Return the time models, with those estimated that the user did not give.

    Parameters
    ----------
    time_models, exposure
        As for :func:`initial_time_models`.
    summaries : LikelihoodSummaries
    aberrations : collection of str
        Names of parameters that follow the same process.

    Returns
    -------
    time_models : dict
        With fewer than 8 frames, these parameters are independent in each.
    """
    known = {name: time_model for name, time_model in time_models.items() if time_model is not None}
    unknown = [name for name in time_models if time_models[name] is None]
    if len(summaries) < _FEW:
        errors = dict(zip(summaries.names, next(iter(summaries)).errors, strict=True))
        return known | {name: Independent(_ANYWHERE * errors[name], exposure / 1000) for name in unknown}
    common = [name for name in unknown if name in aberrations]
    for group in (common, *([name] for name in unknown if name not in aberrations)):
        known |= dict.fromkeys(group, fit_ornstein_uhlenbeck(summaries, group, known)) if group else {}
    return known
