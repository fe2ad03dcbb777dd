"""Kernel estimates of many frames, as a table."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from astropy.table import QTable
from astropy.units import Unit

from jitterkit.batch.frame import Processor
from jitterkit.errors import FrameError, JitterkitError
from jitterkit.frames import find_files, open_frames
from jitterkit.refit import FitResult, Status

__all__ = ["estimate_files"]

_UNITS = {
    "sxx": "arcsec2",
    "sxy": "arcsec2",
    "syy": "arcsec2",
    "major": "arcsec",
    "minor": "arcsec",
    "angle": "deg",
}
_UNITS |= {f"{name}_err": "arcsec2" for name in ("sxx", "sxy", "syy")}
_NUMBERS = ("sxx", "sxx_err", "sxy", "sxy_err", "syy", "syy_err", "major", "minor", "angle", "significance")


def estimate_files(
    paths: Sequence[str | Path],
    processor: Processor,
    *,
    hdu: int | None = None,
    watch: Callable[[str], None] | None = None,
) -> QTable:
    """Estimate the kernel of every frame.

    Parameters
    ----------
    paths : sequence of str or Path
        Files, or directories of them.
    processor : Processor
        Its ``kernel`` names the estimator.
    hdu : int, optional
    watch : callable, optional
        Called with the name of each file when it is done.

    Returns
    -------
    table : QTable
        A row a frame: file, frame, status, estimator, moments with errors, axes, significance, message.
    """
    rows = []
    for path in find_files(paths):
        rows += list(_estimates(path, processor, hdu))
        if watch is not None:
            watch(path.name)
    table = QTable()
    for name in ("file", "frame", "status", "estimator", *_NUMBERS, "message"):
        table[name] = np.array([row[name] for row in rows])
        if name in _UNITS:
            table[name] = table[name] << Unit(_UNITS[name])
            table[name].info.format = ".3g"
    table["angle"].info.format = ".1f"
    table["significance"].info.format = ".1f"
    return table


def _estimates(path: Path, processor: Processor, hdu: int | None) -> Iterator[dict[str, Any]]:
    index = 0
    try:
        with open_frames(path, hdu=hdu) as file:
            for index in range(len(file)):
                yield _row(path, index, processor, file[index])
    except FrameError as error:
        yield _blank(path, index, processor, Status.UNREADABLE, str(error))


def _row(path: Path, index: int, processor: Processor, raw) -> dict[str, Any]:
    try:
        estimated = processor.estimate(processor.calibrate(raw))
    except (JitterkitError, ValueError) as error:
        return _blank(path, index, processor, Status.FAILED, str(error))
    if isinstance(estimated, FitResult):
        return _blank(path, index, processor, estimated.status, estimated.message)
    estimate, _ = estimated
    row = _blank(path, index, processor, Status.OK, "")
    for name, value, spread in zip(("sxx", "sxy", "syy"), estimate.moments, estimate.errors, strict=True):
        row |= {name: value, f"{name}_err": spread}
    major, minor, angle = estimate.axes
    return row | {"major": major, "minor": minor, "angle": angle, "significance": estimate.significance}


def _blank(path: Path, index: int, processor: Processor, status: Status, message: str) -> dict[str, Any]:
    row = {"file": path.name, "frame": index, "status": status.name.lower(), "estimator": processor.kernel}
    return row | dict.fromkeys(_NUMBERS, float("nan")) | {"message": message}
