"""Results in the directory of a run that are not its own: neither to be lost unasked nor to be taken for its.

Reach for :func:`refuse_results` where nobody has allowed to replace them, :func:`remove_results` where
somebody has.
"""

from __future__ import annotations

from pathlib import Path

from jitterkit.batch.ledger_trouble import unwritable
from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.report.outputs import RUN
from jitterkit.report.words import printable

__all__ = ["refuse_results", "remove_results"]


def refuse_results(directory: Path) -> None:
    """Refuse to go on in a directory with results of a run of which there is no ledger.

    Raises
    ------
    ConfigurationError
    """
    if present := [name for name in RUN if (directory / name).exists()]:
        raise ConfigurationError(
            ErrorCode.EXISTS,
            f"{printable(directory)} holds {present[0]} but no run in a ledger to go on with; give "
            "--overwrite instead of --resume to replace it, or another directory.",
        )


def remove_results(directory: Path) -> None:
    """Remove what an earlier run wrote at its end, and nothing else: a new one begins.

    Raises
    ------
    ConfigurationError
        If a file cannot be removed.
    """
    for path in (directory / name for name in RUN):
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            raise unwritable(path, error.strerror) from None
