"""The picture and the table that a command may leave behind."""

from __future__ import annotations

from pathlib import Path

from jitterkit.cli.runtime import say

__all__ = ["check_products", "write_picture"]


def check_products(plot: Path | None, output: Path | None, overwrite: bool) -> None:
    """Refuse a picture that is no PNG, a table that is no ECSV, and files that cannot be written.

    Raises
    ------
    ConfigurationError
    """
    from jitterkit.report.outputs import check_file

    for path, ending in ((plot, ".png"), (output, ".ecsv")):
        if path is not None:
            check_file(path, overwrite, ending)


def write_picture(path: Path, ax, overwrite: bool) -> None:
    """Write the figure of some axes as PNG, whole or not at all, and say so."""
    from jitterkit.frames.whole import replacing
    from jitterkit.report.plots import png

    with replacing(path, overwrite) as temporary:
        temporary.write_bytes(png(ax, dpi=160))
    say(f"wrote {path}")
