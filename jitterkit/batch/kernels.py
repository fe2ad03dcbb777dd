"""Kernel estimates of many frames, as a table."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from astropy.table import QTable
from astropy.units import Unit

from jitterkit.batch.measured import Measured
from jitterkit.batch.measurer import Measurer
from jitterkit.batch.plan import Batch, count_frames, plan_batches
from jitterkit.batch.stream import in_threads
from jitterkit.errors import ErrorCode, FrameError, JitterkitError, UndeterminedError, code_of, out_of_memory
from jitterkit.frames import RawFrame, find_files
from jitterkit.frames.duplicates import Duplicates
from jitterkit.kernels import kernel_moments
from jitterkit.refit import FitResult, Status
from jitterkit.refit.prior_file import CORRELATIONS
from jitterkit.report.words import printable

__all__ = ["estimate_files"]

_MOMENTS = ("sxx", "sxy", "syy")
_POWERS = dict.fromkeys((*_MOMENTS, *(f"{name}_err" for name in _MOMENTS)), 2)
_POWERS |= dict.fromkeys(("major", "minor", "length", "length_err"), 1)
"""Columns that are powers of a length."""

_NUMBERS = (
    *(f"{name}{end}" for name in _MOMENTS for end in ("", "_err")),
    *CORRELATIONS,
    *("major", "minor", "angle", "angle_err", "length", "length_err", "shape", "shape_err", "significance"),
)

_BREAKDOWNS = (JitterkitError, ArithmeticError, ValueError, np.linalg.LinAlgError)
"""What one frame may raise without harm to the others."""

_FORMATS = {"angle": ".1f", "angle_err": ".1f", "shape": ".2f", "shape_err": ".2f", "significance": ".1f"}


def estimate_files(
    paths: Sequence[str | Path],
    measurer: Measurer,
    *,
    hdu: int | None = None,
    watch: Callable[[str], None] | None = None,
    keep: Callable[[Measured], None] | None = None,
) -> QTable:
    """Estimate the kernel of every frame.

    Parameters
    ----------
    paths : sequence of str or Path
        Files, or directories of them.
    measurer : Measurer
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
    batches = plan_batches(files, map(partial(count_frames, hdu=hdu), files), measurer.together)

    def begin(batch: Batch) -> Callable[[Path, int, RawFrame | JitterkitError], _Ready]:
        return partial(_begin, measurer.among(batch, hdu))

    rows: list[dict[str, Any]] = []
    known = Duplicates()
    for batch, results in in_threads(batches, begin, _measure, hdu=hdu, threads=measurer.threads):
        for (path, index), result in zip(batch.items, results, strict=True):
            rows.append(_row(path, index, measurer, result, known, keep))
            if watch is not None and index == 0:
                watch(printable(path.name))
    return _table(rows)


class _Unreadable(JitterkitError):
    """A file that gives no frame, and why."""


_Result = tuple[Measured | FitResult, str] | Exception
"""What a frame gives, with the digest of its pixels; or what it raised."""


class _Ready(NamedTuple):
    """A frame that has been read.

    Attributes
    ----------
    measurer : Measurer
        Of its batch.
    begun : Any
        By it; or the frame itself, where there was trouble: the thread will say which, or it is over.
    digest : str or None
        Of its pixels; None where nothing has begun.
    """

    measurer: Measurer[Any]
    begun: Any
    digest: str | None = None

    def measured(self) -> tuple[Measured | FitResult, str]:
        """What measuring it gives."""
        if isinstance(self.begun, Exception):
            raise self.begun
        if self.digest is None:
            return self.measurer.measure(self.measurer.begin(self.begun)), self.begun.digest
        return self.measurer.measure(self.begun), self.digest


def _begin(measurer: Measurer[Any], path: Path, index: int, raw: RawFrame | JitterkitError) -> _Ready:
    """Begin a frame where it is read."""
    if isinstance(raw, JitterkitError):
        return _Ready(measurer, _Unreadable(raw.code, str(raw)))
    try:
        return _Ready(measurer, measurer.begin(raw), raw.digest)
    except Exception:
        return _Ready(measurer, raw)


