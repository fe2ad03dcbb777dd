"""``jitterkit estimate``: the blur kernels alone."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from jitterkit.cli import options
from jitterkit.cli.progress import watching
from jitterkit.cli.runtime import SOME_FAILED, prepare_jax, say, show_table

__all__ = ["estimate"]

_ROUNDEST = "roundest"

_ON_PIXELS = ("richardson-lucy", "nnls")
"""Estimators whose kernel is known on the detector's pixels only."""

_INSTRUMENT = "toliman"


def _directory(help: str):
    return typer.Option(metavar="DIR", help=help, show_default=False)


def estimate(
    files: options.Files,
    instrument: Annotated[
        str | None,
        typer.Option(
            "--instrument",
            "-i",
            metavar="NAME|FILE.toml",
            help="The telescope of frames of a star or a pair: a preset, or an instrument file.",
            show_default=_INSTRUMENT,
        ),
    ] = None,
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
            help="The frames show a field of stars, of unknown optics; by default the reference decides.",
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
    output: options.TableOutput = None,
    plot: Annotated[
        Path | None, _directory("Draw kernel, transfer function and residual of each frame.")
    ] = None,
    export: Annotated[
        Path | None, _directory("Write each kernel as FITS for photutils, stpsf, GalSim and dLux.")
    ] = None,
    oversample: Annotated[
        int,
        typer.Option(
            min=1, metavar="N", help="Pixels of an exported kernel per detector pixel, along each axis."
        ),
    ] = 1,
    file_rows: Annotated[
        bool,
        typer.Option(
            "--file-rows",
            help="Write exports of a frame whose file begins with its top row (a TIFF) in that order too.",
        ),
    ] = False,
    deblur: Annotated[Path | None, _directory("Write each frame without its blur, to look at.")] = None,
    scene: options.SceneName = "auto",
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
    """Estimate the blur of every frame, without a refit, and print a table.

    Of one star or a pair, with an instrument's optics; with --reference, --stars or --blind of anything
    else. sxx, sxy and syy are the pointing's second moments; major and minor are one sigma along each axis;
    angle is the major axis's, in degrees counter-clockwise from +x; length is a streak's; shape is the
    excess kurtosis; significance is chi-squared with three degrees of freedom against no jitter. Sizes are
    in arcsec, or in pixels where a frame has no plate scale. A reference that is among the frames says so
    in its row.
    """
    from jitterkit.frames import find_files

    paths = find_files(files)
    _check_options(reference, stars, blind, estimator, export, oversample, file_rows, deblur)
    if reference is not None or stars or blind:
        _check_no_optics(instrument, scene, background)
    _check_outputs(output, (plot, export, deblur), overwrite)
    sharp = None if reference is None or str(reference) == _ROUNDEST else _first_frame(reference)
    prepare_jax()
    from jitterkit.batch.kernels import estimate_files
    from jitterkit.batch.products import Products
    from jitterkit.report.table import write_table

    metadata = options.overrides(gain, read_noise, bias, saturation, plate_scale, exposure, bad_bits)
    if reference is not None or stars or blind:
        from jitterkit.batch.reference import sharpest
        from jitterkit.batch.scenes import SceneMeasurer

        if str(reference) == _ROUNDEST:
            sharp, stars = sharpest(paths, hdu), True
            say(f"{sharp.name} is the roundest and serves as reference")
        measurer = SceneMeasurer(sharp, stars, estimator or "blind", metadata)
        measurer.check(paths, hdu)
    else:
        measurer = _by_optics(instrument or _INSTRUMENT, estimator or "score", scene, metadata, background)
    products = Products(plot, export, deblur, overwrite, oversample, file_rows)
    with watching(len(paths), "files") as advance:
        table = estimate_files(paths, measurer, hdu=hdu, watch=advance, keep=products.write)
    if output is not None:
        write_table(output, table, overwrite=overwrite)
    shown = table.copy()
    shown.remove_columns([name for name in table.colnames if _is_left_out(name, table[name])])
    show_table(shown)
    for row in table[table["message"] != ""]:
        status = "" if row["status"] == "ok" else f" {row['status']}"
        say(f"{row['file']} [{row['frame']}]{status}: {row['message']}")
    if set(table["status"]) - {"ok", "reference", "duplicate"}:
        raise typer.Exit(SOME_FAILED)


def _by_optics(instrument, estimator, scene, metadata, background):
    from jitterkit.batch import Finder
    from jitterkit.batch.by_optics import OpticsMeasurer
    from jitterkit.instruments import load_instrument
    from jitterkit.refit import FitOptions

    options = FitOptions(hold=() if background else ("background",))
    telescope = load_instrument(instrument)
    return OpticsMeasurer(Finder(telescope, metadata, kernel=estimator, scene=scene, options=options))


def _check_options(reference, stars, blind, estimator, export, oversample, file_rows, deblur) -> None:
    """Refuse options that do not go together."""
    from jitterkit.errors import ConfigurationError, ErrorCode

    if blind and (reference is not None or stars):
        raise ConfigurationError(
            ErrorCode.CONFLICT,
            "--blind is for scenes without stars and without a sharp frame; leave out "
            f"{'--reference' if reference is not None else '--stars'}, or --blind.",
        )
    if estimator is not None and not blind and (reference is not None or stars):
        raise ConfigurationError(
            ErrorCode.CONFLICT,
            f"--estimator {estimator} chooses among methods with known optics or, with --blind, a blind one; "
            f"leave it out with {'--reference' if reference is not None else '--stars'}.",
        )
    if file_rows and export is None and deblur is None:
        raise ConfigurationError(
            ErrorCode.MISSING_VALUE,
            "--file-rows is for exports; give --export DIR or --deblur DIR, or leave it out.",
        )
    if oversample != 1 and export is None:
        raise ConfigurationError(
            ErrorCode.MISSING_VALUE,
            "--oversample is for exported kernels; give --export DIR, or leave it out.",
        )
    if oversample != 1 and estimator in _ON_PIXELS:
        raise ConfigurationError(
            ErrorCode.CONFLICT,
            f"The kernel of {estimator} is known on the detector's pixels only; leave out --oversample, or "
            "choose --estimator score.",
        )


def _check_no_optics(instrument: str | None, scene: str, background: bool) -> None:
    """Refuse what is said of known optics where there are none."""
    from jitterkit.errors import ConfigurationError, ErrorCode

    told = {
        "--instrument": instrument is not None,
        "--scene": scene != "auto",
        "--no-background": not background,
    }
    given = [name for name, is_told in told.items() if is_told]
    if given:
        raise ConfigurationError(
            ErrorCode.CONFLICT,
            f"{given[0]} is for known optics; leave it out with --reference, --stars or --blind.",
        )


def _check_outputs(table: Path | None, directories: tuple[Path | None, ...], overwrite: bool) -> None:
    from jitterkit.report.outputs import ENDS, check_directory, check_table

    if table is not None:
        check_table(table, overwrite)
    for directory, end in zip(directories, ENDS, strict=True):
        if directory is not None:
            check_directory(directory, [f"*{end}"], overwrite)


def _first_frame(path: Path):
    from jitterkit.frames import open_frames

    with open_frames(path) as file:
        return file[0]


def _is_left_out(name: str, column) -> bool:
    """Whether a column does not go to the terminal: messages follow, the rest is for the file."""
    import numpy as np

    empty = column.dtype.kind == "f" and not np.any(np.isfinite(np.asarray(column.value)))
    return bool(empty or name in ("message", "digest") or name.endswith("_corr"))
