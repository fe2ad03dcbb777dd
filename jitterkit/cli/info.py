"""Print the metadata of frames and instruments with their sources, ``jitterkit info``, and the handbook.

``jitterkit docs`` shows the latter in the terminal.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from jitterkit.cli.runtime import SOME_FAILED, aligned, log_error, prepare_jax
from jitterkit.errors import FrameError

Rows = list[tuple[str, str, str, str]]
"""Name, value, unit and source of quantities."""


def info(*, things: Annotated[list[str], typer.Argument()], hdu: int | None = None) -> None:
    """Print what is known about frames or instruments, and where each number comes from.

    Parameters
    ----------
    things : FILES_OR_DIRS_OR_NAMES
        FITS or TIFF files, or directories of them; or instruments: files (.toml) or names of presets.
    """
    from jitterkit.frames import find_files

    failed = False
    for thing in things:
        if _is_instrument(thing):
            _echo(thing, _instrument(thing))
            continue
        for path in find_files([thing]):
            try:
                _echo(path, *_frames(path, hdu))
            except FrameError as error:
                failed = True
                log_error(error)
    if failed:
        raise typer.Exit(SOME_FAILED)


def _is_instrument(thing: str) -> bool:
    from jitterkit.detectors import DETECTORS
    from jitterkit.instruments import PRESETS

    if thing.lower().endswith(".toml"):
        return True
    return thing in {*PRESETS, *DETECTORS} and not Path(thing).exists()


def _instrument(thing: str) -> Rows:
    from jitterkit.detectors import DETECTORS, detector_preset
    from jitterkit.instruments import PRESETS, load_instrument
    from jitterkit.instruments.description import describe_detector, describe_instrument

    if thing in DETECTORS:
        return describe_detector(detector_preset(thing))
    instrument = load_instrument(thing)
    if thing not in PRESETS:
        prepare_jax()
        instrument.system()  # refuses what commands would
    return describe_instrument(instrument)


def _frames(path: Path, hdu: int | None) -> tuple[Rows, tuple[str, ...]]:
    from jitterkit.detectors.file_variance import NORMALISED, is_normalised
    from jitterkit.frames import open_frames

    with open_frames(path, hdu=hdu) as file:
        try:
            first = file[0]
        except FrameError as error:  # the header can still be described
            return file.describe(), (*file.metadata.warnings, str(error))
        return file.describe(), (*first.metadata.warnings, *[NORMALISED] * is_normalised(first))


def _echo(title: Path | str, rows: Rows, warnings: tuple[str, ...] = ()) -> None:
    """Print a table with its title and warnings."""
    lines = aligned([("", "value", "unit", "source"), *rows])
    lines += [f"warning: {warning}" for warning in warnings]
    typer.echo("\n".join([str(title), *(f"  {line}" for line in lines)]))


def docs(*, topic: Annotated[str | None, typer.Argument()] = None) -> None:
    """List the pages of the handbook, or show one.

    Parameters
    ----------
    topic : TOPIC
        A page; without it, all pages are listed.
    """
    from jitterkit.docs import read_page, topics

    if topic is None:
        titles = topics()
        width = max(map(len, titles))
        typer.echo("\n".join(f"{name:<{width}}  {title}" for name, title in titles.items()))
    elif sys.stdout.isatty():
        from rich.console import Console
        from rich.markdown import Markdown

        Console().print(Markdown(read_page(topic)))
    else:
        typer.echo(read_page(topic), nl=False)
