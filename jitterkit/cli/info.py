"""``jitterkit info``: what is in the files, and who says so."""

from __future__ import annotations

import typer

from jitterkit.cli.options import Files, Hdu
from jitterkit.cli.runtime import SOME_FAILED, say

__all__ = ["info"]


def info(files: Files, hdu: Hdu = None) -> None:
    """Print what is known about frames, and where each number comes from."""
    from jitterkit.errors import FrameError
    from jitterkit.frames import find_files, open_frames

    failed = False
    for path in find_files(files):
        try:
            with open_frames(path, hdu=hdu) as file:
                lines = [("", "value", "unit", "source"), *file.describe()]
                warnings = file.metadata.warnings
        except FrameError as error:
            failed = True
            say(f"jitterkit: {error}")
            continue
        typer.echo(path)
        widths = [max(len(line[i]) for line in lines) for i in range(3)]
        for *cells, source in lines:
            typer.echo(
                "  " + "  ".join(c.ljust(w) for c, w in zip(cells, widths, strict=True)) + "  " + source
            )
        for warning in warnings:
            typer.echo(f"  warning: {warning}")
    if failed:
        raise typer.Exit(SOME_FAILED)
