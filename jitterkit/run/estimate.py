"""Kernel estimates of many frames, as a table."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from astropy.table import QTable

from jitterkit.batch.executor import FrameTask, Outcome, execute
from jitterkit.batch.plan import count_frames, plan_batches
from jitterkit.batch.records import BlurMeasurement, SceneEstimate
from jitterkit.errors import printable
from jitterkit.frames import find_files
from jitterkit.frames.reader import Duplicates
from jitterkit.kernels import kernel_moments
from jitterkit.refit import FitResult, Status
from jitterkit.refit.prior_file import CORRELATIONS
from jitterkit.report.columns import Column, bind, measured, named
from jitterkit.report.flags import FLAGS

_MOMENTS = ("sxx", "sxy", "syy")

_POWERS = {"arcsec": 1, "arcsec2": 2}
"""Of the plate scale, in units."""

_COLUMNS = (
    *named("file", "frame", "status", "reason"),
    Column("scene", "scene with which the optics were fitted", kind=str),
    Column("estimator", "name of the estimator", kind=str),
    *(
        column
        for name in _MOMENTS
        for column in measured(name, "second moment of the blur", "arcsec2", format=".3g")
    ),
    *(Column(name, "correlation of the errors of these moments") for name in CORRELATIONS),
    Column("major", "1 sigma of the blur along its major axis", "arcsec", format=".3g"),
    Column("minor", "1 sigma of the blur along its minor axis", "arcsec", format=".3g"),
    *measured("angle", "major axis, counter-clockwise from +x", "deg", format=".1f"),
    *measured("length", "of a streak", "arcsec", format=".3g"),
    *measured("shape", "excess kurtosis of the blur: normal 0, linear -1.2, oscillation -1.5", format=".2f"),
    Column("significance", "chi-squared of three degrees of freedom against no jitter", format=".1f"),
    *named("digest", "message"),
)
"""Lengths are in pixels where a frame has no plate scale."""


class BlurEstimator(FrameTask, Protocol):
    """Measure the blur of frames: :meth:`complete` returns a BlurMeasurement, or a FitResult.

    Attributes
    ----------
    name : str
        Of the estimator.
    threads : int or None
        How many may measure at a time; None for as many as there are processors.
    batch_size : int
        Frames of a batch, all of which are held until it is done.
    """

    @property
    def name(self) -> str: ...

    @property
    def threads(self) -> int | None: ...

    @property
    def batch_size(self) -> int: ...


def estimate_files(
    paths: Sequence[str | Path],
    estimator: BlurEstimator,
    *,
    hdu: int | None = None,
    watch: Callable[[str], None] | None = None,
    keep: Callable[[BlurMeasurement], None] | None = None,
) -> QTable:
    """Estimate the kernel of every frame.

    Parameters
    ----------
    paths : sequence of str or Path
        Files, or directories of them.
    estimator : BlurEstimator
    hdu : int, optional
    watch : callable, optional
        Called with the name of each file when it is done.
    keep : callable, optional
        Called with each frame that could be measured: to draw it, say.

    Returns
    -------
    table : QTable
        One row per frame: file, frame, status, reason, scene, estimator, moments with errors and their
        correlations, axes, length and shape where the estimator knows them, significance, digest of the
        pixels, message.
        In arcsec; in pixels if a frame has no scale.  An undetermined frame has the length and its error
        where they were measured, no moments and no significance.  The frame that is the reference of the
        others has the status ``reference``, one with the pixels of an earlier one ``duplicate``.
    """
    files = find_files(paths)
    batches = plan_batches(files, map(partial(count_frames, hdu=hdu), files), estimator.batch_size)
    rows: list[dict[str, Any]] = []
    known = Duplicates()
    finish = lambda batch, outcomes: outcomes  # noqa: E731
    for outcomes in execute(batches, estimator, finish, hdu=hdu, threads=estimator.threads):
        for one in outcomes:
            rows.append(_row(one, estimator.name, known, keep))
            if watch is not None and one.index == 0:
                watch(printable(one.path.name))
    return _table(rows)


def _table(rows: list[dict[str, Any]]) -> QTable:
    """Make the table; lengths are in pixels if the scale of a frame is not known."""
    scales = [1.0 if row["scale"] is None else row["scale"] for row in rows]
    powers = {} if np.all(np.isfinite(scales)) else _POWERS
    pixels, columns = np.nan_to_num(scales, nan=1.0), []
    for column in _COLUMNS:
        values: Any = [row[column.name] for row in rows]
        if power := powers.get(column.unit):
            column = replace(column, unit=column.unit.replace("arcsec", "pix"))
            values = np.array(values) / pixels**power
        columns.append((column, values))
    return bind(columns)


def _row(one: Outcome, name: str, known: Duplicates, keep: Callable | None) -> dict[str, Any]:
    if isinstance(one.result, FitResult):
        row = _blank(one, name, one.result)
        remark = "" if one.metadata is None else printable(one.metadata.remark)
        return row | {"digest": one.digest, "message": f"{row['message']} {remark}".rstrip()}
    row = _measured_row(one, name, one.result, keep)
    if row["status"] == "ok" and (
        original := known.original(one.digest, f"{printable(one.path)} [{one.index}]")
    ):
        row = _blank(one, name, FitResult.duplicate_of(original))
    return row | {"digest": one.digest}


def _measured_row(
    one: Outcome, name: str, measured: BlurMeasurement, keep: Callable | None
) -> dict[str, Any]:
    estimate = measured.estimate
    message = " ".join(filter(None, [estimate.undetermined, measured.message, *_remarks(measured)]))
    if keep is not None:
        try:
            keep(measured)
        except Exception as error:  # the estimate stands all the same
            message = f"{message} {error}".lstrip()
    status = Status.UNDETERMINED if estimate.undetermined else Status.OK
    row = _blank(one, name, FitResult(status, message)) | {
        "scale": math.nan if measured.plate_scale is None else measured.plate_scale
    }
    row |= {column: getattr(measured, column) for column in ("length", "length_err", "angle_err")}
    if estimate.undetermined:
        return row | {"angle": estimate.axes[2]}
    for column, value, spread in zip(_MOMENTS, estimate.moments, estimate.errors, strict=True):
        row |= {column: value, f"{column}_err": spread}
    row |= {column: _correlation(estimate.covariance, i, j) for column, (i, j) in CORRELATIONS.items()}
    row |= {"scene": measured.scene} | dict(zip(("major", "minor", "angle"), estimate.axes, strict=True))
    row |= {column: getattr(estimate, column) for column in ("shape", "shape_err", "significance")}
    return row


_DOUBTS = ("gain_assumed", "read_noise_assumed", "bias_assumed", "above_adc_range", "dark_not_subtracted")
"""Flags of a calibrated frame on which the errors of an estimate by known optics depend."""


def _remarks(measured: BlurMeasurement) -> Iterator[str]:
    """Yield what a table's numbers do not say of themselves."""
    estimate, frame = measured.estimate, measured.frame
    if isinstance(measured.evidence, SceneEstimate):  # other methods measure the noise of an image
        yield from (f"{flag}: {FLAGS[flag]}." for flag in _DOUBTS if flag in frame.flags)
        yield from (f"{printable(word).capitalize()}." for word in frame.flags if word not in FLAGS)
    yield printable(frame.metadata.remark)
    if estimate.is_undetected:
        yield f"Jitter is undetected (chi-squared {estimate.significance:.1f} of three degrees of freedom)."
    if estimate.locus is None and estimate.kernel is not None:
        own = kernel_moments(estimate.kernel, measured.plate_scale or 1.0)
        if np.any(np.abs(own - estimate.moments) > estimate.errors):
            sizes = ", ".join(f"{name} {value:.3g}" for name, value in zip(_MOMENTS, own, strict=True))
            yield f"The kernel's pixels have other moments than the table: {sizes}; its file has these."


def _correlation(covariance: np.ndarray, i: int, j: int) -> float:
    scale = math.sqrt(covariance[i, i] * covariance[j, j])
    return float(covariance[i, j] / scale) if scale > 0 else math.nan


def _blank(one: Outcome, name: str, result: FitResult) -> dict[str, Any]:
    return {column.name: column.blank for column in _COLUMNS} | {
        "file": printable(one.path.name),
        "frame": one.index,
        "status": result.status.name.lower(),
        "reason": result.reason,
        "estimator": name,
        "scale": None,
        "message": result.message,
    }
