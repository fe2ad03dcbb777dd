"""What a user, a closed terminal or a scheduler says to end a command: Ctrl-C, SIGHUP, SIGTERM."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
from collections.abc import Callable, Iterator
from typing import Any

from jitterkit.cli.runtime import log

_ENDS = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]


@contextlib.contextmanager
def as_interrupt() -> Iterator[None]:
    """Raise KeyboardInterrupt for SIGTERM and SIGHUP too, while the block runs."""

    def end(*_: Any) -> None:
        raise KeyboardInterrupt

    with _handled(end):
        yield


@contextlib.contextmanager
def until_interrupted() -> Iterator[Callable[[], bool]]:
    """Yield a function that returns whether the end was requested; a second request ends at once."""
    interrupted = False

    def end(number: int, *_: Any) -> None:
        nonlocal interrupted
        if interrupted:
            raise KeyboardInterrupt
        interrupted = True
        log("jitterkit: ending after the frames that have arrived; press Ctrl-C again to end at once.")

    with _handled(end):
        yield lambda: interrupted


@contextlib.contextmanager
def _handled(end: Callable[..., None]) -> Iterator[None]:
    """Handle the signals that are not ignored, as they are behind an ampersand or nohup in a script."""

    def handle(number: int, frame: Any) -> None:
        if number == getattr(signal, "SIGHUP", None):
            _leave_terminal()
        end(number, frame)

    before = {number: signal.getsignal(number) for number in _ENDS}
    for number in _ENDS:
        if before[number] is not signal.SIG_IGN:
            signal.signal(number, handle)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _leave_terminal() -> None:
    """Write to nowhere in place of a terminal that is gone: what is left to do does not end for that."""
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError):
            if stream.isatty():
                os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
