"""Set up JAX and logging for a command, and write its messages, tables and pictures."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import logging
import os
import signal
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from jitterkit.errors import ConfigurationError, ErrorCode, JitterkitError, one_of, refuse_if

if TYPE_CHECKING:
    from astropy.table import QTable

    from jitterkit.instruments import Instrument


USAGE, SOME_FAILED = 2, 1

LISTED = 50
"""Largest number of lines about frames."""

_ARENA_MAX = -8
"""glibc's name for the number of heaps."""


def prepare_jax(device: str | None = None, float32: bool = False, single_threaded: bool = False) -> None:
    """Choose where to compute and with what numbers, and keep compiled programs for the next start.

    It also has XLA compile quickly, unless ``XLA_FLAGS`` says how, and Python look for garbage less often.

    Parameters
    ----------
    device : str, optional
        ``cpu`` or ``gpu``; by default what JAX finds best.
    float32 : bool
        Whether to compute with 32 bits.
    single_threaded : bool
        Whether XLA has one thread, for commands that measure times or run in several processes.

    Raises
    ------
    ConfigurationError
        If there is no such device.
    """
    _share_heaps()
    # tracing makes many objects and little garbage: to look for it took 5 % of a first frame's time
    gc.set_threshold(200_000, 10, 10)
    if single_threaded:
        os.environ.setdefault("NPROC", "1")  # read when XLA first computes
    import jax

    from jitterkit.optics.toliman import cache_directory

    if not os.environ.get("XLA_FLAGS"):
        os.environ["XLA_FLAGS"] = _quick_compilation(jax.__version_info__)  # read when XLA first compiles
    if device is not None:
        one_of("device", device, ("cpu", "gpu"))
    if device == "cpu":
        jax.config.update("jax_platforms", "cpu")  # does not touch a GPU
    elif device == "gpu":
        try:
            jax.config.update("jax_default_device", jax.devices("gpu")[0])
        except RuntimeError:
            remedy = 'install its driver and pip install "jitterkit[cuda]", or leave out --device gpu'
            problem = f"JAX finds no GPU here; {remedy}."
            raise ConfigurationError(ErrorCode.MISSING_PACKAGE, problem) from None
    jax.config.update("jax_enable_x64", not float32)
    with contextlib.suppress(OSError):
        directory = cache_directory() / "compiled"
        directory.mkdir(parents=True, exist_ok=True)
        jax.config.update("jax_compilation_cache_dir", str(directory))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)  # 70 small ones take 2 s


def _quick_compilation(version: tuple[int, ...]) -> str:
    """Return options of XLA with which a first frame is answered in two thirds of the time.

    Programs are as fast with them: 300 frames took the same processor time to 0.5 %.  An XLA that lacks an
    option refuses to start, so that versions of JAX that are not known to have it get none.
    """
    options = ["--xla_cpu_use_fusion_emitters=false"] if version < (0, 11) else []
    if not metadata.entry_points(group="jax_plugins"):  # of accelerators, on which it was not measured
        options.append("--xla_backend_optimization_level=1")
    return " ".join(options)


def open_instrument(name: str, **settings: Any) -> Instrument:
    """Prepare JAX as :func:`prepare_jax` does, and return the instrument of a name or a file."""
    prepare_jax(**settings)
    from jitterkit.instruments import load_instrument

    return load_instrument(name)


def dark_exposure(telescope: Instrument) -> float:
    """Return the exposure in which a dark current collects; zero where it is unknown and none is there.

    Raises
    ------
    ConfigurationError
        If a dark current has no exposure.
    """
    import numpy as np

    dark = telescope.detector.dark_current
    unknown = not telescope.exposure and dark is not None and bool(np.any(dark))
    problem = f"The instrument {telescope.name!r} has a dark_current and no exposure; give it one, in s."
    refuse_if(unknown, ErrorCode.MISSING_VALUE, problem)
    return telescope.exposure or 0.0


def _share_heaps() -> None:
    """Let glibc make as many heaps as there are processors, unless the environment sets their number.

    By default it makes eight times as many, of which 0.2 to 0.4 GB lie idle in a long run.
    """
    if "MALLOC_ARENA_MAX" not in os.environ:
        with contextlib.suppress(AttributeError, OSError, TypeError):
            ctypes.CDLL(None).mallopt(_ARENA_MAX, max(2, os.cpu_count() or 2))


@contextlib.contextmanager
def naming(path: Path) -> Iterator[None]:
    """Put the name of a file before the message of an error that does not name it."""
    try:
        yield
    except ConfigurationError as error:
        message = str(error)
        if str(path) in message:
            raise
        raise ConfigurationError(error.code, f"{path}: {message}") from None


def log_error(error: JitterkitError) -> None:
    """Write an error to stderr: its message, then its code in brackets, which scripts can compare."""
    log(f"jitterkit: {error} [{error.code}]")


def log(message: str) -> None:
    """Write a message to stderr; stdout is for data."""
    typer.echo(message, err=True)


def print_table(table: QTable, align: str | None = None) -> None:
    """Print a table, all of its rows and columns, aligned as by astropy's ``pformat``."""
    from astropy.table import Table

    plain = Table(table)  # a cell of a Quantity takes three times as long to print as one of a Column
    typer.echo("\n".join(plain.pformat(max_lines=-1, max_width=-1, align=align)))


def write_picture(path: Path, ax, overwrite: bool) -> None:
    """Write the figure of some axes as PNG, whole or not at all, and log its name."""
    from jitterkit.frames.writer import replacing
    from jitterkit.report.plots import png

    with replacing(path, overwrite) as temporary:
        temporary.write_bytes(png(ax, dpi=160))
    log(f"wrote {path}")


def aligned(rows: Iterable[Sequence[str]]) -> list[str]:
    """Return rows of cells as lines of text with aligned columns.

    >>> aligned([("gain", "3.7"), ("read noise", "2.4")])
    ['gain        3.7', 'read noise  2.4']
    """
    rows = list(rows)
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return ["  ".join(map(str.ljust, row, widths)).rstrip() for row in rows]


def command_line() -> str:
    """Return the command as it was given."""
    return " ".join(["jitterkit", *sys.argv[1:]])


def set_verbosity(verbosity: int) -> None:
    """Set the level of logging: negative is quiet, positive is verbose."""
    level = {-1: logging.ERROR, 0: logging.WARNING, 1: logging.INFO}.get(verbosity, logging.DEBUG)
    logging.basicConfig(level=level, format="%(name)s: %(message)s", stream=sys.stderr)
    logging.getLogger("jitterkit").setLevel(level)
    if verbosity < 2:
        logging.getLogger("jax").setLevel(logging.ERROR)


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
