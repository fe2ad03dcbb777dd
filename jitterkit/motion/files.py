"""Tables of motion in CSV: a spectrum, lines, both, or a record in time.

Reach for :func:`read_motion`, which tells them by their headers.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.loci import read_trace
from jitterkit.loci.csv_table import CsvRow, csv_rows, row_numbers
from jitterkit.motion.record import Record
from jitterkit.motion.spectrum import Line, PowerSpectrum

__all__ = ["read_motion"]

_TRACE = ("t", "x", "y")
_DENSITIES = (("f", "x", "y"), ("f", "x", "y", "xy"))
_LINES = (("frequency", "amplitude", "angle"), ("frequency", "amplitude", "angle", "minor"))
_FORMATS = (
    "give a table of densities f,x,y[,xy] (Hz, arcsec²/Hz), of lines frequency,amplitude,angle[,minor] (Hz, "
    "arcsec, degrees), the one below the other, or a trace t,x,y (s, arcsec)"
)


def read_motion(path: str | Path) -> PowerSpectrum | Record:
    """Read a table of motion.

    Parameters
    ----------
    path : str or Path
        CSV.  Tables begin with a header: ``f,x,y`` or ``f,x,y,xy`` for one-sided densities,
        ``frequency,amplitude,angle`` (or with ``minor``) for lines; a file may hold one of each, one below
        the other.  A file that begins with ``t,x,y`` is a trace.  Empty lines, and lines that begin with
        ``#``, are skipped.

    Returns
    -------
    motion : PowerSpectrum or Record

    Raises
    ------
    ConfigurationError
        If the file is not such a table; the message names file, line and remedy.
    """
    path = Path(path)
    rows = csv_rows(path, _FORMATS)
    if rows and tuple(rows[0][1]) == _TRACE:
        return Record(*read_trace(path))
    try:
        return _spectrum(rows)
    except ConfigurationError as error:
        raise ConfigurationError(error.code, f"{path}: {error}") from None


def _spectrum(rows: list[CsvRow]) -> PowerSpectrum:
    tables: dict[tuple[str, ...], list[tuple[int, list[float]]]] = {}
    header: tuple[str, ...] = ()
    for n, cells in rows:
        kind = next((kind for kind in (_DENSITIES, _LINES) if tuple(cells) in kind), None)
        if kind is not None:
            if tables.keys() & set(kind):
                raise ConfigurationError(
                    ErrorCode.DUPLICATE,
                    f"line {n} begins a second table of one kind; put all its rows into one.",
                )
            header = tuple(cells)
            tables[header] = []
        elif not header:
            raise ConfigurationError(ErrorCode.MALFORMED, f"line {n} is {','.join(cells)!r}; {_FORMATS}.")
        else:
            tables[header].append((n, row_numbers((n, cells), header)))
    densities, lines = (
        [row for header in kind for row in tables.get(header, [])] for kind in (_DENSITIES, _LINES)
    )
    if not (densities or lines):
        raise ConfigurationError(ErrorCode.MALFORMED, f"holds no motion; {_FORMATS}.")
    if len(densities) == 1:
        raise ConfigurationError(
            ErrorCode.TOO_FEW, f"line {densities[0][0]} is the only density; give two or more."
        )
    table = np.array([[*row, 0.0][:4] for _, row in densities]).reshape(-1, 4)
    return PowerSpectrum(table[:, 0], table[:, [1, 3, 2]], tuple(_line(n, row) for n, row in lines))


def _line(n: int, row: list[float]) -> Line:
    try:
        return Line(*row)
    except ConfigurationError as error:
        raise ConfigurationError(error.code, f"line {n}: {error}") from None
