"""``jitterkit estimate``: the blur kernels alone."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from jitterkit.cli import options
from jitterkit.cli.runtime import SOME_FAILED, prepare_jax, say, watching

__all__ = ["estimate"]


def estimate(
    files: options.Files,
    instrument: options.InstrumentName = "toliman",
    estimator: Annotated[str, typer.Option(metavar="NAME", help="Kernel estimator: score or mtf.")] = "score",
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", metavar="FILE.ecsv", help="Write the table there too.", show_default=False
        ),
    ] = None,
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

    sxx, sxy and syy are the pointing's second moments in arcsec²; major and minor are one sigma along each
    axis, in arcsec; angle is the major axis's, in degrees counter-clockwise from +x; significance is
    chi-squared with three degrees of freedom against no jitter.
    """
    prepare_jax()
    from jitterkit.batch import Processor
    from jitterkit.batch.kernels import estimate_files
    from jitterkit.frames import find_files
    from jitterkit.instruments import load_instrument
    from jitterkit.refit import FitOptions
    from jitterkit.report.table import write_table

    metadata = options.overrides(gain, read_noise, bias, saturation, plate_scale, exposure)
    processor = Processor(
        load_instrument(instrument),
        metadata,
        kernel=estimator,
        options=FitOptions(hold=() if background else ("background",)),
    )
    with watching(len(find_files(files)), "files") as advance:
        table = estimate_files(files, processor, hdu=hdu, watch=advance)
    if output is not None:
        write_table(output, table, overwrite=overwrite)
    shown = table.copy()
    shown.remove_column("message")
    typer.echo("\n".join(shown.pformat(max_lines=-1, max_width=-1)))
    failed = table[table["status"] != "ok"]
    for row in failed:
        say(f"{row['file']} [{row['frame']}] {row['status']}: {row['message']}")
    if len(failed):
        raise typer.Exit(SOME_FAILED)
