"""Fit frames one by one, ``jitterkit process``, or as they arrive, ``jitterkit watch``.

Both write a directory of results: :class:`Run` declares its options, and :func:`finalize` reports the
result.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from jitterkit.cli import options
from jitterkit.cli.frame_fit import FrameFit, Plan
from jitterkit.cli.progress import live_screen, run_progress
from jitterkit.cli.runtime import LISTED, SOME_FAILED, as_interrupt, command_line, log, until_interrupted
from jitterkit.errors import ErrorCode, printable, refuse_if
from jitterkit.report.flags import decode_flags
from jitterkit.report.words import angle_size, by_scale, ellipse_size, with_error

_REPORTED = {"prior_contradicted", "prior_unused", "prior_namesake"}
"""Flags of fitted frames that are worth a line on stderr."""

_OF_DETECTORS = ("header_odd", "gain_assumed", "read_noise_assumed", "bias_assumed", "above_adc_range")
_DOUBTS = ("maybe_pair", *_OF_DETECTORS, "other")
"""Flags of fitted frames that leave a number in doubt, worth a line for all frames."""


@dataclass(frozen=True, kw_only=True)
class Run:
    """Choose what happens to the results of an earlier run.

    Parameters
    ----------
    resume
        Continue an interrupted run; no frame is fitted twice.
    """

    overwrite: bool = False
    resume: bool = False

    def check(self, output: Path) -> None:
        """Refuse a directory that cannot be written, or that holds results which may not be replaced.

        Raises
        ------
        ConfigurationError
        """
        from jitterkit.report.outputs import RUN, check_directory

        check_directory(output, RUN, self.overwrite or self.resume)

    def settings(self) -> dict[str, Any]:
        """Return the settings of the executor."""
        return {"overwrite": self.overwrite, "resume": self.resume, "command": command_line()}


def finalize(run, telescope) -> None:
    """Report the result of a run; exit with status 1 if some frames were not fitted."""
    _list_frames(run)
    _list_doubts(run)
    _echo_result(run)
    warn_of_rolling_shutter(run, telescope)
    if run.failures:
        raise typer.Exit(SOME_FAILED)


def _list_frames(run) -> None:
    """Log the frames that were not fitted, and those whose prior was not used."""
    rows = ((row, set(decode_flags(row["flags"]))) for row in run.table)
    listed = [row for row, flags in rows if row["status"] != "ok" or _REPORTED & flags]
    for row in listed[:LISTED]:
        log(f"{row['file']} [{row['frame']}] {row['status']}: {row['message']}")
    if len(listed) > LISTED:
        log(f"... and {len(listed) - LISTED} more, which the table and the report have")


def _list_doubts(run) -> None:
    """Log how many fitted frames have a flag that leaves a number in doubt, with the first one's message."""
    fitted = run.table[run.table["status"] == "ok"]
    flags = [decode_flags(code) for code in fitted["flags"]]
    counts = {flag: sum(flag in words for words in flags) for flag in _DOUBTS}
    if any(counts.values()):
        shown = ", ".join(f"{flag} ({count})" for flag, count in counts.items() if count)
        row = fitted[next(index for index, words in enumerate(flags) if set(_DOUBTS) & set(words))]
        log(f"Flags of fitted frames: {shown}. {row['file']} [{row['frame']}]: {row['message']}")


def _echo_result(run) -> None:
    """Print the separation, or the jitter of stars, on stdout; log the rest."""
    from jitterkit.report import sequence

    fitted = int(sum(run.table["status"] == "ok"))
    separation, jitter = run.summary["separation"], run.summary["jitter"]
    if pairs := separation["n"]:
        value = with_error(separation["mean"], separation["error"])
        typer.echo(f"separation {value} arcsec from {pairs} frames{by_scale(separation['scale_error'])}")
        doubts = sequence.describe_misfits(separation), sequence.describe_scatter(run.table, separation)
        for sentence in filter(None, doubts):
            typer.echo(sentence)
        if (right := run.summary["separation_corrected"])["n"]:
            value = with_error(right["mean"], right["error"])
            typer.echo(f"separation_corrected {value} arcsec from {right['n']} frames")
        if separation["model_error"] > 0:
            size = angle_size(separation["model_error"], 2)
            log(f"Errors of the model may move every frame alike, by {size}: that does not average out.")
    elif fitted:
        size = ellipse_size(jitter["major"], jitter["minor"])
        typer.echo(f"jitter, 1 sigma, {size} from {fitted} frames")
    if loci := sequence.describe_loci(run.summary["loci"]):
        log(loci)
    if misfit := sequence.describe_run_fit(run.summary["fit"]):
        typer.echo(misfit)
    log(f"{fitted} of {len(run.table)} frames fitted; results in {run.directory}")


