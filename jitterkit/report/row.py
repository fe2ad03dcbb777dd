"""From a fit to a row: one flat record of plain numbers and text.

Reach for :func:`make_row`.  A row holds what JSON and SQLite hold (text, integers, floats, NaN for
what was not fitted), so that a ledger can keep it and :mod:`~jitterkit.report.table` can bind it.
:func:`group_failures` counts failed ones by kind, because nobody reads thousands of messages.
"""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from jitterkit.conventions import axis_angle, direction_angle
from jitterkit.errors import ErrorCode, printable
from jitterkit.frames.metadata import Metadata
from jitterkit.report.columns import COLUMNS, aberration_column
from jitterkit.report.flags import FLAGS, encode_flags
from jitterkit.report.means import corrected

if TYPE_CHECKING:
    from jitterkit.forward import Parameters
    from jitterkit.refit.result import Candidate, FitResult

Row = dict[str, Any]
"""Column name to text, integer or float."""

SCENE = ("separation", "theta", "x", "y", "flux", "contrast", "spectral_index_a", "spectral_index_b")


def make_row(
    result: FitResult,
    path: str | Path | None,
    frame: int = 0,
    *,
    metadata: Metadata | None = None,
    flags: Iterable[str] = (),
    pixel: tuple[float, float] = (math.nan, math.nan),
    pa: float = math.nan,
    digest: str = "",
) -> Row:
    """Make the row of one frame.

    Parameters
    ----------
    result : FitResult
        Of any status; a frame that could not even be read has one too.
    path : str, Path or None
        The file; None for an array.
    frame : int
        Place of the frame in the file, from 0.
    metadata : Metadata, optional
        Gives the time and the exposure; its warnings raise the flag ``header_odd`` and end the message.
    flags : iterable of str
        Remarks of the frame, to which the fit's own are added.
    pixel : (float, float)
        Place of the star, or midpoint of the pair, ``(x, y)``, 0-based pixels of the original frame.
    pa : float
        Position angle of the pair on the sky, north through east [deg], where a WCS gives it.
    digest : str
        ``RawFrame.digest``, by which duplicates are recognised.

    Returns
    -------
    row : dict
        Every column of :data:`~jitterkit.report.columns.COLUMNS`, and two for each aberration.  All
        numbers of a frame that was not fitted are NaN.
    """
    metadata = metadata or Metadata()
    odd = ["header_odd"] if metadata.warnings else []
    words = list(dict.fromkeys([*flags, *result.flags, *odd]))
    row: Row = {column.name: column.blank for column in COLUMNS}
    row |= {
        "file": printable("array" if path is None else Path(path).name),
        "path": printable("" if path is None else path),
        "frame": int(frame),
        "time": printable(metadata.value("time", "")),
        "exposure": float(metadata.value("exposure", math.nan)),
        "status": result.status.name.lower(),
        "reason": result.reason,
        "message": _message(result, words, metadata),
        "flags": encode_flags(words),
        "scene": "" if result.parameters is None else result.parameters.scene.name,
        "locus": result.locus,
        "locus_weight": float(result.locus_weight),
        "chi2_dof": float(result.chi2_dof),
        "dof": int(result.dof),
        "further_limit": float(result.further_limit),
        "candidates": _candidates(result.candidates),
        "stars": encode_stars(result),
        "iterations": int(result.iterations),
        "seconds": float(result.seconds),
        "digest": digest,
    }
    if result.parameters is not None:
        with np.errstate(invalid="ignore"):  # a fit that broke down may have a negative variance
            row |= _fitted(result, result.parameters)
        row |= {"x_pixel": float(pixel[0]), "y_pixel": float(pixel[1])}
        row |= _stated(row, metadata)
        row |= {"pa": float(pa), "pa_err": row["theta_err"] if math.isfinite(pa) else math.nan}
    return row


def _stated(row: Row, metadata: Metadata) -> Row:
    """Columns of what is known of a separation beside its fit; a plate scale that was fitted adds nothing."""
    separation, fitted = row["separation"], math.isfinite(row["plate_scale_shift_err"])
    names = ("plate_scale_err", "va_factor", "orbit_change")
    scale, factor, change = (metadata.value(name, math.nan) for name in names)
    return {
        "separation_scale_err": math.nan if fitted else separation * scale,
        "va_factor": factor,
        "orbit_change": change,
        "separation_corrected": float(corrected(separation, factor, change)),
    }


def _message(result: FitResult, words: Iterable[str], metadata: Metadata) -> str:
    strange = [printable(word) for word in words if word not in FLAGS]
    text = printable(result.message or result.status.value)
    text = f"{text} ({', '.join(strange)})" if strange else text
    return f"{text} {printable(metadata.remark)}".rstrip()


