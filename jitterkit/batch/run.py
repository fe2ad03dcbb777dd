"""A run: many files in, one table, one summary and one report out."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from astropy.table import QTable

from jitterkit.batch.configuration import settings, versions
from jitterkit.batch.duplicates import duplicate_marker
from jitterkit.batch.frame import Processor
from jitterkit.batch.ledger import LEDGER, Ledger
from jitterkit.batch.ledger_match import FILES
from jitterkit.batch.plan import count_frames, plan_batches
from jitterkit.batch.stream import Done, process_batches
from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.frames import find_files
from jitterkit.frames.whole import replacing
from jitterkit.report.html import write_report
from jitterkit.report.outputs import CONFIGURATION, REPORT, RUN, STARS, SUMMARY, TABLE, make_directory
from jitterkit.report.pictures import FrameReport
from jitterkit.report.row import Row
from jitterkit.report.star_table import star_table
from jitterkit.report.summary import summarise, write_summary
from jitterkit.report.table import make_table, write_table

__all__ = ["Run", "conclude", "planned_before", "process_files"]

log = logging.getLogger(__name__)

_PIXELS = 2**21
"""In the frames of a batch: 128 of 128 x 128, 4 s of work, two of which a kill may cost; 0.1 GB."""

_FEWEST, _MOST = 16, 128


@dataclass(frozen=True)
class Run:
    """What a run left behind.

    Attributes
    ----------
    table : QTable
        One row a frame.
    summary : dict
    directory : Path
        Holds ``results.ecsv``, ``summary.json`` and ``report.html``; ``configuration.json``, all settings and
        versions; and ``ledger.sqlite``, with which a run that was interrupted goes on.
    """

    table: Any
    summary: dict[str, Any]
    directory: Path

    @property
    def failures(self) -> int:
        """Frames without usable numbers, duplicates not counted."""
        return int(sum(status not in ("ok", "duplicate") for status in self.table["status"]))


def process_files(
    paths: Sequence[str | Path],
    directory: str | Path,
    processor: Processor,
    *,
    hdu: int | None = None,
    overwrite: bool = False,
    resume: bool = False,
    threads: int | None = None,
    engine: Callable[..., Iterable[Done]] | None = None,
    watch: Callable[[Row], None] | None = None,
    before: Callable[[Row], None] | None = None,
    command: str = "",
    plan: Mapping[str, Any] | None = None,
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
        Whether a run that is in the directory may be replaced; its results are removed at once.
    resume : bool
        Whether to go on with it instead; what has been done is not done again.
    threads : int, optional
        How many frames are fitted at a time; by default as many as there are processors.  The results do
        not depend on it.
    engine : callable, optional
        What processes batches, in place of :func:`~jitterkit.batch.stream.process_batches` with threads:
        :func:`~jitterkit.batch.cluster.process_on_cluster` with its ``client`` filled in, say.
    watch : callable, optional
        Called with each row as it is done.
    before : callable, optional
        Called first, with each row of an earlier session; by default ``watch``.
    command : str
        The command line, to be kept with the table.
    plan : mapping, optional
        How the settings of the processor were chosen, to be kept with the run; see :func:`planned_before`.

    Returns
    -------
    run : Run

    Raises
    ------
    ConfigurationError
        If the outputs exist and may not be replaced, the directory cannot be written, another run is writing
        to it, or a run that is to be resumed was begun otherwise: with other settings, other versions, other
        files or another content of those that are done.
    FrameError
        If a path does not exist or holds no frame: told before anything is processed.
    """
    if overwrite and resume:
        raise ConfigurationError(
            ErrorCode.CONFLICT, "--resume goes on with a run, --overwrite begins anew; give one of the two."
        )
    files, directory = find_files(paths), Path(directory)
    make_directory(directory, RUN, overwrite or resume)
    size = batch_size(processor.instrument.shape)
    chosen = {} if plan is None else {"plan": plan}
    configuration = settings(processor, files, hdu=hdu, batch=size, **chosen)
    begin = Ledger.resume if resume else partial(Ledger.create, overwrite=overwrite)
    engine = engine or partial(process_batches, threads=threads)
    with begin(directory, configuration, {"command": command}) as ledger:
        count, done = partial(count_frames, hdu=hdu), ledger.done()
        ledger.check_files(files, count, size)
        counts = ledger.frame_counts(files, count)
        mark = duplicate_marker()
        if tell := before or watch:
            for row in ledger.rows():
                tell(mark(row))
        missing = (batch for batch in plan_batches(files, counts, size) if batch.number not in done)
        for part in engine(missing, processor, hdu=hdu, ranks=ledger.ranks):
            ledger.add(part.batch.number, part.rows, part.pictures)
            if watch is not None:
                for row in part.rows:
                    watch(mark(row))
        return conclude(ledger, directory, processor)


def planned_before(directory: str | Path) -> Mapping[str, Any] | None:
    """How the settings of the run in a directory were chosen; None if it has none, or they were not."""
    path = Path(directory) / LEDGER
    if not path.exists():
        return None
    with Ledger(path) as ledger:
        return ledger.configuration.get("plan")


def batch_size(shape: tuple[int, int]) -> int:
    """Frames of a shape ``(ny, nx)`` that are done together: more of small ones."""
    return min(max(_PIXELS // (shape[0] * shape[1]), _FEWEST), _MOST)


def conclude(ledger: Ledger, directory: Path, processor: Processor, more: Iterable[Row] = ()) -> Run:
    """Table, summary and report of all that the ledger holds, and of rows that it is not to keep."""
    rows = map(duplicate_marker(), chain(ledger.rows(), more))
    table = make_table(rows, _provenance(processor, ledger.notes.get("command", "")))
    summary = summarise(table)
    described = {name: value for name, value in ledger.configuration.items() if name != FILES}
    with replacing(directory / CONFIGURATION, overwrite=True) as temporary:
        temporary.write_text(json.dumps(described, indent=2) + "\n", encoding="utf-8")
    write_table(directory / TABLE, table, overwrite=True)
    if (stars := star_table(table)) is not None:
        write_table(directory / STARS, stars, overwrite=True)
    write_summary(directory / SUMMARY, summary, overwrite=True)
    write_report(
        directory / REPORT, _without_duplicates(ledger.pictures(), table), table, summary, overwrite=True
    )
    return Run(table, summary, directory)


def _without_duplicates(pictures: Iterable[FrameReport], table: QTable) -> Iterator[FrameReport]:
    duplicates = table[np.asarray(table["status"]) == "duplicate"]
    names = set(zip(duplicates["path"].tolist(), duplicates["frame"].tolist(), strict=True))
    return (one for one in pictures if (one.row["path"], one.row["frame"]) not in names)


def _provenance(processor: Processor, command: str) -> dict[str, Any]:
    """Versions and settings that made a table."""
    return {
        "command": command,
        "instrument": processor.instrument.name,
        "locus": processor.locus,
        "estimator": processor.kernel,
        "prior": None if processor.prior is None else processor.prior.source,
        "overrides": {k: v for k, v in processor.overrides.items() if v is not None},
        "versions": versions(),
    }
