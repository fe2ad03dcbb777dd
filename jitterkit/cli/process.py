"""``jitterkit process``: from frames to separations."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from jitterkit.cli import options
from jitterkit.cli.planned import check_asked, with_plan
from jitterkit.cli.processor import takes_processor
from jitterkit.cli.progress import following
from jitterkit.cli.runtime import SOME_FAILED, command_line, say

__all__ = ["Output", "Resume", "conclude", "process"]

_TOLD = {"prior_contradicted", "prior_unused"}
"""Remarks on a fitted frame that are worth a line on stderr."""

_LISTED = 50
"""Lines of them, at most."""

Output = Annotated[Path, typer.Option("--output", "-o", metavar="DIR", help="Directory for the results.")]
Resume = Annotated[
    bool, typer.Option("--resume", help="Go on with a run that was interrupted; nothing is done twice.")
]


@takes_processor
def process(
    make: Callable,
    files: options.Files,
    output: Output,
    hdu: options.Hdu = None,
    workers: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Processes to share the work on this machine, each with one thread; by default one with as "
            "many threads as there are processors.",
            show_default=False,
        ),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="Scheduler of dask.distributed whose workers share the work: tcp://host:8786. Files must be "
            "readable there under the same paths.",
            show_default=False,
        ),
    ] = None,
    tolerance: Annotated[
        str | None,
        typer.Option(
            metavar="1uas|10%",
            help="Take the cheapest settings whose model puts no more wrong with the separation of a frame: "
            "an angle, or a share of its error. Three frames of the run are looked at to choose them.",
            show_default=False,
        ),
    ] = None,
    budget: Annotated[
        str | None,
        typer.Option(
            metavar="20ms",
            help="Take the most exact settings with which a frame, fitted by itself, takes no longer on this "
            "machine, likewise.",
            show_default=False,
        ),
    ] = None,
    explain: Annotated[
        bool,
        typer.Option("--explain", help="Say what the settings leave out of the model, and what that costs."),
    ] = False,
    overwrite: options.Overwrite = False,
    resume: Resume = False,
) -> None:
    """Fit every frame: kernel estimate, then separation, optics and jitter together.

    Writes results.ecsv (a row a frame), summary.json, report.html, configuration.json and, as it goes on,
    ledger.sqlite. Exit status: 0 if every frame was fitted, 1 if some were not, 2 if the command cannot be
    carried out.
    """
    from jitterkit.errors import ConfigurationError, ErrorCode
    from jitterkit.frames import find_files
    from jitterkit.report.outputs import RUN, check_directory

    if workers is not None and scheduler is not None:
        raise ConfigurationError(
            ErrorCode.CONFLICT, "A scheduler has its own workers; give --workers or --scheduler."
        )
    check_asked(tolerance, budget)
    paths = find_files(files)
    check_directory(output, RUN, overwrite or resume)
    processor, plan = make(), None
    if tolerance is not None or budget is not None or explain:
        asked = {"tolerance": tolerance, "budget": budget}
        processor, plan = with_plan(processor, paths, hdu, asked, output if resume else None, explain)
    from jitterkit.batch import process_files

    try:
        with _engine(workers, scheduler) as engine, following(len(paths)) as (watch, before):
            run = process_files(
                paths,
                output,
                processor,
                hdu=hdu,
                overwrite=overwrite,
                resume=resume,
                engine=engine,
                watch=watch,
                before=before,
                command=command_line(),
                plan=plan,
            )
    except KeyboardInterrupt:
        instead = " instead of --overwrite" * overwrite
        say(f"What has been done is kept in {output}: the same command with --resume{instead} goes on.")
        raise
    conclude(run, processor.instrument)


@contextlib.contextmanager
def _engine(workers: int | None, scheduler: str | None) -> Iterator[Callable | None]:
    """What processes batches: workers if some are asked for."""
    if workers is None and scheduler is None:
        yield None
        return
    from jitterkit.batch.cluster import connected, process_on_cluster

    with connected(workers, scheduler) as client:
        yield partial(process_on_cluster, client=client)


def conclude(run, telescope) -> None:
    """Tell the result; end with status 1 if some frames were not fitted."""
    _tell(run)
    _tell_of_rows(run, telescope)
    if run.failures:
        raise typer.Exit(SOME_FAILED)


def _tell_of_rows(run, telescope) -> None:
    """What a rolling shutter may have done, which a frame alone does not tell."""
    from jitterkit.report.words import angle_size

    line_time, separation = telescope.detector.line_time, run.summary["separation"]["mean"]
    if line_time and separation == separation:  # not NaN
        leverage = abs(line_time) * separation / telescope.plate_scale
        say(
            "The rows of this detector are exposed one after the other, which one frame does not show: a "
            f"drift along the pair and the columns moves its separation by {angle_size(leverage, 2)} per "
            "arcsec/s. 'jitterkit sequence' takes it out."
        )


def _tell(run) -> None:
    """The result on stdout, the rest on stderr."""
    from jitterkit.report.flags import decode_flags
    from jitterkit.report.run_fit import say_fit
    from jitterkit.report.sequence import say_loci
    from jitterkit.report.words import ellipse_size, with_error

    remarkable = (row["status"] != "ok" or _TOLD & set(decode_flags(row["flags"])) for row in run.table)
    places = [place for place, told in enumerate(remarkable) if told]
    for row in run.table[places[:_LISTED]]:
        say(f"{row['file']} [{row['frame']}] {row['status']}: {row['message']}")
    if len(places) > _LISTED:
        say(f"... and {len(places) - _LISTED} more, which the table and the report have")
    fitted = int(sum(run.table["status"] == "ok"))
    separation, jitter = run.summary["separation"], run.summary["jitter"]
    pairs = separation["n"]
    if pairs:
        typer.echo(
            f"separation {with_error(separation['mean'], separation['error'])} arcsec from {pairs} frames"
        )
    elif fitted:
        size = ellipse_size(jitter["major"], jitter["minor"])
        typer.echo(f"jitter, 1 sigma, {size} from {fitted} frames")
    if together := say_loci(run.summary["loci"]):
        say(together)
    if misfit := say_fit(run.summary["fit"]):
        say(misfit)
    say(f"{fitted} of {len(run.table)} frames fitted; results in {run.directory}")
