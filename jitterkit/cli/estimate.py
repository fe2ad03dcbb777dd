"""Estimate blur kernels without a refit: ``jitterkit estimate``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from jitterkit.cli import options
from jitterkit.cli.progress import progress_bar
from jitterkit.cli.runtime import LISTED, SOME_FAILED, log, prepare_jax, print_table
from jitterkit.errors import ErrorCode, refuse_if

_ROUNDEST = "roundest"

_ON_PIXELS = ("richardson-lucy", "nnls")
"""Estimators whose kernel is known on the detector's pixels only."""

_INSTRUMENT = "toliman"


@dataclass(frozen=True, kw_only=True)
class Exports:
    """Choose what is written for each frame.

    Parameters
    ----------
    plot : DIR
        Draw kernel, transfer function and residual of each frame.
    export : DIR
        Write each kernel as FITS for photutils, stpsf, GalSim and dLux.
    oversample : N
        Pixels of an exported kernel per detector pixel, along each axis.
    file_rows
        Write exports of a frame whose file begins with its top row (a TIFF) in that order too.
    deblur : DIR
        Write each frame without its blur, for inspection.
    """

    plot: Path | None = None
    export: Path | None = None
    oversample: Annotated[int, typer.Option(min=1)] = 1
    file_rows: bool = False
    deblur: Path | None = None

    def check(self, estimator: str | None) -> None:
        """Refuse options of exports where nothing is exported, and finer pixels than an estimator gives."""
        useless, finer = self.file_rows and self.export is None and self.deblur is None, self.oversample != 1
        problem = "--file-rows is for exports; give --export DIR or --deblur DIR, or leave it out."
        refuse_if(useless, ErrorCode.MISSING_VALUE, problem)
        problem = "--oversample is for exported kernels; give --export DIR, or leave it out."
        refuse_if(finer and self.export is None, ErrorCode.MISSING_VALUE, problem)
        problem = f"The kernel of {estimator} is known on the detector's pixels only"
        remedy = "leave out --oversample, or choose --estimator score"
        refuse_if(finer and estimator in _ON_PIXELS, ErrorCode.CONFLICT, f"{problem}; {remedy}.")

    def products(self, overwrite: bool):
        """Return the writer of the products of each frame."""
        from jitterkit.run.products import Products

        return Products(self.plot, self.export, self.deblur, overwrite, self.oversample, self.file_rows)

    def check_directories(self, overwrite: bool) -> None:
        """Refuse directories that cannot be written."""
        from jitterkit.report.outputs import ENDS, check_directory

        for directory, end in zip((self.plot, self.export, self.deblur), ENDS, strict=True):
            if directory is not None:
                check_directory(directory, [f"*{end}"], overwrite)


