"""What a command needs around it: JAX set up, a console for talk, and errors told in a sentence."""

from __future__ import annotations

import contextlib
import functools
import logging
import os
import sys
from collections.abc import Callable, Iterator

import typer

__all__ = ["command_line", "prepare_jax", "say", "tells_errors", "watching"]

USAGE, SOME_FAILED = 2, 1


def prepare_jax() -> None:
    """Ask for 64-bit numbers, and keep compiled programs for the next start."""
    import jax

    from jitterkit.optics.toliman import cache_directory

    jax.config.update("jax_enable_x64", True)
    with contextlib.suppress(OSError):
        directory = cache_directory() / "compiled"
        directory.mkdir(parents=True, exist_ok=True)
        jax.config.update("jax_compilation_cache_dir", str(directory))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.3)


def tells_errors(command: Callable[..., None]) -> Callable[..., None]:
    """Turn what the user can mend into one sentence on stderr and exit status 2."""

    @functools.wraps(command)
    def wrapped(*args, **kwargs):
        from jitterkit.errors import JitterkitError

        try:
            command(*args, **kwargs)
        except JitterkitError as error:
            say(f"jitterkit: {error}")
            raise typer.Exit(USAGE) from None
        except KeyboardInterrupt:
            say("jitterkit: interrupted.")
            raise typer.Exit(130) from None
        except BrokenPipeError:  # the reader of stdout has gone: `jitterkit info ... | head`
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())

    return wrapped


def say(message: str) -> None:
    """Talk goes to stderr; stdout is data."""
    typer.echo(message, err=True)


def command_line() -> str:
    """The command as it was given."""
    return " ".join(["jitterkit", *sys.argv[1:]])


def set_talk(verbosity: int) -> None:
    """Set the level of logging: negative is quiet, positive is chatty."""
    level = {-1: logging.ERROR, 0: logging.WARNING, 1: logging.INFO}.get(verbosity, logging.DEBUG)
    logging.basicConfig(level=level, format="%(name)s: %(message)s", stream=sys.stderr)
    logging.getLogger("jitterkit").setLevel(level)
    if verbosity < 2:
        logging.getLogger("jax").setLevel(logging.ERROR)


@contextlib.contextmanager
def watching(total: int, label: str) -> Iterator[Callable[[str], None]]:
    """A progress bar on stderr, at a terminal only; yields a function to call with each item's name."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    columns = (
        TextColumn(label),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[item]}"),
    )
    with Progress(*columns, console=console, disable=not console.is_terminal, transient=True) as progress:
        task = progress.add_task(label, total=total, item="")

        def advance(item: str) -> None:
            progress.update(task, advance=1, item=item)

        yield advance
