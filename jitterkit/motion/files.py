"""Tables of motion in CSV: a spectrum, lines, both, or a record in time.

Reach for :func:`read_motion`, which recognises them by their headers.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jitterkit.errors import ConfigurationError, ErrorCode, one_of, refuse_if
from jitterkit.loci import is_trace, read_trace
from jitterkit.loci.csv_comments import refuse_unit_in_comment
from jitterkit.loci.csv_table import CsvRow, comment_lines, csv_rows, heading, row_numbers
from jitterkit.loci.csv_units import assumed_units, is_per_frequency, refuse_half_stated, unit_factor
from jitterkit.motion.bins import KINDS, gaps_between, recognise_rows, spectrum_of_bins
from jitterkit.motion.record import Record
from jitterkit.motion.spectrum import Line, PowerSpectrum

_DENSITIES = ("f", "x", "y", "xy")
_LINES = ("frequency", "amplitude", "angle", "minor")
_UNITS = {
    "f": ("Hz",),
    "x": ("arcsec2/Hz", "arcsec/sqrt(Hz)"),
    "y": ("arcsec2/Hz", "arcsec/sqrt(Hz)"),
    "xy": ("arcsec2/Hz",),
    "frequency": ("Hz",),
    "amplitude": ("arcsec",),
    "angle": ("deg",),
    "minor": ("arcsec",),
}
"""Of each column, that of a column without a unit first."""

_ROOT = "sqrt"

_ALIKE = ("x", "y", "xy", "amplitude", "minor")
"""Columns of a table that have one dimension."""

_FORMATS = (
    "give a table of densities f,x,y[,xy] (Hz, arcsec²/Hz), of lines frequency,amplitude,angle[,minor] (Hz, "
    "arcsec, degrees), the one below the other, or a trace t,x,y (s, arcsec)"
)

Log = Callable[[str], None]


def read_motion(
    path: str | Path, *, kind: str | None = None, rates: str | None = None, log: Log = lambda sentence: None
) -> PowerSpectrum | Record:
    """Read a table of motion.

    Parameters
    ----------
    path : str or Path
        CSV.  Tables begin with a header: ``f,x,y`` or ``f,x,y,xy`` for densities,
        ``frequency,amplitude,angle`` (or with ``minor``) for lines; a file may hold one of each, one below
        the other.  A unit in brackets may follow a name: ``x [mas²/Hz]``.  Columns ``asd_x,asd_y``, or those
        in arcsec/√Hz, are roots of densities.  Negative frequencies, or a comment that says two-sided, make
        densities two-sided.  A file that begins with ``t,x,y`` or ``t,wx,wy`` is a trace
        (:func:`~jitterkit.loci.read_trace`).  Empty lines, and lines that begin with ``#``, are skipped.
    kind : str, optional
        What rows of densities are: ``bins`` of a measured spectrum, which hold power, or points of a drawn
        ``curve``, with power laws between them.  By default
        :func:`~jitterkit.motion.bins.recognise_rows` tells.
    rates : str, optional
        Unit of rates in a trace that does not say so, which are integrated.
    log : callable, optional
        Called with sentences that say how the table was understood.

    Returns
    -------
    motion : PowerSpectrum or Record
        A density at 0 Hz is left out.  Of bins, what stands out is a line.

    Raises
    ------
    ConfigurationError
        If the file is not such a table, or the kind of its rows cannot be determined; the message names file,
        line and remedy.
    """
    path = Path(path)
    if kind is not None:
        one_of("kind of rows", kind, KINDS)
    rows = csv_rows(path, _FORMATS)
    trace = bool(rows) and is_trace(rows[0][1])
    if (trace and kind is not None) or (not trace and rates is not None):
        given, other = ("--kind", "densities") if trace else ("--rates", "a trace")
        raise ConfigurationError(ErrorCode.CONFLICT, f"{path}: {given} is for {other}; leave it out.")
    if trace:
        return Record(*read_trace(path, rates, log))
    try:
        refuse_unit_in_comment(path, rows[0][1] if rows else ())
        densities, lines = _tables(rows, log)
        problem = "--kind is for densities, and there are only lines; leave it out."
        refuse_if(kind is not None and not densities, ErrorCode.CONFLICT, problem)
        random = _random(densities, kind, _stated_sides(path), log)
    except ConfigurationError as error:
        raise ConfigurationError(error.code, f"{path}: {error}") from None
    return PowerSpectrum(random.frequencies, random.density, (*random.lines, *lines))


class _Header(NamedTuple):
    """Columns of a table: their names, factors to their units, and these."""

    names: tuple[str, ...]
    factors: tuple[float, ...]
    units: tuple[str, ...]

    def numbers(self, row: CsvRow) -> dict[str, float]:
        """Return the numbers of a line by column, in the units of :data:`_UNITS`."""
        values = row_numbers(row, self.names)
        columns = zip(self.names, values, self.factors, self.units, strict=True)
        scaled = ((name, value * factor, unit) for name, value, factor, unit in columns)
        return {name: value * value if _ROOT in unit else value for name, value, unit in scaled}


def _header(cells: list[str]) -> _Header | None:
    """Read a header; None of a line that is none."""
    cut = [heading(cell) for cell in cells]
    names = tuple(re.sub(r"^(psd|asd)_?(?=[xy])|_(psd|asd)$", "", name) for name, _ in cut)
    names = tuple("f" if name in ("frequency", "freq") and "x" in names else name for name in names)
    if names not in (_DENSITIES[:3], _DENSITIES, _LINES[:3], _LINES):
        return None
    factors, kinds = [], []
    for name, (written, unit) in zip(names, cut, strict=True):
        wanted = _UNITS[name][::-1] if "asd" in written else _UNITS[name]
        factor, kind = unit_factor(name, unit or wanted[0], *wanted)
        if kind != wanted[0] and ("asd" in written or "psd" in written):
            problem = f"the column {written} has the unit {unit}"
            raise ConfigurationError(ErrorCode.CONFLICT, f"{problem}; correct the name or the unit.")
        factors.append(factor)
        kinds.append(kind)
    roots = [_ROOT in kind for kind in kinds[1:]]
    if any(roots) and not all(roots):
        problem = f"{','.join(cells)!r} mixes densities and their roots"
        raise ConfigurationError(ErrorCode.CONFLICT, f"{problem}; give x and y alike, and no xy with roots.")
    if "rad" in cut[0][1] and names[0] == "f" and not all(is_per_frequency(unit) for _, unit in cut[1:]):
        problem = f"{','.join(cells)!r} has frequencies in rad/s, and densities per Hz or per rad/s"
        raise ConfigurationError(ErrorCode.CONFLICT, f"{problem}; write which behind x and y.")
    alike = [(cell, unit) for cell, (_, unit), name in zip(cells, cut, names, strict=True) if name in _ALIKE]
    refuse_half_stated(*zip(*alike, strict=True))
    return _Header(names, tuple(factors), tuple(kinds))


def _tables(rows: list[CsvRow], log: Log) -> tuple[list[dict[str, float]], list[Line]]:
    """Return the rows of densities and the lines of a file."""
    tables: dict[str, list[dict[str, float]]] = {}
    header: _Header | None = None
    for n, cells in rows:
        if (new := _header(cells)) is not None:
            header = new
            for sentence in assumed_units(cells, header.units):
                log(sentence)
            if header.names[0] in tables:
                problem = f"line {n} begins a second table of one kind; put all its rows into one."
                raise ConfigurationError(ErrorCode.DUPLICATE, problem)
            tables[header.names[0]] = []
        elif header is None:
            raise ConfigurationError(
                ErrorCode.MALFORMED, f"line {n} is {','.join(cells)[:80]!r}; {_FORMATS}."
            )
        else:
            tables[header.names[0]].append({"line": n} | header.numbers((n, cells)))
    lines = [_line(row) for row in tables.get("frequency", [])]
    if twice := [line.frequency for number, line in enumerate(lines) if line in lines[:number]]:
        problem = f"the line of {twice[0]:g} Hz stands there twice; give each line once."
        raise ConfigurationError(ErrorCode.DUPLICATE, problem)
    densities = tables.get("f", [])
    if not (densities or lines):
        raise ConfigurationError(ErrorCode.MALFORMED, f"holds no motion; {_FORMATS}.")
    return densities, lines


def _random(rows: list[dict[str, float]], kind: str | None, sides: str | None, log: Log) -> PowerSpectrum:
    """Return the spectrum of a table of densities."""
    if not rows:
        return PowerSpectrum()
    f = np.array([row["f"] for row in rows])
    density = np.array([[row["x"], row.get("xy", 0.0), row["y"]] for row in rows])
    if np.any(f < 0):
        f, density = _folded(f, density)
        log("The densities have negative frequencies, which were added to the positive ones.")
    elif sides != "one" and _is_mirrored(f, density, certain=sides == "two"):
        log(
            f"The upper half of the densities up to {f[-1]:g} Hz mirrors the lower, as in a two-sided "
            "spectrum, and was added to the lower; if it is one-sided, say so in a comment (# one-sided)."
        )
        above = f[f > 0]
        mirrored = np.where(above > above[::-1], above[::-1], above)
        f, density = _folded(np.concatenate([f[f == 0], mirrored]), density)
    elif sides == "two":
        density = 2 * density
        log("The table says that it is two-sided: its densities were doubled.")
    if f[0] == 0:
        f, density = f[1:], density[1:]
        log("The row at 0 Hz was left out: a constant offset is no motion.")
    if len(f) < 2:
        line = int(rows[-1]["line"])
        raise ConfigurationError(ErrorCode.TOO_FEW, f"line {line} is the only density; give two or more.")
    curve = PowerSpectrum(f, density)  # refuses what is no spectrum
    if (kind or recognise_rows(f, density)) == "bins":
        spectrum, read, other = spectrum_of_bins(f, density), "bins of a measured spectrum", "curve"
    else:
        spectrum, read, other = curve, "points of a curve, power laws between them", "bins"
    remedy = "" if kind else f"; if they are not, give --kind {other}"
    log(f"The {len(f)} rows of densities were read as {read}{remedy}.")
    if read.startswith("bins") and (gaps := gaps_between(f)).size:
        where = ", ".join(f"{f[k]:.5g} to {f[k + 1]:.5g}" for k in gaps)
        log(f"Rows are missing from {where} Hz: no power is counted there.")
    if spectrum.lines:
        listed = ", ".join(f"{line.frequency:.5g}" for line in spectrum.lines)
        log(f"Lines that stand out of the bins, and are listed as lines: {listed} Hz.")
    return spectrum


def _folded(f: np.ndarray, density: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """One-sided densities of two-sided ones, in ascending order.

    Frequencies and their negatives may differ by rounding, but each has its own: all but zero and the ends.
    """
    order = np.argsort(np.abs(f))
    both = np.abs(f)[order]
    both[both < _ROUNDING * both[-1]] = 0.0
    first = np.diff(both, prepend=-1.0) > _ROUNDING * (both[-1] + 1e3 * both)
    row, both = np.cumsum(first) - 1, both[first]
    sums = np.zeros((len(both), density.shape[1]))
    np.add.at(sums, row, density[order])
    alone = both[(np.bincount(row) != 2) & (both > 0)]
    if len(alone) > 1 or (len(alone) and alone[0] != both[-1]):
        problem = f"{alone[0]:g} Hz is there on one side of zero alone, or twice"
        message = f"{problem}; give each frequency and its negative once, or one-sided densities."
        raise ConfigurationError(ErrorCode.MALFORMED, message)
    return both, sums


_ROUNDING = 1e-9
"""Of the highest frequency, by which one and its negative may differ; of their own, 1000 times that."""


_FEWEST_MIRRORED = 8
"""Rows from which a mirrored table is no accident."""


def _is_mirrored(f: np.ndarray, density: np.ndarray, certain: bool) -> bool:
    """Return whether rows run from 0 Hz to the sampling frequency, as two-sided ones of some programs do.

    The upper half repeats the lower then.  Unless a comment says two-sided, it must not be the middle that is
    loudest, as in a drawn band.
    """
    rows = f > 0
    above, power = f[rows], density[rows][:, [0, 2]].sum(axis=1)
    n = len(above)
    if n < _FEWEST_MIRRORED or not np.allclose(above, above[0] * np.arange(1, n + 1), atol=0.3 * above[0]):
        return False
    mirrored = np.allclose(density[rows], density[rows][::-1], rtol=1e-3, atol=0) and np.ptp(power) > 0
    return mirrored and (certain or power[0] > power[n // 2])


_SIDES = r"(one|single|1|uni|two|double|2|both|bi)"
_STATED = re.compile(
    rf"\b(not |non-?)?{_SIDES}[- ]?(?:side[sd]?|lateral)(\s*[=:]\s*(?:false|no|0))?\b"
    rf"|\bside[sd]?\W{{1,3}}{_SIDES}(?:[- ]?side[sd]?)?\b"
)


def _stated_sides(path: Path) -> str | None:
    """Return whether comments say that densities are ``one``- or ``two``-sided; None if they do not say."""
    comments = " ".join(line for _, line in comment_lines(path)).lower()
    found = set()
    for no, kind, false, other in _STATED.findall(re.sub("[_\u2010-\u2015]", "-", comments)):
        one = (kind or other) in ("one", "single", "1", "uni")
        found.add("one" if one != bool(no or false) else "two")
    if len(found) > 1:
        problem = "the comments say one-sided and two-sided; leave one of the words out."
        raise ConfigurationError(ErrorCode.CONFLICT, problem)
    return found.pop() if found else None


def _line(row: dict[str, float]) -> Line:
    try:
        return Line(*(row[name] for name in _LINES if name in row))
    except ConfigurationError as error:
        raise ConfigurationError(error.code, f"line {row['line']}: {error}") from None
