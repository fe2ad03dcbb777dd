"""``jitterkit sequence``: frames of one pair, fitted together."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from jitterkit.cli import options
from jitterkit.cli.loci import locus_sizes
from jitterkit.cli.progress import watching
from jitterkit.cli.runtime import SOME_FAILED, command_line, prepare_jax, say

__all__ = ["sequence"]

_SERIES = 25
"""Frames of which averages can be studied."""

OUTPUTS = TABLE, SUMMARY, AVERAGING, RUN = (
    "sequence.ecsv",
    "sequence.json",
    "averaging.png",
    "run.png",
)


def sequence(
    files: options.Files,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="DIR", help="Directory for the results.")],
    instrument: options.InstrumentName = "toliman",
    locus: Annotated[
        str, typer.Option(metavar="NAME", help=f"Jitter of every frame: {', '.join(locus_sizes())}.")
    ] = "mvn",
    law: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=LAW",
            help="How something shared changes: constant, polynomial:DEGREE, wander:RMS:SECONDS, or wander, "
            "which is then measured. NAME is separation, theta, contrast, diffusion, an aberration, or "
            "aberrations for all of them. Aberrations wander, all else is constant, unless told.",
            show_default=False,
        ),
    ] = None,
    diffusion: Annotated[
        bool,
        typer.Option("--diffusion", help="Measure the detector's charge diffusion from all frames together."),
    ] = False,
    telemetry: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.csv",
            help="Measured pointing, columns t,x,y in s from the beginning of the first exposure and arcsec, "
            "in place of the motion from frame to frame.",
            show_default=False,
        ),
    ] = None,
    global_shutter: Annotated[
        bool, typer.Option("--global-shutter", help="Take all rows as exposed at once.")
    ] = False,
    cadence: Annotated[
        float | None,
        typer.Option(
            min=1e-9, help="From frame to frame, s, in place of the headers' times.", show_default=False
        ),
    ] = None,
    scene: Annotated[
        str,
        typer.Option(
            metavar="auto|binary", help="Refuse frames that show no pair beyond doubt, or fit a pair to all."
        ),
    ] = "auto",
    censored: options.Censored = False,
    background: options.Background = True,
    gain: options.Gain = None,
    read_noise: options.ReadNoise = None,
    bias: options.Bias = None,
    saturation: options.Saturation = None,
    plate_scale: options.PlateScale = None,
    exposure: options.Exposure = None,
    bad_bits: options.BadBits = None,
    hdu: options.Hdu = None,
    overwrite: options.Overwrite = False,
) -> None:
    """Fit frames of one pair together: separation, optics and detector shared, place and jitter their own.

    The frames share one direction of the pair: of a field that turns, give --law theta=polynomial:1. Writes
    sequence.ecsv (a row a frame), sequence.json, run.png (what changed meanwhile) and, of 25 frames or more,
    averaging.png (scatter and Allan deviation). Exit status: 0 if every frame counts, 1 if some do not, 2 if
    the command cannot be carried out.
    """
    from jitterkit.errors import ConfigurationError, ErrorCode
    from jitterkit.frames import find_files
    from jitterkit.report.outputs import check_directory

    if global_shutter and telemetry is not None:
        raise ConfigurationError(
            ErrorCode.CONFLICT, "Telemetry is for rolling shutters; give --telemetry or --global-shutter."
        )
    find_files(files)
    check_directory(output, OUTPUTS, overwrite)
    prepare_jax()
    from jitterkit.batch import FileExposures, Finder
    from jitterkit.instruments import load_instrument
    from jitterkit.joint import Looker, SequenceOptions, refit_sequence
    from jitterkit.loci.trace_locus import read_trace
    from jitterkit.refit import Status

    held = () if background else ("background",)
    overrides = options.overrides(gain, read_noise, bias, saturation, plate_scale, exposure, bad_bits)
    exposures = FileExposures(files, Finder(load_instrument(instrument), overrides), hdu=hdu, cadence=cadence)
    how = SequenceOptions(
        laws=_laws(law or []),
        rolling=not global_shutter,
        telemetry=None if telemetry is None else read_trace(telemetry),
    )
    looker = Looker(exposures.optics, locus, held, diffusion=diffusion, censored=censored, scene=scene)
    with watching(len(exposures.files), "files") as advance:
        fit = refit_sequence(exposures, looker, how, lambda number, name: advance(f"pass {number}: {name}"))
    if not exposures.timed:
        say(
            "No header says when its frame was taken: they are taken in the natural order of their names, to "
            "follow each other without a pause."
        )
    _write(fit, output, overwrite)
    duplicates = sum(record.status is Status.DUPLICATE for record in fit.records)
    if not fit.combined.kept.all() or len(fit.messages) + duplicates < len(fit.records):
        raise typer.Exit(SOME_FAILED)


def _laws(texts: list[str]) -> dict[str, Any]:
    from jitterkit.errors import ConfigurationError, ErrorCode
    from jitterkit.joint import parse_law

    laws = {}
    for text in texts:
        name, equals, words = text.partition("=")
        if not equals:
            raise ConfigurationError(
                ErrorCode.MALFORMED, f"--law {text!r} is not NAME=LAW; say, aberrations=constant."
            )
        laws[name.strip()] = parse_law(words.strip())
    return laws


def _write(fit, output: Path, overwrite: bool) -> None:
    """Table, summary and pictures; the separation on stdout, the rest on stderr."""
    from jitterkit.cli.products import write_picture
    from jitterkit.report.joint_plots import plot_run
    from jitterkit.report.joint_table import (
        averaging_floor,
        frame_table,
        joint_summary,
        say_joint,
        separation_series,
    )
    from jitterkit.report.outputs import make_directory
    from jitterkit.report.series_plots import plot_averaging
    from jitterkit.report.summary import write_summary
    from jitterkit.report.table import write_table
    from jitterkit.report.words import with_error

    make_directory(output, OUTPUTS, overwrite)
    series = separation_series(fit)
    floor = averaging_floor(series)
    summary = joint_summary(fit, floor)
    write_table(output / TABLE, frame_table(fit, {"command": command_line()}), overwrite=overwrite)
    write_summary(output / SUMMARY, summary, overwrite=overwrite)
    write_picture(output / RUN, plot_run(fit)[0], overwrite)
    if series is not None and len(series.values) >= _SERIES:
        write_picture(output / AVERAGING, plot_averaging(series, floor=floor)[0], overwrite)
    else:
        say(f"{AVERAGING} is drawn of {_SERIES} frames or more that count.")
    for frame in fit.frames():
        if frame.shared is None:
            say(f"{frame.record.name} {frame.record.status.name.lower()}: {frame.record.message}")
    typer.echo(f"separation {with_error(*fit.separation)} arcsec from {summary['counted']} frames")
    for sentence in say_joint(summary):
        say(sentence)
    say(f"{summary['counted']} of {summary['frames']} frames counted; results in {output}")
