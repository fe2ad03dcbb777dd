"""A run: many files in, one table, one summary and one report out."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from astropy.table import QTable

from jitterkit.batch import FrameProcessor
from jitterkit.batch.configuration import settings, versions
from jitterkit.batch.executor import execute
from jitterkit.batch.plan import count_frames, plan_batches
from jitterkit.batch.resume import FILES
from jitterkit.batch.store import STORE, Store
from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.frames import find_files
from jitterkit.frames.writer import replacing
from jitterkit.report import outputs
from jitterkit.report.html import write_report
from jitterkit.report.pictures import choose_pictures, render_pictures
from jitterkit.report.residual_stack import ResidualStack, join_stacks, most_stacked
from jitterkit.report.row import Row
from jitterkit.report.summary import summarise, write_summary
from jitterkit.report.table import make_table, star_table, write_table
from jitterkit.run.rows import Record, duplicate_marker, recorder
from jitterkit.run.stacked_stars import StackedStars, find_stacked_stars

log = logging.getLogger(__name__)


_PIXELS = 2**21
"""In the frames of a batch: 128 of 128 x 128, 4 s of work, 0.1 GB."""

_FEWEST, _MOST = 16, 128
"""Frames of a batch, whatever their pixels."""


@dataclass(frozen=True)
class Run:
    """Hold the results of a run.

    Attributes
    ----------
    table : QTable
        One row a frame.
    summary : dict
    directory : Path
        Holds ``results.ecsv``, ``summary.json`` and ``report.html``; ``configuration.json``, all settings and
        versions; and ``ledger.sqlite``, with which an interrupted run is resumed.
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
    processor: FrameProcessor,
    *,
    hdu: int | None = None,
    overwrite: bool = False,
    resume: bool = False,
    threads: int | None = None,
    executor: Callable[..., Iterable[Record]] | None = None,
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
    processor : FrameProcessor
    hdu : int, optional
        HDU to read in every FITS file.
    overwrite : bool
        Whether a run that is in the directory may be replaced; its results are removed at once.
    resume : bool
        Whether to continue it instead; frames already processed are not processed again.
    threads : int, optional
        How many frames are fitted at a time; by default as many as there are processors.  The results do
        not depend on it.
    executor : callable, optional
        In place of :func:`~jitterkit.batch.executor.execute` with threads:
        :func:`~jitterkit.batch.cluster.execute_on_cluster` with its ``client`` filled in, say.
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
        to it, or a run that is to be resumed was started differently: with other settings, other versions,
        other files or another content of those that are done.
    FrameError
        If a path does not exist or holds no frame; raised before anything is processed.
    """
    files, directory = find_files(paths), Path(directory)
    size = batch_size(processor.instrument.shape)
    chosen = {} if plan is None else {"plan": plan}
    configuration = settings(processor, files, hdu=hdu, batch=size, **chosen)
    executor = executor or partial(execute, threads=threads)
    with prepare_run(directory, configuration, command, overwrite=overwrite, resume=resume) as store:
        count = partial(count_frames, hdu=hdu)
        store.counts.check(files, count, size, store.done())
        counts = store.counts.frames(files, count)
        mark = duplicate_marker()
        if callback := before or watch:
            for row in store.rows():
                callback(mark(row))
        ranks = store.ranks()
        batches = store.missing(plan_batches(files, counts, size))
        for record in executor(batches, processor, recorder(processor, ranks), hdu=hdu):
            keep(store, record, ranks)
            if watch is not None:
                for row in record.rows:
                    watch(mark(row))
        return write_outputs(store, directory, processor)


def prepare_run(
    directory: Path, configuration: Mapping[str, Any], command: str, *, overwrite: bool, resume: bool
) -> Store:
    """Prepare a run in a directory: a new one, or one that is resumed.

    Raises
    ------
    ConfigurationError
        As for :func:`process_files`.
    """
    if overwrite and resume:
        problem = "--resume continues a run, --overwrite starts it again; give one of the two."
        raise ConfigurationError(ErrorCode.CONFLICT, problem)
    outputs.make_directory(directory, outputs.RUN, overwrite or resume)
    notes = {"command": command}
    if resume:
        return Store.resume(directory, configuration, notes, results=outputs.RUN)
    return Store.create(directory, configuration, notes, overwrite=overwrite, results=outputs.RUN)


def keep(store: Store, record: Record, ranks: list) -> None:
    """Store a record, and update stacks and the ranks of the worst frames."""
    stacks = {name: one.pack() for name, one in join_stacks(_stacks(store), record.stacks).items()}
    store.add(record.batch.number, record.rows, record.pictures, record.batch.start, stacks)
    if record.pictures:
        ranks[:] = store.ranks()


def _stacks(store: Store) -> dict[str, ResidualStack]:
    return {name: ResidualStack.unpack(packed) for name, packed in store.stacks().items()}


def planned_before(directory: str | Path) -> Mapping[str, Any] | None:
    """Return how the settings of the run in a directory were chosen; None if they were not, or no run."""
    path = Path(directory) / STORE
    if not path.exists():
        return None
    with Store(path) as store:
        return store.configuration.get("plan")


def batch_size(shape: tuple[int, int]) -> int:
    """Return how many frames of a shape ``(ny, nx)`` are a batch: more of small ones."""
    return min(max(_PIXELS // (shape[0] * shape[1]), _FEWEST), _MOST)


def write_outputs(store: Store, directory: Path, processor: FrameProcessor, more: Iterable[Row] = ()) -> Run:
    """Write table, summary and report of all that the store holds, and of rows that it is not to keep."""
    rows = map(duplicate_marker(), chain(store.rows(), more))
    table = make_table(rows, _provenance(processor, store.notes.get("command", "")))
    stacks = _stacks(store)
    stack = most_stacked(stacks)
    summary = summarise(table, stack)
    described = {name: value for name, value in store.configuration.items() if name != FILES}
    with replacing(directory / outputs.CONFIGURATION, overwrite=True) as temporary:
        temporary.write_text(json.dumps(described, indent=2) + "\n", encoding="utf-8")
    write_table(directory / outputs.TABLE, table, overwrite=True)
    if (stars := star_table(table)) is not None:
        write_table(directory / outputs.STARS, stars, overwrite=True)
    (directory / outputs.FURTHER_STARS).unlink(missing_ok=True)  # of the run so far
    if (further := _stacked_stars(stacks, table, processor)) is not None:
        write_table(directory / outputs.FURTHER_STARS, further.table, overwrite=True)
        summary["fit"] |= further.described(summary["separation"])
    write_summary(directory / outputs.SUMMARY, summary, overwrite=True)
    duplicates = table[np.asarray(table["status"]) == "duplicate"]
    names = set(zip(duplicates["path"].tolist(), duplicates["frame"].tolist(), strict=True))
    shown = [one for one in store.pictures() if (one[0]["path"], one[0]["frame"]) not in names]
    chosen = choose_pictures([row for row, _ in shown])
    pictures = render_pictures(shown[index] for index in chosen)
    write_report(directory / outputs.REPORT, pictures, table, summary, stack, overwrite=True)
    return Run(table, summary, directory)


def _stacked_stars(
    stacks: Mapping[str, ResidualStack], table: QTable, processor: FrameProcessor
) -> StackedStars | None:
    """Search for stars in the stack; what goes wrong there must not cost a run its outputs."""
    try:
        return find_stacked_stars(stacks, table, processor)
    except Exception as error:
        log.warning("The stacked residual could not be searched for stars: %s", error)
        return None


def _provenance(processor: FrameProcessor, command: str) -> dict[str, Any]:
    """Return the versions and settings that made a table."""
    return {
        "command": command,
        "instrument": processor.instrument.name,
        "locus": processor.locus,
        "estimator": processor.kernel,
        "prior": None if processor.prior is None else processor.prior.source,
        "overrides": {k: v for k, v in processor.overrides.items() if v is not None},
        "versions": versions(),
    }
