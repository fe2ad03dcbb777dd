"""What all frames say together.

Reach for :func:`summarise`; its answer is what ``summary.json`` holds.  Only frames with status ``ok``
count.  Means are weighted by the inverse of the squared errors, and the scatter about them is set
against those errors: ``chi2_dof`` near one says that the errors mean something.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from astropy.table import QTable

from jitterkit.frames.writer import replacing
from jitterkit.report.flags import encode_flags
from jitterkit.report.means import corrected, weighted_mean
from jitterkit.report.residual_stack import ResidualStack, count_copies
from jitterkit.report.sequence import assess_run_fit, compare_loci


def summarise(table: QTable, stack: ResidualStack | None = None) -> dict[str, Any]:
    """Combine the frames of a results table.

    Parameters
    ----------
    table : QTable
        From :func:`~jitterkit.report.table.make_table` or read back.
    stack : ResidualStack, optional
        Of its frames, duplicates included.

    Returns
    -------
    summary : dict
        ``frames``; ``status`` and ``locus``, the number of each; ``separation`` [arcsec], ``theta`` and
        ``pa`` [deg] as :func:`weighted_mean` has them, with their ``unit``; ``model_error`` of the
        separation, the median of what errors of the model make of a frame's, which no mean makes smaller;
        its ``scale_error``, likewise of what the error of the plate scale makes of it; the number of frames
        with the flag ``misfit``, and ``without_misfit`` the mean of the others;
        ``separation_corrected``, of the frames with the corrections that any frame has;
        ``jitter``, the plain mean of the second moments [arcsec²] and its principal axes [arcsec, deg];
        ``shape``, the excess kurtosis as :func:`weighted_mean` has it; ``loci``, what the frames say
        together, from :func:`~jitterkit.report.sequence.compare_loci`; ``chi2_dof``, the median over frames;
        ``fit``, how well all fit together, from :func:`~jitterkit.report.sequence.assess_run_fit`;
        ``seconds``, the total.

    Notes
    -----
    *Fails when* errors of frames are correlated: an instrument's fixed pattern averages to nothing
    here and to something on the sky.  Angles are averaged as offsets from the first, folded into
    ±180 deg, so north is no special place.
    """
    counts = np.asarray(table["status"]) == "ok"
    used = ["locus", "flags", "chi2_dof", "dof", "sxx", "sxy", "syy", "va_factor", "orbit_change"]
    used += [name + end for name in ("separation", "theta", "pa", "shape") for end in ("", "_err")]
    good = table[used][counts]  # not the texts: of 60,000 frames they are most of the memory
    separations, errors = _pair(good, "separation", "arcsec")
    misfit = np.asarray(good["flags"], int) & encode_flags(["misfit"]) > 0
    right = corrected(separations, np.asarray(good["va_factor"]), good["orbit_change"].to_value("arcsec"))
    candidates = np.asarray(table["candidates"])
    return {
        "frames": len(table),
        "status": _counts(table["status"]),
        "locus": _counts(good["locus"]),
        "separation": {
            "unit": "arcsec",
            **weighted_mean(separations, errors),
            "model_error": _median(table["separation_model_err"].to_value("arcsec")[counts]),
            "scale_error": _median(table["separation_scale_err"].to_value("arcsec")[counts]),
            "misfit": int(misfit[np.isfinite(separations)].sum()),
            "without_misfit": weighted_mean(separations[~misfit], errors[~misfit]),
        },
        "separation_corrected": {"unit": "arcsec", **weighted_mean(right, errors)},
        "theta": {"unit": "deg", **_mean_direction(*_pair(good, "theta", "deg"))},
        "pa": {"unit": "deg", **_mean_direction(*_pair(good, "pa", "deg"))},
        "jitter": _mean_jitter(good),
        "shape": weighted_mean(np.asarray(good["shape"]), np.asarray(good["shape_err"])),
        "loci": compare_loci(candidates[index] for index in np.flatnonzero(counts)),
        "chi2_dof": _median(good["chi2_dof"]),
        "fit": assess_run_fit(good["chi2_dof"], good["dof"], errors, stack, count_copies(table)),
        "seconds": float(np.nansum(table["seconds"].to_value("s"))),
    }


def _counts(column: Any) -> dict[str, int]:
    names, numbers = np.unique(np.asarray(column, str), return_counts=True)
    ranked = sorted(zip(names.tolist(), numbers.tolist(), strict=True), key=lambda pair: -pair[1])
    return {name: number for name, number in ranked if name}


def _pair(table: QTable, name: str, unit: str) -> tuple[np.ndarray, np.ndarray]:
    return table[name].to_value(unit), table[f"{name}_err"].to_value(unit)


def _mean_direction(angles: np.ndarray, errors: np.ndarray) -> dict[str, Any]:
    finite = angles[np.isfinite(angles)]
    reference = finite[0] if len(finite) else 0.0
    combined = weighted_mean((angles - reference + 180.0) % 360.0 - 180.0, errors)
    return combined | {"mean": (combined["mean"] + reference) % 360.0}


def _mean_jitter(table: QTable) -> dict[str, float]:
    """Mean of the pointing's covariance: moments of different frames add, lengths and angles do not."""
    from jitterkit.loci.base import principal_axes  # JAX: only here, so that a table alone needs none

    moments = np.array([table[name].to_value("arcsec2") for name in ("sxx", "sxy", "syy")])
    moments = moments[:, np.all(np.isfinite(moments), axis=0)]
    if moments.shape[1] == 0:
        return dict.fromkeys(("sxx", "sxy", "syy", "major", "minor", "angle"), math.nan)
    mean = moments.mean(axis=1)
    major, minor, angle = principal_axes(mean)
    sizes = {"major": major, "minor": minor, "angle": angle if major > 0 else math.nan}
    return dict(zip(("sxx", "sxy", "syy"), mean.tolist(), strict=True)) | sizes


def _median(column: Any) -> float:
    values = np.asarray(column, float)
    values = values[np.isfinite(values)]
    return float(np.median(values)) if len(values) else math.nan


def write_summary(path: str | Path, summary: dict[str, Any], *, overwrite: bool = False) -> None:
    """Write a summary as JSON, whole or not at all; NaN becomes null.

    Raises
    ------
    FrameError
        If the file exists and may not be overwritten, or cannot be written.
    """
    with replacing(Path(path), overwrite) as temporary:
        text = json.dumps(_without_nan(summary), indent=2, ensure_ascii=False, allow_nan=False)
        temporary.write_text(text + "\n", encoding="utf-8", newline="\n")


def _without_nan(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_nan(item) for key, item in value.items()}
    return None if isinstance(value, float) and not math.isfinite(value) else value
