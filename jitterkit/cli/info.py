"""``jitterkit info``: what is in the files, and who says so."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from jitterkit.cli.options import Hdu
from jitterkit.cli.runtime import SOME_FAILED, say_error

__all__ = ["info"]

Things = Annotated[
    list[str],
    typer.Argument(
        metavar="FILES_OR_DIRS_OR_NAMES",
        help="FITS or TIFF files, or directories of them; or instruments: files (.toml) or names of presets.",
        show_default=False,
    ),
]


def info(things: Things, hdu: Hdu = None) -> None:
    """Print what is known about frames or instruments, and where each number comes from."""
    from jitterkit.errors import FrameError
    from jitterkit.frames import find_files

    failed = False
    for thing in things:
        if _is_instrument(thing):
            _tell(thing, _instrument(thing))
            continue
        for path in find_files([thing]):
            try:
                _tell(path, *_frames(path, hdu))
            except FrameError as error:
                failed = True
                say_error(error)
    if failed:
        raise typer.Exit(SOME_FAILED)


def _is_instrument(thing: str) -> bool:
    from jitterkit.detectors import DETECTORS
    from jitterkit.instruments import PRESETS

    if thing.lower().endswith(".toml"):
        return True
    return thing in {*PRESETS, *DETECTORS} and not Path(thing).exists()


def _instrument(thing: str) -> list[tuple[str, str, str, str]]:
    from jitterkit.detectors import DETECTORS, detector_preset
    from jitterkit.instruments import load_instrument
    from jitterkit.instruments.description import describe_detector, describe_instrument

    if thing in DETECTORS:
        return describe_detector(detector_preset(thing))
    return describe_instrument(load_instrument(thing))


def _frames(path: Path, hdu: int | None) -> tuple[list[tuple[str, str, str, str]], tuple[str, ...]]:
    from jitterkit.detectors.pixel_units import NORMALISED, is_normalised
    from jitterkit.errors import FrameError
    from jitterkit.frames import open_frames

    with open_frames(path, hdu=hdu) as file:
        try:
            first = file[0]
        except FrameError as error:  # what the header says is known all the same
            return file.describe(), (*file.metadata.warnings, str(error))
        return file.describe(), (*first.metadata.warnings, *[NORMALISED] * is_normalised(first))


def _tell(title, rows: list[tuple[str, str, str, str]], warnings: tuple[str, ...] = ()) -> None:
    lines = [("", "value", "unit", "source"), *rows]
    typer.echo(title)
    widths = [max(len(line[i]) for line in lines) for i in range(3)]
    for *cells, source in lines:
        columns = (cell.ljust(width) for cell, width in zip(cells, widths, strict=True))
        typer.echo("  " + "  ".join(columns) + "  " + source)
    for warning in warnings:
        typer.echo(f"  warning: {warning}")
