"""The table that a command prints, and the files that it may leave behind."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jitterkit.cli.runtime import command_line, say, show_table

if TYPE_CHECKING:
    from astropy.table import QTable

__all__ = ["check_products", "deliver", "write_picture"]


def check_products(plot: Path | None, output: Path | None, overwrite: bool) -> None:
    """Refuse a picture that is no PNG, a table of unknown ending, and files that cannot be written.

    Raises
    ------
    ConfigurationError
    """
    from jitterkit.report.outputs import check_file, check_table

    if plot is not None:
        check_file(plot, overwrite, ".png")
    if output is not None:
        check_table(output, overwrite)


def deliver(
    table: QTable, draw: Callable[[], Any], plot: Path | None, output: Path | None, overwrite: bool
) -> None:
    """Print a table; where asked, write it with the command that made it, and draw it."""
    from jitterkit.report.table import write_table

    show_table(table)
    if output is not None:
        table.meta["command"] = command_line()
        write_table(output, table, overwrite=overwrite)
    if plot is not None:
        write_picture(plot, draw(), overwrite)


def write_picture(path: Path, ax, overwrite: bool) -> None:
    """Write the figure of some axes as PNG, whole or not at all, and say so."""
    from jitterkit.frames.whole import replacing
    from jitterkit.report.plots import png

    with replacing(path, overwrite) as temporary:
        temporary.write_bytes(png(ax, dpi=160))
    say(f"wrote {path}")
