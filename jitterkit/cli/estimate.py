"""``jitterkit estimate``: the blur kernels alone."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from jitterkit.cli import options
from jitterkit.cli.runtime import SOME_FAILED, prepare_jax, say, watching

__all__ = ["estimate"]


def _directory(help: str):
    return typer.Option(metavar="DIR", help=help, show_default=False)


def estimate(
    files: options.Files,
    instrument: options.InstrumentName = "toliman",
    reference: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE|roundest",
            help="A sharp frame in place of an instrument: of the same telescope for stars, of the same view "
            "for anything else; or the roundest of the frames given, which then show stars.",
            show_default=False,
        ),
    ] = None,
    stars: Annotated[
        bool | None,
        typer.Option(
            "--stars/--no-stars",
            help="The frames show a field of stars, no binary; by default the reference decides.",
            show_default=False,
        ),
    ] = None,
    blind: Annotated[
        bool,
        typer.Option("--blind", help="The frames show a scene without stars, and there is no sharp one."),
    ] = False,
    estimator: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="With an instrument: score (default), mtf, moments, richardson-lucy or nnls; with --blind: "
            "blind (default), cepstrum, radon, autocorrelation or trail.",
            show_default=False,
        ),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", metavar="FILE.ecsv", help="Write the table there too.", show_default=False
        ),
    ] = None,
    plot: Annotated[
        Path | None, _directory("Draw kernel, transfer function and residual of each frame.")
    ] = None,
    export: Annotated[
        Path | None, _directory("Write each kernel as FITS for photutils, stpsf, GalSim and dLux.")
    ] = None,
    deblur: Annotated[Path | None, _directory("Write each frame without its blur, to look at.")] = None,
    background: options.Background = False,
    gain: options.Gain = None,
    read_noise: options.ReadNoise = None,
    bias: options.Bias = None,
    saturation: options.Saturation = None,
    plate_scale: options.PlateScale = None,
    exposure: options.Exposure = None,
    hdu: options.Hdu = None,
    overwrite: options.Overwrite = False,
) -> None:
    """Estimate the blur of every frame, without a refit, and print a table.

    Of a binary, with an instrument's optics; with --reference, --stars or --blind of anything else. sxx, sxy
    and syy are the pointing's second moments; major and minor are one sigma along each axis; angle is the
    major axis's, in degrees counter-clockwise from +x; length is a streak's; shape is the excess kurtosis;
    significance is chi-squared with three degrees of freedom against no jitter. Sizes are in arcsec, or in
    pixels where a frame has no plate scale.
    """
    prepare_jax()
    from jitterkit.batch.kernels import estimate_files
    from jitterkit.batch.products import Products
    from jitterkit.errors import ConfigurationError
    from jitterkit.frames import find_files
    from jitterkit.report.table import write_table

    if output is not None and not output.parent.is_dir():
        raise ConfigurationError(
            f"{output.parent} is not a directory; make it, or write {output.name} elsewhere."
        )
    metadata = options.overrides(gain, read_noise, bias, saturation, plate_scale, exposure)
    if reference is not None or stars or blind:
        measurer = _scene_measurer(files, reference, stars, blind, estimator, metadata)
    else:
        measurer = _binary_measurer(instrument, estimator or "score", metadata, background)
    products = Products(plot, export, deblur, overwrite)
    with watching(len(find_files(files)), "files") as advance:
        table = estimate_files(files, measurer, hdu=hdu, watch=advance, keep=products.write)
    if output is not None:
        write_table(output, table, overwrite=overwrite)
    shown = table.copy()
    shown.remove_columns([name for name in table.colnames if _is_empty(table[name])] + ["message"])
    typer.echo("\n".join(shown.pformat(max_lines=-1, max_width=-1)))
    for row in table[table["message"] != ""]:
        status = "" if row["status"] == "ok" else f" {row['status']}"
        say(f"{row['file']} [{row['frame']}]{status}: {row['message']}")
    if any(table["status"] != "ok"):
        raise typer.Exit(SOME_FAILED)


def _binary_measurer(instrument, estimator, metadata, background):
    from jitterkit.batch import Processor
    from jitterkit.batch.kernels import BinaryMeasurer
    from jitterkit.instruments import load_instrument
    from jitterkit.refit import FitOptions

    options = FitOptions(hold=() if background else ("background",))
    return BinaryMeasurer(Processor(load_instrument(instrument), metadata, kernel=estimator, options=options))


def _scene_measurer(files, reference, stars, blind, estimator, metadata):
    from jitterkit.batch.scenes import SceneMeasurer, sharpest
    from jitterkit.errors import ConfigurationError
    from jitterkit.frames import open_frames

    if blind and (reference is not None or stars):
        raise ConfigurationError(
            "--blind is for scenes without stars and without a sharp frame; leave out "
            f"{'--reference' if reference is not None else '--stars'}, or --blind."
        )
    if estimator is not None and not blind:
        raise ConfigurationError(
            "--estimator chooses among methods for a binary or, with --blind, a blind one."
        )
    sharp = None
    if str(reference) == "roundest":
        sharp, stars = sharpest(files), True
        say(f"{sharp.name} is the roundest and serves as reference")
    elif reference is not None:
        with open_frames(reference) as file:
            sharp = file[0]
    return SceneMeasurer(sharp, stars, estimator or "blind", metadata)


def _is_empty(column) -> bool:
    """Whether a column of numbers holds none."""
    import numpy as np

    return column.dtype.kind == "f" and not np.any(np.isfinite(np.asarray(column.value)))