def estimate(
    *,
    files: options.Files,
    instrument: Annotated[str | None, typer.Option("--instrument", "-i", show_default=_INSTRUMENT)] = None,
    reference: Path | None = None,
    stars: bool | None = None,
    blind: bool = False,
    estimator: str | None = None,
    output: options.TableOutput = None,
    exports: Exports,
    scene: str = "auto",
    background: bool = True,
    model_error: str = "0",
    detector: options.Detector,
    hdu: int | None = None,
    overwrite: bool = False,
) -> None:
    """Estimate the blur of every frame, without a refit, and print a table.

    The frames show one star or a pair, of an instrument's optics; with --reference, --stars or --blind they
    may show anything else. sxx, sxy and syy are the pointing's second moments; major and minor are one sigma
    along each axis; angle is that of the major axis, in degrees counter-clockwise from +x; length is a
    streak's; shape is the excess kurtosis; significance is chi-squared with three degrees of freedom against
    no jitter. Sizes are in arcsec, or in pixels where a frame has no plate scale. A reference that is among
    the frames is marked in its row.

    Parameters
    ----------
    instrument : NAME|FILE.toml
        Telescope of frames of a star or a pair: a preset, or an instrument file.
    reference : FILE|roundest
        A sharp frame in place of an instrument: of the same telescope for stars, of the same view for
        anything else; or the roundest of the frames given, which then show stars.
    stars
        The frames show a field of stars, of unknown optics; by default the reference decides.
    blind
        The frames show a scene without stars, and there is no sharp one.
    estimator : NAME
        With an instrument: score (default), mtf, moments, richardson-lucy or nnls; with --blind: blind
        (default), cepstrum, radon, autocorrelation or trail.
    output : FILE.ecsv
        Also write the table; the name ends in .ecsv, .csv, .fits, .parquet or .json.
    """
    from jitterkit.frames import find_files
    from jitterkit.report.outputs import check_table

    paths = find_files(files)
    replaced = "--reference" if reference is not None else "--stars" if stars else ""
    _check_method(replaced, blind, estimator)
    roundest = str(reference) == _ROUNDEST
    problem = "--no-stars is for a --reference FILE that shows no stars; leave it out."
    refuse_if(stars is False and not blind and (reference is None or roundest), ErrorCode.CONFLICT, problem)
    exports.check(estimator)
    if replaced or blind:
        _check_no_optics(instrument, scene, background, model_error)
    if output is not None:
        check_table(output, overwrite)
    exports.check_directories(overwrite)
    sharp = None if reference is None or roundest else _first_frame(reference)
    prepare_jax()
    from jitterkit.report.table import write_table
    from jitterkit.run.estimate import estimate_files

    blur_estimator: Any
    metadata = detector.metadata()
    if replaced or blind:
        from jitterkit.batch.scene_blur import SceneBlurEstimator, sharpest

        if roundest:
            sharp, stars = sharpest(paths, hdu), True
            log(f"{sharp.name} is the roundest and serves as reference")
        blur_estimator = SceneBlurEstimator(sharp, stars, estimator or "blind", metadata)
        blur_estimator.check(paths, hdu)
    else:
        from jitterkit.batch import FrameProcessor
        from jitterkit.batch.template_blur import TemplateBlurEstimator
        from jitterkit.instruments import load_instrument
        from jitterkit.refit import FitOptions

        telescope = load_instrument(instrument or _INSTRUMENT)
        error = options.parse_model_error(model_error)
        fit = FitOptions(hold=options.held(background), model_error=error)
        processor = FrameProcessor(telescope, metadata, kernel=estimator or "score", scene=scene, options=fit)
        blur_estimator = TemplateBlurEstimator(processor)
    write = exports.products(overwrite).write
    with progress_bar(len(paths), "files") as advance:
        table = estimate_files(paths, blur_estimator, hdu=hdu, watch=advance, keep=write)
    if output is not None:
        write_table(output, table, overwrite=overwrite)
    print_table(table[[name for name in table.colnames if _is_printed(name, table[name])]])
    _log_messages(table)
    if set(table["status"]) - {"ok", "reference", "duplicate"}:
        raise typer.Exit(SOME_FAILED)


def _log_messages(table) -> None:
    """Log each message once for all frames that have it: first those of frames without an estimate."""
    alike: dict[tuple[str, str], list] = {}
    for row in sorted(table[table["message"] != ""], key=lambda row: row["status"] == "ok"):
        alike.setdefault((row["status"], row["message"]), []).append(row)
    for (status, message), rows in list(alike.items())[:LISTED]:
        frame = f"{rows[0]['file']} [{rows[0]['frame']}]{f' {status}' * (status != 'ok')}"
        log(f"{frame}: {message}{f' ({len(rows)} frames)' * (len(rows) > 1)}")
    if len(alike) > LISTED:
        log(f"... and {len(alike) - LISTED} more, which the table of -o has")


def _check_method(replaced: str, blind: bool, estimator: str | None) -> None:
    """Refuse two ways to estimate at once; ``replaced`` is the option that replaces known optics."""
    problem = "--blind is for scenes without stars and without a sharp frame"
    refuse_if(blind and replaced != "", ErrorCode.CONFLICT, f"{problem}; leave out {replaced}, or --blind.")
    problem = f"--estimator {estimator} chooses among methods with known optics or, with --blind, a blind one"
    chosen = estimator is not None and replaced != ""
    refuse_if(chosen, ErrorCode.CONFLICT, f"{problem}; leave it out with {replaced}.")


def _check_no_optics(instrument: str | None, scene: str, background: bool, model_error: str) -> None:
    """Refuse options of known optics where there are none."""
    given = ["--instrument"] * (instrument is not None) + ["--scene"] * (scene != "auto")
    given += ["--no-background"] * (not background) + ["--model-error"] * (model_error != "0")
    problem = f"{' '.join(given[:1])} is for known optics"
    remedy = "leave it out with --reference, --stars or --blind"
    refuse_if(given != [], ErrorCode.CONFLICT, f"{problem}; {remedy}.")


def _first_frame(path: Path):
    from jitterkit.frames import open_frames

    with open_frames(path) as file:
        return file[0]


def _is_printed(name: str, column) -> bool:
    """Return whether a column is printed: messages follow the table, and the rest is for the file."""
    import numpy as np

    empty = column.dtype.kind == "f" and not np.any(np.isfinite(np.asarray(column.value)))
    return not (empty or name in ("message", "digest") or name.endswith("_corr"))
