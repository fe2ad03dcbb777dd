"""What the frames of a joint fit say together: reach for :func:`joint_summary`.

:func:`describe_joint_fit` says in sentences what a person should know of it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from jitterkit.conventions import direction_angle
from jitterkit.joint import Combined, SequenceFit
from jitterkit.metric import LARGE_FACTOR, error_factor
from jitterkit.optics.otf import PLATE_SCALE
from jitterkit.refit import Status
from jitterkit.report.columns import unit_of
from jitterkit.report.means import corrected, weighted_mean
from jitterkit.report.residual_stack import ResidualStack
from jitterkit.report.sequence import assess_run_fit
from jitterkit.report.words import angle_size, number
from jitterkit.series import Floor

_CERTAIN = 9.0
"""Chi-squared of one degree of freedom from which a slope is said to be there: three sigmas."""

_UNSURE = 0.3
"""Of a frame's error, from which what a rolling shutter adds is reported: 5 % more of it."""

_ODD = 0.25
"""Share of the frames above which those that contradict the others are reported: none of them is left out."""


def joint_summary(
    fit: SequenceFit, floor: Floor | None = None, stack: ResidualStack | None = None
) -> dict[str, Any]:
    """Return what the frames say together, as ``sequence.json`` holds it.

    Parameters
    ----------
    fit : SequenceFit
    floor : Floor, optional
        Under the averages of the separation.
    stack : ResidualStack, optional
        Of the residuals of its last pass.

    Returns
    -------
    summary : dict
        ``frames``, ``counted``, ``status``, ``outliers`` and how many that count are ``contradicting`` the
        others; ``separation`` [arcsec], its ``error`` being
        the joint Cramér-Rao bound, with ``error_by_scatter`` and ``chi2_dof`` of the frames about it, how
        many of them are ``with_model_error`` or have the flag ``misfit``, the ``scale_error`` that the plate
        scale adds, which is that of one frame, the ``scale_factor`` by which a fitted plate scale makes its
        error larger than a known one, and it ``corrected`` for velocity aberration and orbital motion, by
        the mean of what they are in the frames (NaN if some are ``uncorrected``: they lack what others
        have); ``fit``, how well the frames fit, from
        :func:`~jitterkit.report.sequence.assess_run_fit`; ``shared``, value, error and law of each shared
        parameter (diffusion is a variance, arcsec²); ``slope`` of the separation, arcsec/s; ``floor`` of its
        averages [arcsec]; ``rows``, of a rolling shutter, with ``leverage``, by how much the separation
        changes per arcsec/s of drift [s], and ``unknown``, the error of that drift [arcsec/s]; ``passes``,
        and by how many errors the last ``moved`` anything; ``seconds``.
    """
    frames = list(fit.frames())
    mean, error = fit.separation
    kept = [frame for frame in frames if frame.kept]
    separations, errors = np.array([(f.separation, f.separation_err) for f in kept]).T
    scatter = weighted_mean(separations, errors)
    scale_err = float(np.median([f.record.stated[0] for f in kept]))  # that of most frames
    slope = fit.slope()
    correction, uncorrected = _mean_correction(kept, separations, errors)
    statuses = [frame.record.status for frame in frames]
    shared = ((name, fit.combined.value(name), fit.time_models[name]) for name in fit.combined.names)
    return {
        "frames": len(frames),
        "counted": len(kept),
        "status": {s.name.lower(): statuses.count(s) for s in Status if s in statuses},
        "outliers": [f.record.name for f in frames if f.shared is not None and not f.kept],
        "contradicting": int(np.sum(fit.combined.contradicting() & fit.combined.kept)),
        "separation": {
            "unit": "arcsec",
            "mean": mean,
            "error": error,
            "error_of_a_frame": scatter["typical_error"],
            "chi2_dof": scatter["chi2_dof"],
            "error_by_scatter": error * math.sqrt(scatter["chi2_dof"]),
            "corrected": mean + correction,
            "uncorrected": uncorrected,
            "misfit": sum("misfit" in f.record.flags for f in kept),
            "scale_error": math.nan if PLATE_SCALE in fit.combined.names else mean * scale_err,
            "scale_factor": _scale_factor(fit.combined),
            "with_model_error": sum("model_error" in f.record.flags for f in kept),
        },
        "fit": assess_run_fit(
            np.array([f.record.chi2_dof for f in kept]),
            np.array([f.record.dof for f in kept]),
            np.array([error * math.sqrt(len(kept))]),  # of a frame that is fitted alone
            stack,
        ),
        "slope": {"unit": "arcsec/s", "rate": slope.rate, "error": slope.error, "chi2": slope.chi2},
        "floor": None if floor is None else _floor(floor),
        "shared": {
            name: {
                "unit": unit_of(name) if name != "diffusion" else "arcsec2",
                "mean": direction_angle(value) if name == "theta" else value,
                "error": fit.combined.error(name),
                "law": {"kind": law.kind, **asdict(law)},  # type: ignore[call-overload]
            }
            for name, value, law in shared
        },
        "rows": None if fit.rows is None else fit.rows._asdict(),
        "locus": fit.locus,
        "passes": fit.passes,
        "moved": fit.moves[-1],
        "seconds": fit.seconds,
    }