def _measure(frame: _Ready, last: bool) -> _Result:
    """Measure a frame, or say what it raised; where no other try is left, a lack of memory too."""
    try:
        return frame.measured()
    except _BREAKDOWNS as error:
        return error
    except Exception as error:
        if last and out_of_memory(error):
            return error
        raise


def _table(rows: list[dict[str, Any]]) -> QTable:
    scaled = all(math.isfinite(row["scale"]) for row in rows if row["scale"] is not None)
    table = QTable()
    for name in ("file", "frame", "status", "reason", "scene", "estimator", *_NUMBERS, "digest", "message"):
        power = _POWERS.get(name, 0)
        values = [row[name] if scaled or not power else _in_pixels(row, name, power) for row in rows]
        table[name] = np.array(values)
        if power:
            table[name] = table[name] << Unit("arcsec" if scaled else "pix") ** power
            table[name].info.format = ".3g"
    for name in ("angle", "angle_err"):
        table[name] = table[name] << Unit("deg")
    for name, how in _FORMATS.items():
        table[name].info.format = how
    return table


def _in_pixels(row: dict[str, Any], name: str, power: int) -> float:
    scale = row["scale"] or 1.0
    return row[name] / (scale if math.isfinite(scale) else 1.0) ** power


def _row(
    path: Path, index: int, measurer: Measurer, result: _Result, known: Duplicates, keep
) -> dict[str, Any]:
    if isinstance(result, Exception):
        return _blank(path, index, measurer, FitResult.from_error(_status(result), result))
    measured, digest = result
    row = _measured_row(path, index, measurer, measured, keep)
    if row["status"] == "ok" and (original := known.original(digest, f"{printable(path)} [{index}]")):
        row = _blank(path, index, measurer, FitResult.duplicate_of(original))
    return row | {"digest": digest}


def _status(error: Exception) -> Status:
    """Map an exception to a status."""
    if isinstance(error, _Unreadable):
        return Status.UNREADABLE
    code = code_of(error)
    if code is ErrorCode.NO_STAR and isinstance(error, FrameError | UndeterminedError):
        return Status.NO_STAR
    if isinstance(error, UndeterminedError):
        return Status.REFERENCE if code is ErrorCode.IS_REFERENCE else Status.UNDETERMINED
    return Status.FAILED


def _measured_row(
    path: Path, index: int, measurer: Measurer, measured: Measured | FitResult, keep
) -> dict[str, Any]:
    if isinstance(measured, FitResult):
        return _blank(path, index, measurer, measured)
    estimate = measured.estimate
    message = " ".join(filter(None, [estimate.undetermined, measured.message, *_remarks(measured)]))
    if keep is not None:
        try:
            keep(measured)
        except _BREAKDOWNS as error:  # the estimate stands all the same
            message = f"{message} {error}".lstrip()
    status = Status.UNDETERMINED if estimate.undetermined else Status.OK
    row = _blank(path, index, measurer, FitResult(status, message)) | {
        "scale": math.nan if measured.plate_scale is None else measured.plate_scale
    }
    row |= {name: getattr(measured, name) for name in ("length", "length_err", "angle_err")}
    if estimate.undetermined:
        return row | {"angle": estimate.axes[2]}
    for name, value, spread in zip(_MOMENTS, estimate.moments, estimate.errors, strict=True):
        row |= {name: value, f"{name}_err": spread}
    row |= {name: _correlation(estimate.covariance, i, j) for name, (i, j) in CORRELATIONS.items()}
    row |= {"scene": measured.scene} | dict(zip(("major", "minor", "angle"), estimate.axes, strict=True))
    row |= {name: getattr(estimate, name) for name in ("shape", "shape_err", "significance")}
    return row


def _remarks(measured: Measured) -> Iterator[str]:
    """What a table's numbers do not say of themselves."""
    estimate = measured.estimate
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


def _blank(path: Path, index: int, measurer: Measurer, result: FitResult) -> dict[str, Any]:
    row = {
        "file": printable(path.name),
        "frame": index,
        "status": result.status.name.lower(),
        "reason": result.reason,
        "scene": "",
        "estimator": measurer.name,
        "digest": "",
    }
    return row | dict.fromkeys(_NUMBERS, math.nan) | {"scale": None, "message": result.message}
