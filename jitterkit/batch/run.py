"""A run: many files in, one table, one summary and one report out."""

from __future__ import annotations

import logging
import platform
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from jitterkit.batch.frame import Processed, Processor
from jitterkit.errors import FrameError
from jitterkit.frames import find_files, open_frames
from jitterkit.refit import FitResult, Status
from jitterkit.report.html import write_report
from jitterkit.report.outputs import REPORT, RUN, SUMMARY, TABLE, make_directory
from jitterkit.report.pictures import Gallery, render_frame
from jitterkit.report.row import Row, make_row
from jitterkit.report.summary import summarise, write_summary
from jitterkit.report.table import make_table, write_table

__all__ = ["Run", "process_files"]

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Run:
    """What a run left behind.

    Attributes
    ----------
    table : QTable
        One row a frame.
    summary : dict
    directory : Path
        Holds ``results.ecsv``, ``summary.json`` and ``report.html``.
    """

    table: Any
    summary: dict[str, Any]
    directory: Path

    @property
    def failures(self) -> int:
        """Frames without usable numbers."""
        return int(sum(status != "ok" for status in self.table["status"]))


def process_files(
    paths: Sequence[str | Path],
    directory: str | Path,
    processor: Processor,
    *,
    hdu: int | None = None,
    overwrite: bool = False,
    watch: Callable[[Row], None] | None = None,
    command: str = "",
) -> Run:
    """Process files and write table, summary and report.

    Parameters
    ----------
    paths : sequence of str or Path
        Files, and directories whose FITS and TIFF files are taken in order of name.
    directory : str or Path
        Made if need be.
    processor : Processor
    hdu : int, optional
        HDU to read in every FITS file.
    overwrite : bool
        Whether the three files may be replaced.
    watch : callable, optional
        Called with each row as it is done.
    command : str
        The command line, to be kept with the table.

    Returns
    -------
    run : Run

    Raises
    ------
    ConfigurationError
        If the outputs exist and may not be replaced, or the directory cannot be made.
    FrameError
        If a path does not exist or holds no frame: told before anything is processed.
    """
    files = find_files(paths)
    directory = Path(directory)
    make_directory(directory, RUN, overwrite)
    gallery, rows = Gallery(), []
    for processed, row in _rows(files, processor, hdu):
        rows.append(row)
        if processed.frame is not None and gallery.wants(processed.result):
            gallery.add(render_frame(processed.frame, processed.result, row))
        if watch is not None:
            watch(row)
    table = make_table(rows, _provenance(processor, command))
    summary = summarise(table)
    write_table(directory / TABLE, table, overwrite=overwrite)
    write_summary(directory / SUMMARY, summary, overwrite=overwrite)
    write_report(directory / REPORT, gallery.chosen(), table, summary, overwrite=overwrite)
    return Run(table, summary, directory)


def _rows(files: Iterable[Path], processor: Processor, hdu: int | None) -> Iterator[tuple[Processed, Row]]:
    """Every frame of every file with its row; a file that cannot be read is one row."""
    for path in files:
        index = 0
        try:
            with open_frames(path, hdu=hdu) as file:
                for index in range(len(file)):
                    raw = file[index]
                    processed = processor.process(raw)
                    frame = processed.frame
                    row = make_row(
                        processed.result,
                        path,
                        index,
                        metadata=raw.metadata if frame is None else frame.metadata,
                        flags=() if frame is None else frame.flags,
                        pixel=processed.pixel,
                        pa=processed.pa,
                        aberrations=processor.instrument.aberrations,
                    )
                    yield processed, row
        except FrameError as error:
            failed = Processed(None, FitResult(Status.UNREADABLE, str(error)))
            yield failed, make_row(failed.result, path, index)


def _provenance(processor: Processor, command: str) -> dict[str, Any]:
    """Versions and settings that made a table."""
    versions = {"python": platform.python_version()}
    for name in ("jitterkit", "jax", "numpy", "astropy"):
        with suppress(PackageNotFoundError):
            versions[name] = version(name)
    return {
        "command": command,
        "instrument": processor.instrument.name,
        "locus": processor.locus,
        "estimator": processor.kernel,
        "prior": None if processor.prior is None else processor.prior.source,
        "overrides": {k: v for k, v in processor.overrides.items() if v is not None},
        "versions": versions,
    }
