"""Whether the frames of a run fit together as well as noise allows.

A misfit that no single frame shows may bias all of them alike, and then their mean claims more than it knows.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from jitterkit.report.words import angle_size, number

_FEWEST = 8
"""Frames from which their scatter tells the error of their mean."""

_SURE = 5.0
"""Errors of the mean chi-squared from which the model lacks something."""

_HIDDEN = 0.2
"""Errors of a frame's separation by which an effect biased it, for each root of the chi-squared that it
added: at most, of those of ``scripts/systematics`` that added any.  A wrong plate scale adds none."""


def assess_run_fit(chi2_dof: np.ndarray, dof: np.ndarray, separation_err: np.ndarray) -> dict[str, Any]:
    """Test the chi-squared of all frames of a run together.

    Parameters
    ----------
    chi2_dof, dof : (n,) arrays
        Of frames that were fitted.
    separation_err : (n,) array
        arcsec; NaN without a separation.

    Returns
    -------
    fit : dict
        ``frames``; ``chi2_dof``, the mean, and its ``error``, by the scatter of the frames or by the law of
        chi-squared, whichever is larger; ``sigmas``, by how many it is above one; ``may_hide`` [arcsec], the
        bias of the separation that effects with as large a misfit had, NaN where there is no misfit.

    Notes
    -----
    *Fails when* a misfit is in few of the frames: their own flag ``misfit`` shows that.
    """
    known = np.isfinite(chi2_dof) & (np.asarray(dof) > 0)
    values, dof = np.asarray(chi2_dof, float)[known], np.asarray(dof, float)[known]
    fit: dict[str, Any] = {"frames": len(values)}
    if len(values) < _FEWEST:
        return fit | dict.fromkeys(("chi2_dof", "error", "sigmas", "may_hide"), math.nan)
    mean, scatter = float(values.mean()), float(values.std(ddof=1)) / math.sqrt(len(values))
    error = max(scatter, math.sqrt(2 / dof.sum()))
    sigmas = (mean - 1) / error
    errors = np.asarray(separation_err, float)[known]
    typical = float(np.median(errors[np.isfinite(errors)])) if np.isfinite(errors).any() else math.nan
    added = max(mean - 1, 0.0) * float(dof.mean())
    hidden = _HIDDEN * math.sqrt(added) * typical if sigmas > _SURE else math.nan
    return fit | {"chi2_dof": mean, "error": error, "sigmas": sigmas, "may_hide": hidden}


def describe_run_fit(fit: dict[str, Any]) -> str:
    """Return in a sentence that a run's frames do not fit as well as noise allows; nothing where they do."""
    if not fit["sigmas"] > _SURE:
        return ""
    claim = (
        f"The model lacks something: the mean chi-squared per degree of freedom of {fit['frames']:,} frames "
        f"is {number(fit['chi2_dof'], 5)}, {number(fit['sigmas'], 2)} of its errors above one."
    )
    if not math.isfinite(fit["may_hide"]):
        return claim
    return (
        f"{claim} Effects that show so much biased the separation by up to {angle_size(fit['may_hide'], 2)}."
    )
