"""What a joint fit leaves behind: a row a frame, and a summary.

Reach for :func:`frame_table` and :func:`joint_summary`; :func:`separation_series` is what averages are
studied on.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from itertools import chain
from typing import Any

import numpy as np
from astropy.table import QTable

from jitterkit.conventions import direction_angle
from jitterkit.errors import printable
from jitterkit.joint import SequenceFit, TimeModel
from jitterkit.joint.combine import Combined
from jitterkit.joint.result import SequenceFrame
from jitterkit.loci import principal_axes
from jitterkit.metric import LARGE_FACTOR, error_factor
from jitterkit.optics.otf import PLATE_SCALE
from jitterkit.refit import Status
from jitterkit.report.columns import Column, bind_rows, measured, named, unit_of
from jitterkit.report.flags import encode_flags, flag_meanings
from jitterkit.report.means import corrected, weighted_mean
from jitterkit.report.residual_stack import ResidualStack
from jitterkit.report.sequence import assess_run_fit
from jitterkit.report.words import angle_size, number
from jitterkit.series import Floor, Series, fit_floor

_CERTAIN = 9.0
"""Chi-squared of one degree of freedom from which a slope is said to be there: three sigmas."""

_UNSURE = 0.3
"""Of a frame's error, from which what a rolling shutter adds is reported: 5 % more of it."""

_SERIES = 16
"""Frames from which kinds of noise can be distinguished."""


_FIRST = (
    Column("frame", "name of the frame", kind=str),
    Column("time", "middle of the exposure, from the beginning of the first", "s"),
    *named("status", "reason", "message", "flags"),
    Column("counted", "whether the frame counts in what all say together", kind=bool),
    *measured("separation", "by this frame, with all else that is shared known", "arcsec"),
    *named("separation_scale_err", "va_factor", "orbit_change", "separation_corrected"),
)

_JITTER = (
    *named("sxx", "sxx_err", "sxy", "sxy_err", "syy", "syy_err"),
    *named("jitter_major", "jitter_minor", "jitter_angle"),
    Column("smear_direction", "in which the image moved along the smear", "deg"),
    Column("velocity_x", "of the image, by the motion between frames", "arcsec/s"),
    Column("velocity_y", "of the image, by the motion between frames", "arcsec/s"),
    *named("chi2_dof"),
    Column("leave_one_out_chi2", "chi-squared of the frame's shared parameters against those of all others"),
)


def frame_table(fit: SequenceFit, meta: Mapping[str, Any] | None = None) -> QTable:
    """Return a row a frame.

    Parameters
    ----------
    fit : SequenceFit
    meta : mapping, optional
        Kept with the table.

    Returns
    -------
    table : QTable
        The frame's own parameters; ``separation`` as it alone says with all else known; the shared parameters
        that change, at its time; ``leave_one_out_chi2``, chi-squared against the others.
    """
    changing = [name for name, time_model in fit.time_models.items() if time_model.states > 1]
    own = [column for name in fit.records.own for column in measured(name, "", unit_of(name))]
    when = "at the time of the frame"
    shared = [column for name in changing for column in measured(f"shared_{name}", when, unit_of(name))]
    rows = (_row(fit, frame, changing) for frame in fit.frames())
    described = {**(meta or {}), "flags": flag_meanings()}
    return bind_rows([*_FIRST, *own, *_JITTER, *shared], rows, described)


def _row(fit: SequenceFit, frame: SequenceFrame, changing: Sequence[str]) -> list[Any]:
    """Return the cells of a frame."""
    record, shared = frame.record, frame.shared
    scale, *corrections = record.stated
    flags = [*record.flags, *["outlier"] * (shared is not None and not frame.kept)]
    known = np.all(np.isfinite(record.moments))
    major, minor, angle = principal_axes(record.moments) if known else (math.nan,) * 3
    names = fit.combined.names
    index = [names.index(name) for name in changing]
    at_time = np.full((2, len(names)), np.nan) if shared is None else np.array([shared.values, shared.errors])
    return [
        printable(record.name),
        record.time,
        record.status.name.lower(),
        record.reason,
        printable(record.message),
        encode_flags(flags),
        frame.kept,
        frame.separation,
        frame.separation_err,
        math.nan if PLATE_SCALE in names else frame.separation * scale,
        *corrections,
        float(corrected(frame.separation, *corrections)),
        *chain.from_iterable(zip(record.values, record.errors, strict=True)),
        *chain.from_iterable(zip(record.moments, record.moment_errors, strict=True)),
        *(major, minor, angle, _direction(angle, record.velocity)),
        *record.velocity,
        record.chi2_dof,
        math.nan if shared is None else shared.leave_one_out_chi2,
        *at_time[:, index].T.ravel(),
    ]


def _direction(angle: float, velocity: np.ndarray) -> float:
    """Return the end of a smear's axis to which the image went [deg], as the motion between frames has it."""
    along = float(velocity @ [math.cos(math.radians(angle)), math.sin(math.radians(angle))])
    if not math.isfinite(along) or along == 0:
        return math.nan
    return direction_angle(angle if along > 0 else angle + 180)


