"""Declare the files that a command leaves behind beside the table that it prints, and write them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jitterkit.cli import options
from jitterkit.cli.runtime import command_line, log

if TYPE_CHECKING:
    from astropy.table import QTable


@dataclass(frozen=True, kw_only=True)
class Products:
    """Choose the files that a command writes; the docstring of the command describes its picture.

    Parameters
    ----------
    plot : FILE.png
        Draw the result.
    """

    plot: Path | None = None
    output: options.TableOutput = None
    overwrite: options.Overwrite = False

    def check(self) -> None:
        """Refuse a picture that is no PNG, a table of unknown ending, and files that cannot be written.

        Raises
        ------
        ConfigurationError
        """
        from jitterkit.report.outputs import check_file, check_table

        if self.plot is not None:
            check_file(self.plot, self.overwrite, ".png")
        if self.output is not None:
            check_table(self.output, self.overwrite)

    def write(self, table: QTable, draw: Callable[[], Any]) -> None:
        """If requested, write a table with the command that made it, and draw the result on some axes."""
        from jitterkit.report.table import write_table

        if self.output is not None:
            table.meta["command"] = command_line()
            write_table(self.output, table, overwrite=self.overwrite)
        if self.plot is not None:
            write_picture(self.plot, draw(), self.overwrite)


def write_picture(path: Path, ax, overwrite: bool) -> None:
    """Write the figure of some axes as PNG, whole or not at all, and log its name."""
    from jitterkit.frames.whole import replacing
    from jitterkit.report.plots import png

    with replacing(path, overwrite) as temporary:
        temporary.write_bytes(png(ax, dpi=160))
    log(f"wrote {path}")
