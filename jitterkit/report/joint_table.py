"""The table of a joint fit, a row a frame: reach for :func:`frame_table`.

:func:`separation_series` is what averages are studied on.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import chain
from typing import Any

import numpy as np
from astropy.table import QTable

from jitterkit.conventions import direction_angle
from jitterkit.errors import printable
from jitterkit.joint import SequenceFit, SequenceFrame
from jitterkit.loci import principal_axes
from jitterkit.optics.otf import PLATE_SCALE
from jitterkit.report.columns import Column, bind_rows, measured, named, unit_of
from jitterkit.report.flags import encode_flags, flag_meanings
from jitterkit.report.means import corrected
from jitterkit.series import Series

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