def encode_stars(result: FitResult) -> str:
    """Write all stars of a frame as JSON; empty where it shows no further star.

    Of each ``[x, x_err, y, y_err, flux, flux_err]``, arcsec and electrons; null where an error is not known.
    """
    if result.parameters is None or result.parameters.scene.others is None:
        return ""
    import jax  # loaded already by whoever holds a FitResult

    scene = result.parameters.scene
    values = np.array(list(scene.values.values()))
    slopes = jax.jacfwd(lambda v: scene.at(v).sources())(values)
    indices = [name in result.names for name in scene.names]
    fitted = [result.names.index(name) for name in scene.names if name in result.names]
    covariance = np.zeros((len(values), len(values)))
    covariance[np.ix_(indices, indices)] = result.covariance[np.ix_(fitted, fitted)]
    numbers = []
    for value, slope in zip(scene.sources(), map(np.asarray, slopes), strict=True):
        with np.errstate(invalid="ignore"):  # a fit that broke down may have a negative variance
            numbers += [np.asarray(value), np.sqrt(np.einsum("ij,jk,ik->i", slope, covariance, slope))]
    stars = zip(*numbers, strict=True)
    rounded = [[float(f"{v:.9g}") if np.isfinite(v) else None for v in star] for star in stars]
    return json.dumps(rounded, separators=(",", ":"))


def _fitted(result: FitResult, parameters: Parameters) -> Row:
    """Columns of what was fitted."""
    from jitterkit.forward import GRADIENT  # JAX: loaded already by whoever holds a FitResult

    row: Row = {}
    for name in SCENE:
        row |= _with_error(name, result.of_scene(name), result.error(name))
    row["theta"] = direction_angle(row["theta"])
    bounds = dict(zip(result.names, result.crlb, strict=False))
    row |= {"separation_crlb": float(bounds.get("separation", math.nan))}
    row |= {"separation_spread": result.separation_spread}
    row |= {"separation_model_err": result.model_part("separation"), "model_error": result.model_error}
    row |= _with_error("shape", result.shape, result.shape_err)
    background = dict(zip(GRADIENT, parameters.gradient, strict=True), background=parameters.background)
    for name, value in background.items():
        row |= _with_error(name, value, result.error(name))
    for name, value in zip(result.aberrations, parameters.aberrations, strict=False):
        row |= _with_error(aberration_column(name), value, result.error(name))
    return row | _jitter(result, parameters)


def _with_error(column: str, value: Any, error: float) -> Row:
    return {column: float(value), f"{column}_err": error}


def _jitter(result: FitResult, parameters: Parameters) -> Row:
    """Return the second moments, principal axes and the locus's own size."""
    from jitterkit.loci.base import principal_axes  # likewise

    moments, covariance = result.moments()
    free = set(parameters.locus.names) & set(result.names)
    errors = np.sqrt(np.diag(covariance)) if free else np.full(3, np.nan)
    major, minor, angle = principal_axes(moments)
    row = {
        "jitter_major": major,
        "jitter_minor": minor,
        "jitter_angle": axis_angle(angle) if major > 0 else math.nan,
        "jitter_length": float(parameters.locus.describe().get("length", math.nan)),
    }
    for name, value, error in zip(("sxx", "sxy", "syy"), moments, errors, strict=True):
        row |= _with_error(name, value, float(error))
    return row


def _candidates(candidates: Iterable[Candidate]) -> str:
    """Compact JSON, best first; empty where only one locus was tried."""
    fields = [
        {
            "locus": one.locus,
            "weight": _rounded(one.weight, 6),
            "objective": _rounded(one.objective, 3),  # differences of a few decide; the rest is constant
            "separation": _rounded(one.separation, 9),
            "separation_err": _rounded(one.separation_err, 9),
            "evidence": _rounded(one.evidence, 3),
        }
        for one in sorted(candidates, key=lambda one: -one.weight)
    ]
    return json.dumps(fields, separators=(",", ":"), allow_nan=False) if fields else ""


def _rounded(value: float, decimals: int) -> float | None:
    return round(float(value), decimals) if math.isfinite(value) else None


@dataclass(frozen=True)
class FailureKind:
    """Frames that failed alike.

    Attributes
    ----------
    status : str
    reason : str
        Value of their :class:`~jitterkit.errors.ErrorCode`; empty in a table of version 0.1.9 or earlier.
    count : int
    example : dict
        Row of the first of them.
    """

    status: str
    reason: str
    count: int
    example: Row

    @property
    def meaning(self) -> str:
        """Return the reason in words."""
        try:
            return ErrorCode(self.reason).meaning
        except ValueError:  # a table of another version
            return self.reason.replace("_", " ")


def group_failures(rows: Iterable[Row]) -> list[FailureKind]:
    """Count failures by status and reason.

    Parameters
    ----------
    rows : iterable of dict
        Rows of failed frames, with ``status`` and ``reason``.

    Returns
    -------
    kinds : list of FailureKind
        The most frequent first.
    """
    counts: Counter[tuple[str, str]] = Counter()
    examples: dict[tuple[str, str], Row] = {}
    for row in rows:
        kind = (row["status"], row.get("reason", ""))
        counts[kind] += 1
        examples.setdefault(kind, row)
    return [FailureKind(*kind, count, examples[kind]) for kind, count in counts.most_common()]
