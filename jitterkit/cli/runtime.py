"""What a command needs around it: JAX set up, a console for talk, and errors told in a sentence."""

from __future__ import annotations

import contextlib
import ctypes
import functools
import logging
import os
import sys
from collections.abc import Callable
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from astropy.table import QTable

    from jitterkit.errors import JitterkitError

__all__ = ["command_line", "prepare_jax", "say", "say_error", "show_table", "tells_errors"]

USAGE, SOME_FAILED = 2, 1

_ARENA_MAX = -8
"""glibc's name for the number of heaps."""


def prepare_jax(device: str | None = None, float32: bool = False, alone: bool = False) -> None:
    """Choose where to compute and with what numbers, and keep compiled programs for the next start.

    Parameters
    ----------
    device : str, optional
        ``cpu`` or ``gpu``; by default what JAX finds best.
    float32 : bool
        Whether to do with 32 bits.
    alone : bool
        Whether one processor does all, for scripts that measure times or run in several processes: XLA has
        one thread then, in which the programs of all others wait for each other.

    Raises
    ------
    ConfigurationError
        If there is no such device.
    """
    _share_heaps()
    if alone:
        os.environ.setdefault("NPROC", "1")  # read when XLA first computes
    import jax

    from jitterkit.errors import ConfigurationError, ErrorCode
    from jitterkit.optics.toliman import cache_directory

    if device not in (None, "cpu", "gpu"):
        raise ConfigurationError(ErrorCode.UNKNOWN_NAME, f"There is no device {device!r}; give cpu or gpu.")
    if device == "cpu":
        jax.config.update("jax_platforms", "cpu")  # a GPU that is there is left alone
    elif device == "gpu":
        try:
            jax.config.update("jax_default_device", jax.devices("gpu")[0])
        except RuntimeError:
            raise ConfigurationError(
                ErrorCode.MISSING_PACKAGE,
                'JAX finds no GPU here; install its driver and pip install "jitterkit[cuda]", or leave out '
                "--device gpu.",
            ) from None
    jax.config.update("jax_enable_x64", not float32)
    with contextlib.suppress(OSError):
        directory = cache_directory() / "compiled"
        directory.mkdir(parents=True, exist_ok=True)
        jax.config.update("jax_compilation_cache_dir", str(directory))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)  # 70 small ones take 2 s


def _share_heaps() -> None:
    """Let threads share heaps, as many as there are processors, where the C library is glibc and nobody has
    said how many: it makes eight times as many, of which 0.2 to 0.4 GB lie idle in a long run."""
    if "MALLOC_ARENA_MAX" not in os.environ:
        with contextlib.suppress(AttributeError, OSError, TypeError):
            ctypes.CDLL(None).mallopt(_ARENA_MAX, max(2, os.cpu_count() or 2))


def tells_errors(command: Callable[..., None]) -> Callable[..., None]:
    """Turn an error that the user can correct into its message and code on stderr, and exit status 2."""

    @functools.wraps(command)
    def wrapped(*args, **kwargs):
        from jitterkit.errors import JitterkitError

        try:
            command(*args, **kwargs)
        except JitterkitError as error:
            say_error(error)
            raise typer.Exit(USAGE) from None
        except KeyboardInterrupt:
            say("jitterkit: interrupted.")
            raise typer.Exit(130) from None
        except BrokenPipeError:  # the reader of stdout has gone: `jitterkit info ... | head`
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())

    return wrapped


def say_error(error: JitterkitError) -> None:
    """Write an error to stderr: its message, then its code in brackets, which scripts can compare."""
    say(f"jitterkit: {error} [{error.code}]")


def say(message: str) -> None:
    """Talk goes to stderr; stdout is data."""
    typer.echo(message, err=True)


def show_table(table: QTable, align: str | None = None) -> None:
    """Print a table, all of its rows and columns, aligned as astropy's ``pformat`` says."""
    from astropy.table import Table

    plain = Table(table)  # a cell of a Quantity takes three times as long to print as one of a Column
    typer.echo("\n".join(plain.pformat(max_lines=-1, max_width=-1, align=align)))


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
