"""``jitterkit watch``: frames are processed as they arrive."""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated

import typer

from jitterkit.cli import options
from jitterkit.cli.frame_fit import FrameFit
from jitterkit.cli.run import Run, finalize
from jitterkit.cli.runtime import log
from jitterkit.cli.screen import live_screen
from jitterkit.errors import ErrorCode, FrameError

__all__ = ["watch"]


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

    A file is taken once it is whole and rests; those that were there before count too. At the end, or at
    Ctrl-C, writes what 'process' writes; files that are unfinished then are told. Exit status: 0 if every
    frame was fitted, 1 if some were not, 2 if the command cannot be carried out.

    Parameters
    ----------
    directory : DIR
        Where the camera writes FITS or TIFF files.
    idle : SECONDS
        End when nothing has come for so long; by default at Ctrl-C.
    poll : SECONDS
        How often to look for new files.
    """
    from jitterkit.report.words import printable

    if not directory.is_dir():
        code = ErrorCode.NOT_READABLE if directory.exists() else ErrorCode.NOT_FOUND
        raise FrameError(code, directory, "is not a directory", "give the one into which the camera writes")
    run.check(output)
    processor = fit.processor()
    from jitterkit.batch.live import watch_directory

    with live_screen(printable(directory)) as (update, recall), _until_interrupted() as interrupted:
        result = watch_directory(
            directory,
            output,
            processor,
            hdu=hdu,
            idle=idle,
            poll=poll,
            stop=interrupted,
            watch=update,
            before=recall,
            **run.settings(),
        )
    finalize(result, processor.instrument)


@contextlib.contextmanager
def _until_interrupted() -> Iterator[Callable[[], bool]]:
    """Yield a function that returns whether the user has pressed Ctrl-C; the second Ctrl-C ends at once."""
    interrupted = False
    before = signal.getsignal(signal.SIGINT)

    def interrupt(*_: object) -> None:
        nonlocal interrupted
        interrupted = True
        signal.signal(signal.SIGINT, before)
        log("jitterkit: ending with the frames that have come; Ctrl-C again ends at once.")

    if before is not signal.SIG_IGN:  # as it is behind an ampersand in a script, which nobody interrupts
        signal.signal(signal.SIGINT, interrupt)
    try:
        yield lambda: interrupted
    finally:
        signal.signal(signal.SIGINT, before)