def _scale_factor(combined: Combined) -> float:
    """Return by how much a fitted plate scale enlarges the separation's error; NaN where it is not fitted."""
    if PLATE_SCALE not in combined.names:
        return math.nan
    return error_factor(combined.covariance, *map(combined.names.index, ("separation", PLATE_SCALE)))


def _mean_correction(kept: list[Any], separations: np.ndarray, errors: np.ndarray) -> tuple[float, int]:
    """Return by how much corrections change the separation [arcsec], and how many frames lack one.

    It is NaN if no frame has corrections, or only some have: the mean of these is not that of the others.
    """
    _, *corrections = np.array([f.record.stated for f in kept]).T
    changes = corrected(separations, *corrections) - separations
    known = np.isfinite(changes)
    lacking = int(np.sum(~known)) if np.any(np.isfinite(corrections)) else 0
    return float(np.average(changes, weights=errors**-2)) if known.all() else math.nan, lacking


def _floor(floor: Floor) -> dict[str, Any]:
    return {
        "unit": "arcsec",
        "detected": bool(floor.detected),
        "floor": floor.floor,
        "error": floor.error,
        "upper_95": floor.upper,
        "met_at_frames": floor.meets,
        "p_value": floor.p_value,
    }


def describe_joint_fit(summary: Mapping[str, Any]) -> list[str]:
    """Return sentences on what a person should know beside the separation."""
    sentences = []
    if outliers := summary["outliers"]:
        named = ", ".join(outliers[:5]) + ", ..." * (len(outliers) > 5)
        sentences.append(f"{len(outliers)} frames contradict the others and were not counted: {named}.")
    if summary["moved"] > 1 and summary["passes"] > 1:
        moved = f"moved what they share by {number(summary['moved'], 2)} errors"
        sentences.append(f"The fit has not settled: its last pass over the frames {moved}.")
    sentences += _describe_separation(summary["separation"])
    slope = summary["slope"]
    if slope["chi2"] > _CERTAIN:
        rate, sigmas = angle_size(slope["rate"] * 3600, 3), number(math.sqrt(slope["chi2"]), 2)
        change = f"The separation changes by {rate} an hour ({sigmas} sigma)"
        sentences.append(f"{change}: its mean is that of the middle of the run.")
    floor = summary["floor"]
    if floor is not None and floor["detected"] and floor["met_at_frames"] >= 1:
        frames = f"which {number(floor['met_at_frames'], 2)} frames reach"
        stop = f"Averaging stops at {angle_size(floor['floor'], 2)}, {frames}"
        sentences.append(f"{stop}: more frames do not make the mean better.")
    rows, error = summary["rows"], summary["separation"]["error_of_a_frame"]
    if rows is not None and rows["modelled"] and rows["leverage"] * rows["unknown"] > _UNSURE * error:
        speed = f"{number(rows['unknown'], 2)} arcsec/s"
        added = f"adds up to {angle_size(rows['leverage'] * rows['unknown'], 2)} of error to each frame"
        found = f"The image moves between frames too irregularly to give its motion within them ({speed})"
        remedy = "Give --telemetry"
        if rows["by_telemetry"]:
            found = f"Between frames the telemetry misses {speed} of the image's motion"
            remedy = "Unless the telescope stepped there, check its signs, axes, unit and clock"
        sentences.append(f"{found}: the rolling shutter {added}. {remedy}.")
    separations, odd = summary["separation"]["chi2_dof"], summary["contradicting"]
    wrong = abs(separations - 1) > 5 * math.sqrt(2 / max(summary["counted"] - 1, 1))
    if wrong or odd > _ODD * summary["counted"]:
        found = f"The separations scatter by {number(math.sqrt(separations), 3)} times their errors"
        if not wrong:
            found = f"{odd} frames contradict the others in what they share, too many to leave them out"
        sentences.append(
            f"{found}: something is not in the model. Of a field that rotates give --law theta=polynomial:1; "
            "frames of another target or camera, or turned by half a turn, belong in another run."
        )
    return sentences


def _describe_separation(separation: Mapping[str, Any]) -> Iterator[str]:
    if separation["with_model_error"]:
        yield (
            f"Errors of the model were allowed for in {separation['with_model_error']} frames. They are "
            "alike in all of them and do not average out: the separation may be off by up to the error of "
            f"one frame, {angle_size(separation['error_of_a_frame'], 2)}."
        )
    if separation["misfit"]:
        yield f"{separation['misfit']:,} of the frames that count have the flag misfit."
    if separation["uncorrected"]:
        lacking = f"{separation['uncorrected']:,} frames lack a correction that others have"
        yield f"There is no separation_corrected: {lacking}."
    if separation["scale_factor"] > LARGE_FACTOR:
        times = f"{number(separation['scale_factor'], 2)} times as large as with a known plate scale"
        yield f"The error of the separation is {times}: state its plate_scale_err if you know it better."