def warn_of_rolling_shutter(run, telescope) -> None:
    """Log what a rolling shutter may have done to the separation, which one frame does not show."""
    from jitterkit.detectors import detector_preset

    detector, summary = telescope.detector, run.summary["separation"]
    line_time, separation = detector.line_time, summary["mean"]
    drifts = 2 * run.summary["locus"].get("linear", 0) > summary["n"] > 0
    rolls = any("IMX183" in source for source in detector.sources.values())
    if drifts and rolls and line_time is None:
        # the variance of a drift is its length squared over twelve
        speed = run.summary["jitter"]["major"] * math.sqrt(12) / telescope.exposure
        row = detector_preset("imx183").line_time or 0.0
        moved = speed * row * separation / telescope.plate_scale
        if moved > summary["error"]:
            size = angle_size(moved, 2)
            log(
                "The rows of an IMX183 are exposed one after the other, and line_time is not known: a "
                f"drift of {angle_size(speed)} per second moves the separation by up to {size}. Give "
                f"line_time in [detector]: {row:g} as toliman-camera has it, 0 if rows are exposed at once."
            )
    elif line_time and separation == separation:  # not NaN
        leverage = abs(line_time) * separation / telescope.plate_scale
        log(
            "The rows of this detector are exposed one after the other, which one frame does not show: a "
            f"drift along the pair and the columns moves its separation by {angle_size(leverage, 2)} per "
            "arcsec/s. 'jitterkit sequence' takes it out."
        )


@dataclass(frozen=True, kw_only=True)
class Workers:
    """Choose the processes that share the work.

    Parameters
    ----------
    workers
        Number of processes on this machine, each with one thread; by default one process with as many threads
        as there are processors.
    scheduler : ADDRESS
        Scheduler of dask.distributed whose workers share the work: tcp://host:8786. Files must be readable
        there under the same paths.
    """

    workers: Annotated[int | None, typer.Option(min=1, max=1024)] = None
    scheduler: str | None = None

    def check(self) -> None:
        """Refuse workers beside those of a scheduler."""
        problem = "A scheduler has its own workers; give --workers or --scheduler."
        refuse_if(self.workers is not None and self.scheduler is not None, ErrorCode.CONFLICT, problem)

    @contextlib.contextmanager
    def executor(self) -> Iterator[Callable | None]:
        """Yield the function that processes batches on the workers; None if there are none."""
        if self.workers is None and self.scheduler is None:
            yield None
            return
        from jitterkit.batch.cluster import connected, execute_on_cluster

        with connected(self.workers, self.scheduler) as client:
            yield partial(execute_on_cluster, client=client)


def process(
    *,
    files: options.Files,
    output: options.OutputDirectory,
    hdu: int | None = None,
    workers: Workers,
    plan: Plan,
    run: Run,
    fit: FrameFit,
) -> None:
    """Fit every frame: kernel estimate, then separation, optics and jitter together.

    Writes results.ecsv (a row per frame), summary.json, report.html, configuration.json and, during the run,
    ledger.sqlite. Exit status: 0 if every frame was fitted, 1 if some were not, 2 if the command cannot be
    carried out.
    """
    from jitterkit.frames import find_files

    workers.check()
    plan.check()
    paths = find_files(files)
    run.check(output)
    processor, planned = plan.apply(fit.processor(), paths, hdu, output if run.resume else None)
    from jitterkit.run import process_files

    settings = run.settings() | {"hdu": hdu, "plan": planned}
    try:
        with as_interrupt(), workers.executor() as executor, run_progress(len(paths)) as (watch, before):
            settings |= {"executor": executor, "watch": watch, "before": before}
            result = process_files(paths, output, processor, **settings)
    except KeyboardInterrupt:
        instead = " instead of --overwrite" * run.overwrite
        log(f"Results so far are kept in {output}: repeat the command with --resume{instead} to continue.")
        raise
    finalize(result, processor.instrument)


def watch(
    *,
    directory: Annotated[Path, typer.Argument()],
    output: options.OutputDirectory,
    idle: Annotated[float | None, typer.Option(min=0.0)] = None,
    poll: Annotated[float, typer.Option(min=0.05)] = 1.0,
    hdu: int | None = None,
    run: Run,
    fit: FrameFit,
) -> None:
    """Fit frames as they arrive, and keep what is found on the screen.

    A file is processed when it is complete and no longer changes; so are files that are there at the start.
    At the end, or at Ctrl-C, writes what 'process' writes, and lists files that are incomplete. Exit status:
    0 if every frame was fitted, 1 if some were not, 2 if the command cannot be carried out.

    Parameters
    ----------
    directory : DIR
        Where the camera writes FITS or TIFF files.
    idle : SECONDS
        End when no file has come for this time; by default at Ctrl-C.
    poll : SECONDS
        How often to look for new files.
    """
    from jitterkit.frames.files import require_directory

    require_directory(directory)
    run.check(output)
    processor = fit.processor()
    from jitterkit.run.watch import watch_directory

    settings = run.settings() | {"hdu": hdu, "idle": idle, "poll": poll}
    with live_screen(printable(directory)) as (update, recall), until_interrupted() as interrupted:
        result = watch_directory(
            directory, output, processor, stop=interrupted, watch=update, before=recall, **settings
        )
    finalize(result, processor.instrument)
