"""Fit frames of one pair together: ``jitterkit sequence``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from jitterkit.cli import options
from jitterkit.cli.loci import locus_sizes
from jitterkit.cli.progress import progress_bar
from jitterkit.cli.quantities import named
from jitterkit.cli.runtime import SOME_FAILED, command_line, log, open_instrument, write_picture
from jitterkit.errors import ErrorCode, refuse_if

_MIN_SERIES = 25
"""Number of frames from which averages are studied."""

TABLE, SUMMARY = "sequence.ecsv", "sequence.json"
AVERAGING, RUN, RESIDUAL = "averaging.png", "run.png", "residual.png"
OUTPUTS = TABLE, SUMMARY, AVERAGING, RUN, RESIDUAL

_LOCUS = typer.Option(metavar="NAME", help=f"Jitter of every frame: {', '.join(locus_sizes())}.")


def sequence(
    *,
    files: options.Files,
    output: options.OutputDirectory,
    instrument: options.InstrumentName = "toliman",
    locus: Annotated[str, _LOCUS] = "mvn",
    law: list[str] | None = None,
    diffusion: bool = False,
    telemetry: Path | None = None,
    global_shutter: bool = False,
    cadence: Annotated[float | None, typer.Option(min=1e-9)] = None,
    scene: str = "auto",
    censored: bool = False,
    background: bool = True,
    model_error: str = "0",
    detector: options.Detector,
    hdu: int | None = None,
    overwrite: bool = False,
) -> None:
    """Fit frames of one pair together: shared separation, optics and detector; own position and jitter.

    The frames share one direction of the pair; for a field that rotates, give --law theta=polynomial:1.
    Writes sequence.ecsv (a row per frame), sequence.json, run.png (changes during the run); from 8
    frames on residual.png (their stacked residual), from 25 on averaging.png (scatter and Allan deviation).
    Exit status: 0 if every frame counts, 1 if some do not, 2 if the command cannot be carried out.

    Parameters
    ----------
    law : NAME=LAW
        Time model of a shared parameter: constant, polynomial:DEGREE, wander:RMS:SECONDS, or wander, whose
        rms and time are then measured. NAME is separation, theta, contrast, diffusion, an aberration, or
        aberrations for all of them. By default aberrations wander, and all else is constant.
    diffusion
        Measure the detector's charge diffusion from all frames together.
    telemetry : FILE.csv
        Measured pointing, columns t,x,y in s from the beginning of the first exposure and arcsec, in place
        of the motion from frame to frame.
    global_shutter
        Treat all rows as exposed at once.
    cadence
        Time from frame to frame, s, in place of the headers' times.
    scene : auto|binary
        auto refuses frames that do not clearly show a pair; binary fits a pair to all.
    """
    from jitterkit.frames import find_files
    from jitterkit.report.outputs import check_directory

    problem = "Telemetry is for rolling shutters; give --telemetry or --global-shutter."
    refuse_if(global_shutter and telemetry is not None, ErrorCode.CONFLICT, problem)
    find_files(files)
    check_directory(output, OUTPUTS, overwrite)
    error = options.parse_model_error(model_error)
    telescope = open_instrument(instrument)
    from jitterkit.batch import FileExposures, FrameProcessor
    from jitterkit.joint import FrameFitter, SequenceOptions, refit_sequence
    from jitterkit.loci.trace_file import read_trace
    from jitterkit.refit import Status
    from jitterkit.report.residual_stack import LatestPass, most_stacked

    processor = FrameProcessor(telescope, detector.metadata())
    exposures = FileExposures(files, processor, hdu=hdu, cadence=cadence)
    models, trace = _time_models(law or []), None if telemetry is None else read_trace(telemetry, log=log)
    how = SequenceOptions(time_models=models, rolling=not global_shutter, telemetry=trace)
    fitter = FrameFitter(
        exposures.optics,
        locus,
        options.held(background),
        diffusion=diffusion,
        censored=censored,
        scene=scene,
        model_error=error,
        known_light=processor.known_light,
    )
    latest = LatestPass(processor.plate_scale)
    with progress_bar(len(exposures.files), "files") as advance:

        def watch(number: int, name: str) -> None:
            advance(f"pass {number}: {name}")

        fit = refit_sequence(exposures, fitter, how, watch, latest.add)
    if not exposures.timed:
        order = "the frames are used in the natural order of their names, without a pause between them"
        log(f"No header holds a time of day: {order}.")
    if exposures.unbroken:
        log("The frames of one file are taken to follow each other without a pause: else give the --cadence.")
    for sentence in filter(None, (exposures.jump, exposures.overlap)):
        log(sentence)
    if trace is not None and fit.rows is None:
        log("The telemetry is not used: no frame has a rolling shutter (line_time).")
    _write_outputs(fit, most_stacked(latest.stacks), output, overwrite)
    duplicates = sum(record.status is Status.DUPLICATE for record in fit.records)
    if not fit.combined.kept.all() or len(fit.summaries) + duplicates < len(fit.records):
        raise typer.Exit(SOME_FAILED)


def _time_models(texts: list[str]) -> dict[str, Any]:
    from jitterkit.joint import parse_time_model

    time_models = {}
    for name, words in named(texts, "--law"):
        problem = f"--law {name!r} is not NAME=LAW; write, for example, aberrations=constant."
        refuse_if(not words, ErrorCode.MALFORMED, problem)
        time_models[name] = parse_time_model(words)
    return time_models


def _write_outputs(fit, stack, output: Path, overwrite: bool) -> None:
    """Write table, summary and pictures; print the separation on stdout, and log the rest."""
    from jitterkit.report import joint_plots, joint_table, outputs, run_pictures, series_plots
    from jitterkit.report.joint_summary import describe_joint_fit, joint_summary
    from jitterkit.report.residual_stack import FEWEST
    from jitterkit.report.sequence import describe_run_fit
    from jitterkit.report.summary import write_summary
    from jitterkit.report.table import write_table
    from jitterkit.report.words import by_scale, with_error
    from jitterkit.series import fit_floor

    outputs.make_directory(output, OUTPUTS, overwrite)
    series = joint_table.separation_series(fit)
    floor = None if series is None else fit_floor(series)
    summary = joint_summary(fit, floor, stack)
    table = joint_table.frame_table(fit, {"command": command_line()})
    write_table(output / TABLE, table, overwrite=overwrite)
    write_summary(output / SUMMARY, summary, overwrite=overwrite)
    write_picture(output / RUN, joint_plots.plot_run(fit)[0], overwrite)
    if (picture := run_pictures.plot_stack(stack, summary["fit"])) is not None:
        write_picture(output / RESIDUAL, picture, overwrite)
    else:
        log(f"{RESIDUAL} is not drawn: it needs {FEWEST} frames.")
    if series is not None and len(series.values) >= _MIN_SERIES:
        page = series_plots.plot_averaging(series, floor=floor)
        write_picture(output / AVERAGING, page[0], overwrite)
    else:
        log(f"{AVERAGING} is not drawn: it needs {_MIN_SERIES} frames that count.")
    for frame in fit.frames():
        if frame.shared is None:
            log(f"{frame.record.name} {frame.record.status.name.lower()}: {frame.record.message}")
    scale = by_scale(summary["separation"]["scale_error"])
    typer.echo(f"separation {with_error(*fit.separation)} arcsec from {summary['counted']} frames{scale}")
    if (right := summary["separation"]["corrected"]) == right:  # not NaN
        typer.echo(f"separation_corrected {with_error(right, fit.separation[1])} arcsec")
    if misfit := describe_run_fit(summary["fit"]):
        typer.echo(misfit)
    for sentence in describe_joint_fit(summary):
        log(sentence)
    log(f"{summary['counted']} of {summary['frames']} frames counted; results in {output}")