def separation_series(fit: SequenceFit) -> Series | None:
    """Return the separations of the frames that count [arcsec], with times [s]; None of too few to study."""
    kept = [(f.separation, f.separation_err, f.record.time) for f in fit.frames() if f.kept]
    return Series.of(*np.array(kept).T) if len(kept) >= _SERIES else None


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
        ``frames``, ``counted``, ``status`` and ``outliers``; ``separation`` [arcsec], its ``error`` being
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
    scatter = weighted_mean(
        np.array([f.separation for f in kept]), np.array([f.separation_err for f in kept])
    )
    scale_err = float(np.median([f.record.stated[0] for f in kept]))  # that of most frames
    slope = fit.slope()
    correction, uncorrected = _mean_correction(kept)
    statuses = [frame.record.status for frame in frames]
    return {
        "frames": len(frames),
        "counted": len(kept),
        "status": {s.name.lower(): statuses.count(s) for s in Status if s in statuses},
        "outliers": [f.record.name for f in frames if f.shared is not None and not f.kept],
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
                "law": describe_time_model(fit.time_models[name]),
            }
            for name, value in ((name, fit.combined.value(name)) for name in fit.combined.names)
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


def _mean_correction(kept: list[Any]) -> tuple[float, int]:
    """Return by how much corrections change the separation [arcsec], and how many frames lack one.

    It is NaN if no frame has corrections, or only some have: the mean of these is not that of the others.
    """
    separations, errors = np.array([(f.separation, f.separation_err) for f in kept]).T
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


def describe_time_model(time_model: TimeModel) -> dict[str, Any]:
    """Describe a time model by name and numbers."""
    return {"kind": time_model.kind, **asdict(time_model)}  # type: ignore[call-overload]


def describe_joint_fit(summary: Mapping[str, Any]) -> list[str]:
    """Return sentences on what a person should know beside the separation."""
    sentences = []
    if summary["outliers"]:
        named = ", ".join(summary["outliers"][:5])
        more = ", ..." if len(summary["outliers"]) > 5 else ""
        sentences.append(
            f"{len(summary['outliers'])} frames contradict the others and were not counted: {named}{more}."
        )
    if summary["moved"] > 1 and summary["passes"] > 1:
        sentences.append(
            f"The fit has not settled: its last pass over the frames moved what they share by "
            f"{number(summary['moved'], 2)} errors."
        )
    separation = summary["separation"]
    if separation["with_model_error"]:
        sentences.append(
            f"Errors of the model were allowed for in {separation['with_model_error']} frames. They are "
            "alike in all of them and do not average out: the separation may be off by up to the error of "
            f"one frame, {angle_size(separation['error_of_a_frame'], 2)}."
        )
    if separation["misfit"]:
        sentences.append(f"{separation['misfit']:,} of the frames that count have the flag misfit.")
    if separation["uncorrected"]:
        sentences.append(
            f"There is no separation_corrected: {separation['uncorrected']:,} frames lack a correction that "
            "others have."
        )
    if separation["scale_factor"] > LARGE_FACTOR:
        sentences.append(
            f"The error of the separation is {number(separation['scale_factor'], 2)} times as large as with "
            "a known plate scale: state its plate_scale_err if you know it better."
        )
    slope = summary["slope"]
    if slope["chi2"] > _CERTAIN:
        sentences.append(
            f"The separation changes by {angle_size(slope['rate'] * 3600, 3)} an hour "
            f"({number(math.sqrt(slope['chi2']), 2)} sigma): its mean is that of the middle of the run."
        )
    floor = summary["floor"]
    if floor is not None and floor["detected"] and floor["met_at_frames"] >= 1:
        sentences.append(
            f"Averaging stops at {angle_size(floor['floor'], 2)}, which "
            f"{number(floor['met_at_frames'], 2)} frames reach: more frames do not make the mean better."
        )
    rows = summary["rows"]
    if (
        rows is not None
        and rows["modelled"]
        and rows["leverage"] * rows["unknown"] > _UNSURE * summary["separation"]["error_of_a_frame"]
    ):
        sentences.append(
            f"The image moves between frames too irregularly to give its motion within them "
            f"({number(rows['unknown'], 2)} arcsec/s): the rolling shutter adds up to "
            f"{angle_size(rows['leverage'] * rows['unknown'], 2)} of error to each frame. Give --telemetry."
        )
    chi2_dof = summary["separation"]["chi2_dof"]
    off = 5 * math.sqrt(2 / max(summary["counted"] - 1, 1))
    if abs(chi2_dof - 1) > off:
        sentences.append(
            f"The separations scatter by {number(math.sqrt(chi2_dof), 3)} times their errors: something is "
            "not in the model. Of a field that rotates give --law theta=polynomial:1; frames of another "
            "target or camera belong in another run."
        )
    return sentences


def averaging_floor(series: Series | None) -> Floor | None:
    """Return the floor under the averages of a series, where there is enough of it."""
    return None if series is None else fit_floor(series)
