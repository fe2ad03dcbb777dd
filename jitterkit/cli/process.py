"""``jitterkit process``: from frames to separations."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from jitterkit.cli import options
from jitterkit.cli.loci import locus_sizes
from jitterkit.cli.progress import following
from jitterkit.cli.runtime import SOME_FAILED, command_line, prepare_jax, say

__all__ = ["process"]

_LOCUS = f"Jitter locus: auto (the simplest that the frame supports), {', '.join(locus_sizes())}."

_TOLD = {"prior_contradicted", "prior_unused"}
"""Remarks on a fitted frame that are worth a line on stderr."""


def process(
    files: options.Files,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="DIR", help="Directory for the results.")],
    instrument: options.InstrumentName = "toliman",
    locus: Annotated[str, typer.Option(metavar="auto|NAME", help=_LOCUS)] = "auto",
    estimator: Annotated[
        str, typer.Option(metavar="NAME", help="Kernel estimator that starts the fit: score or mtf.")
    ] = "score",
    prior: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="What other data say about the jitter: a table of 'estimate -o' (.ecsv; a frame's own row, "
            "known by its pixels, is left out), or a trace t,x,y (.csv, s and arcsec, good to 10 % of its "
            "rms), the same for every frame: of one longer than an exposure its first, of two exposures or "
            "more their mean and scatter.",
            show_default=False,
        ),
    ] = None,
    censored: options.Censored = False,
    rays: Annotated[
        bool,
        typer.Option(
            "--rays",
            help="Look for cosmic rays in what the fit leaves over, and fit again without their pixels.",
        ),
    ] = False,
    background: options.Background = False,
    gain: options.Gain = None,
    read_noise: options.ReadNoise = None,
    bias: options.Bias = None,
    saturation: options.Saturation = None,
    plate_scale: options.PlateScale = None,
    exposure: options.Exposure = None,
    hdu: options.Hdu = None,
    overwrite: options.Overwrite = False,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with a run that was interrupted; nothing is done twice.")
    ] = False,
) -> None:
    """Fit every frame: kernel estimate, then separation, optics and jitter together.

    Writes results.ecsv (a row a frame), summary.json, report.html, configuration.json and, as it goes on,
    ledger.sqlite. Exit status: 0 if every frame was fitted, 1 if some were not, 2 if the command cannot be
    carried out.
    """
    from jitterkit.frames import find_files
    from jitterkit.report.outputs import RUN, check_directory

    paths = find_files(files)
    check_directory(output, RUN, overwrite or resume)
    prepare_jax()
    from jitterkit.batch import Processor, process_files
    from jitterkit.instruments import load_instrument
    from jitterkit.refit import FitOptions, read_kernel_prior

    telescope = load_instrument(instrument)
    known = None if prior is None else read_kernel_prior(prior, exposure=exposure or telescope.exposure)
    if known is not None and known.remark:
        say(f"{prior}: {known.remark}")
    processor = Processor(
        telescope,
        options.overrides(gain, read_noise, bias, saturation, plate_scale, exposure),
        locus=locus,
        kernel=estimator,
        options=FitOptions(hold=() if background else ("background",)),
        prior=known,
        censored=censored,
        rays=rays,
    )
    with following(len(paths)) as watch:
        run = process_files(
            paths,
            output,
            processor,
            hdu=hdu,
            overwrite=overwrite,
            resume=resume,
            watch=watch,
            command=command_line(),
        )
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
    from jitterkit.report.sequence import say_loci
    from jitterkit.report.words import with_error

    for row in run.table:
        if row["status"] != "ok" or _TOLD & set(decode_flags(row["flags"])):
            say(f"{row['file']} [{row['frame']}] {row['status']}: {row['message']}")
    fitted = len(run.table) - run.failures
    separation = run.summary["separation"]
    if fitted:
        typer.echo(
            f"separation {with_error(separation['mean'], separation['error'])} arcsec from {fitted} frames"
        )
    if together := say_loci(run.summary["loci"]):
        say(together)
    say(f"{fitted} of {len(run.table)} frames fitted; results in {run.directory}")
