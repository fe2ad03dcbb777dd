"""Fit frames as they arrive: ``jitterkit watch``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from jitterkit.cli import options
from jitterkit.cli.frame_fit import FrameFit
from jitterkit.cli.progress import live_screen
from jitterkit.cli.run import Run, finalize
from jitterkit.cli.runtime import until_interrupted
from jitterkit.errors import ErrorCode, FrameError


def watch(
    *,
    directory: Annotated[Path, typer.Argument()],
    output: options.OutputDirectory,
    idle: Annotated[float | None, typer.Option(min=0.0)] = None,
    poll: Annotated[float, typer.Option(min=0.05)] = 1.0,
    hdu: options.Hdu = None,
    run: Run,
    fit: FrameFit,
) -> None:
    """Fit frames as they arrive, and keep what is found on the screen.

    A file is processed when it is complete and no longer changes; so are files that are there at the start.
    At the end, or at Ctrl-C, writes what 'process' writes, and lists files that are incomplete. Exit status:
    0 if every frame was fitted, 1 if some were not, 2 if the command cannot be carried out.

    Parameters
    ----------
    directory : DIR
        Where the camera writes FITS or TIFF files.
    idle : SECONDS
        End when no file has come for this time; by default at Ctrl-C.
    poll : SECONDS
        How often to look for new files.
    """
    from jitterkit.errors import printable

    if not directory.is_dir():
        code = ErrorCode.NOT_READABLE if directory.exists() else ErrorCode.NOT_FOUND
        raise FrameError(code, directory, "is not a directory", "give the one into which the camera writes")
    run.check(output)
    processor = fit.processor()
    from jitterkit.run.watch import watch_directory

    settings = run.settings() | {"hdu": hdu, "idle": idle, "poll": poll}
    with live_screen(printable(directory)) as (update, recall), until_interrupted() as interrupted:
        result = watch_directory(
            directory, output, processor, stop=interrupted, watch=update, before=recall, **settings
        )
    finalize(result, processor.instrument)
