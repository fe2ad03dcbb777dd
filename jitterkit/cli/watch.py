"""``jitterkit watch``: frames are processed as they arrive."""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated

import typer

from jitterkit.cli import options
from jitterkit.cli.process import Output, Resume, conclude
from jitterkit.cli.processor import takes_processor
from jitterkit.cli.runtime import command_line, say
from jitterkit.cli.screen import on_screen

__all__ = ["watch"]


@takes_processor
def watch(
    make: Callable,
    directory: Annotated[
        Path, typer.Argument(metavar="DIR", help="Where the camera writes FITS or TIFF files.")
    ],
    output: Output,
    idle: Annotated[
        float | None,
        typer.Option(
            min=0.0,
            metavar="SECONDS",
            help="End when nothing has come for so long; by default at Ctrl-C.",
            show_default=False,
        ),
    ] = None,
    poll: Annotated[
        float, typer.Option(min=0.05, metavar="SECONDS", help="How often to look for new files.")
    ] = 1.0,
    hdu: options.Hdu = None,
    overwrite: options.Overwrite = False,
    resume: Resume = False,
) -> None:
    """Fit frames as they arrive, and keep what is found on the screen.

    A file is taken once it is whole and rests; those that were there before count too. At the end, or at
    Ctrl-C, writes what 'process' writes; files that are unfinished then are told. Exit status: 0 if every
    frame was fitted, 1 if some were not, 2 if the command cannot be carried out.
    """
    from jitterkit.errors import ErrorCode, FrameError
    from jitterkit.report.outputs import RUN, check_directory
    from jitterkit.report.words import printable

    if not directory.is_dir():
        code = ErrorCode.NOT_READABLE if directory.exists() else ErrorCode.NOT_FOUND
        raise FrameError(code, directory, "is not a directory", "give the one into which the camera writes")
    check_directory(output, RUN, overwrite or resume)
    processor = make()
    from jitterkit.batch.live import watch_directory

    with on_screen(printable(directory)) as (follow, recall), _until_asked() as asked:
        run = watch_directory(
            directory,
            output,
            processor,
            hdu=hdu,
            idle=idle,
            poll=poll,
            overwrite=overwrite,
            resume=resume,
            stop=asked,
            watch=follow,
            before=recall,
            command=command_line(),
        )
    conclude(run, processor.instrument)


@contextlib.contextmanager
def _until_asked() -> Iterator[Callable[[], bool]]:
    """Whether the user has asked for the end; who asks twice gets it at once."""
    asked = False
    before = signal.getsignal(signal.SIGINT)

    def end(*_: object) -> None:
        nonlocal asked
        asked = True
        signal.signal(signal.SIGINT, before)
        say("jitterkit: ending with the frames that have come; Ctrl-C again ends at once.")

    if before is not signal.SIG_IGN:  # as it is behind an ampersand in a script, where no one is asked
        signal.signal(signal.SIGINT, end)
    try:
        yield lambda: asked
    finally:
        signal.signal(signal.SIGINT, before)
