"""Assemble the commands of ``jitterkit``, and declare the options of all commands together."""

from __future__ import annotations

from typing import Annotated

import typer

from jitterkit.cli.budget import budget
from jitterkit.cli.calibrate import calibrate
from jitterkit.cli.causes import causes
from jitterkit.cli.command import as_command
from jitterkit.cli.crossfit import crossfit
from jitterkit.cli.estimate import estimate
from jitterkit.cli.forecast import forecast
from jitterkit.cli.info import docs, info
from jitterkit.cli.instrument import instrument
from jitterkit.cli.motion import motion
from jitterkit.cli.photons import photons
from jitterkit.cli.run import process, watch
from jitterkit.cli.runtime import set_verbosity
from jitterkit.cli.sequence import sequence
from jitterkit.cli.simulate import simulate
from jitterkit.cli.trade import trade

app = typer.Typer(
    name="jitterkit",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)

for command in (
    *(info, instrument, simulate, calibrate, estimate, process, watch, sequence),
    *(forecast, budget, causes, crossfit, motion, photons, trade, docs),
):
    app.command()(as_command(command))


def _version(requested: bool) -> None:
    if requested:
        from importlib.metadata import version

        typer.echo(f"jitterkit {version('jitterkit')}")
        raise typer.Exit


@app.callback()
def main(
    verbose: Annotated[
        int, typer.Option("--verbose", "-v", count=True, help="Print more messages; twice: all messages.")
    ] = 0,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print errors only.")] = False,
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Telescope jitter from images: blur kernels, and the binary separation behind them."""
    set_verbosity(-1 if quiet else verbose)


def run() -> None:
    """Entry point of the console script."""
    app()
