"""A record of the pointing in a file: reach for :func:`read_trace`.

Samples may stand for a missing value (-999, 1e30, a reading at its limit, the last value):
:func:`without_missing` finds them.
"""

from __future__ import annotations

import pathlib
import re
import warnings
from collections.abc import Callable, Sequence

import numpy as np
from scipy.integrate import cumulative_simpson

from jitterkit.errors import ConfigurationError, ErrorCode, refuse_if
from jitterkit.loci.csv_comments import refuse_unit_in_comment
from jitterkit.loci.csv_table import csv_rows, heading, row_numbers
from jitterkit.loci.csv_units import assumed_units, refuse_half_stated, unit_factor
from jitterkit.loci.trace_locus import COLUMNS, check_trace, trace_gaps
from jitterkit.loci.trace_times import dates_to_seconds

MISSING_WORDS = ("", "nan", "na", "n/a", "null", "none", "-", "--")
"""Cells of a table without a value, in lower case."""

_NO_ANGLE = 1e15
"""No angle or rate is as large, in any unit; programs write 1e30 or the largest number of all."""

_NINES = re.compile(r"-?99+(\.9*0*)?")
_LIMITS = {-(2.0**bits) for bits in (7, 15, 31)} | {2.0**bits - 1 for bits in (7, 8, 15, 16, 31, 32)}
"""Ends of what integers hold."""

_FAR = 5.0
"""Distance to the nearest other value [standard deviations of the others]; neighbours in the tails of normal
noise are closer, even of 10⁶ samples."""

_SHARE_OF_CODES, _SHARE_OF_OTHERS = 0.5, 0.1
"""Largest share of the samples, for a usual code and for others: another value that is more frequent may be
one of two positions between which the pointing jumps."""

_FEWEST = 11
"""Samples from which a value that is no usual code may stand for none; fewer are a path somebody drew."""

_OUTLYING, _SHARE_OF_OUTLIERS = 20.0, 0.01
"""Standard deviations from the median beyond which samples are said to be outliers, and their largest share,
where one is always allowed: no vibration or drift has so few so far out."""

_BY_CHANCE = 1e-6
"""Chance of a run of equal samples below which it does not belong to the motion around it."""

_MOST_LOOKED_AT = 50
"""Of the values that may stand for a missing one, so many are looked at, those farthest from others first."""


def without_missing(table: np.ndarray, columns: Sequence[str]) -> tuple[np.ndarray, list[str]]:
    """Leave out the samples of a record that have no value.

    Parameters
    ----------
    table : (n, m) array
        Times in the first column; NaN where a cell has no value.
    columns : sequence of str
        Their names.

    Returns
    -------
    table : (k, m) array
        The rows that have a value in every column.
    said : list of str
        What was left out, and what was not although it may stand for a missing value; a sentence each.

    Notes
    -----
    A value stands for a missing one if it occurs at least twice, equal in all digits, and no other sample is
    within five standard deviations of it: motion passes the places between, and noise does not repeat itself.
    The deviation is half the range of the middle 68 % of the others.  A value that is no usual code (nines,
    the limit of an integer) must take at most a tenth of more than ten samples.  Outliers are motion; a
    sentence says so.  No angle is beyond 1e15.  A sensor that loses its target may repeat
    its last value: a run of equal samples that those outside of it make improbable counts as motion, and a
    sentence says so.
    """
    keep = np.isfinite(table).all(axis=1)
    sentences = [f"{(~keep).sum()} samples of the trace have no value and count as gaps."] * bool(
        (~keep).any()
    )
    for name, values in zip(columns[1:], table.T[1:], strict=True):
        while (found := _code(values[keep])) is not None:
            code, count = found
            if count == 1 and abs(code) < _NO_ANGLE:
                sentence = f"{name} is {code:g} in one sample, far from all others"
                sentences.append(
                    f"{sentence}, which counts as motion: if it stands for no value, leave it out."
                )
                break
            keep &= values != code
            sentences.append(
                f"{name} is {code:g} in {count} samples, far from all others: they count as gaps."
            )
        else:
            if (outliers := _outliers(values[keep])).size:
                share = f"{len(outliers)} of {len(values[keep])} samples, the farthest {outliers[-1]:g}"
                sentences.append(f"{name} has outliers, {share}: they count as motion; leave out errors.")
        if (run := _held(values[keep])) is not None:
            first, last = table[keep, 0][[run.start, run.stop - 1]]
            sentence = f"{name} does not change from t = {first:g} to {last:g}, which counts as motion"
            sentences.append(f"{sentence}: if the sensor held its last value, leave these samples out.")
    return table[keep], sentences


def _outliers(values: np.ndarray) -> np.ndarray:
    """Return the values far from all others that are not known to stand for none, the farthest last."""
    if len(values) < _FEWEST:
        return np.zeros(0)
    low, middle, high = np.quantile(values, [0.16, 0.5, 0.84])
    distance = np.abs(values - middle)
    far = np.flatnonzero(distance > _OUTLYING * (high - low) / 2)
    if high == low or far.size > max(1, _SHARE_OF_OUTLIERS * len(values)):
        return np.zeros(0)
    return values[far[np.argsort(distance[far])]]


def _held(values: np.ndarray) -> slice | None:
    """Return the longest run of equal samples, if those outside of it do not repeat themselves so often."""
    edges = np.flatnonzero(np.diff(values, prepend=np.nan, append=np.nan) != 0)
    lengths = np.diff(edges)
    if len(lengths) < _FEWEST:
        return None
    longest, others = int(lengths.argmax()), len(values) - lengths.max()
    repeats = (others - (len(lengths) - 1) + 1) / (others + 1)
    improbable = len(values) * repeats ** (lengths[longest] - 1) < _BY_CHANCE
    return slice(int(edges[longest]), int(edges[longest + 1])) if improbable else None


def _code(values: np.ndarray) -> tuple[float, int] | None:
    """Return a value that stands for a missing one, and how often it occurs; one that is repeated first."""
    positions, counts = np.unique(values, return_counts=True)
    steps = np.diff(positions, prepend=-np.inf, append=np.inf)
    apart = np.minimum(steps[1:], steps[:-1])
    for single in (False, True):
        group = np.flatnonzero((counts == 1) == single)
        for k in group[np.argsort(-apart[group])][:_MOST_LOOKED_AT]:
            if _is_missing(values, float(positions[k]), int(counts[k]), float(apart[k])):
                return float(positions[k]), int(counts[k])
    return None


def _is_missing(values: np.ndarray, value: float, count: int, apart: float) -> bool:
    """Return whether a value that is so far from any other may stand for a missing one."""
    if abs(value) >= _NO_ANGLE:
        return True
    others = values[values != value]
    if not others.size:
        return False
    low, high = np.quantile(others, [0.16, 0.84])
    far = apart >= _FAR * (high - low) / 2
    if value in _LIMITS or _NINES.fullmatch(f"{value:.9g}"):
        return bool(far) and count <= _SHARE_OF_CODES * len(values)
    moving = high > low and len(values) >= _FEWEST
    return bool(far) and moving and 1 < count <= _SHARE_OF_OTHERS * len(values)


def is_trace(cells: list[str]) -> bool:
    """Return whether a line is the header of a trace."""
    return heading(cells[0])[0] in ("t", "time")


def read_trace(
    path: str | pathlib.Path, rates: str | None = None, log: Callable[[str], None] | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Read a record of the pointing from a CSV table.

    Parameters
    ----------
    path : str or Path
        A line ``t,x,y`` and then numbers: seconds, ascending, and arcsec, unless a unit in brackets follows
        the name: ``t [ms],x [mas],y [mas]``.  Times may be dates (ISO 8601, UTC unless they name a zone),
        which become seconds since 1970.  Rates ``t,wx,wy``, in arcsec/s without a unit, are integrated,
        as are columns whose unit is one of a rate.  Empty lines and lines that begin with ``#`` are skipped.
    rates : str, optional
        Unit of rates whose header does not say that they are, or in what unit: ``deg/s``.
    log : callable, optional
        Called with sentences on rates that were integrated, and on samples without a value, of which Python
        warns without it.

    Returns
    -------
    t, x, y : (n,) arrays
        For :meth:`Trace.of`; s and arcsec.

    Raises
    ------
    ConfigurationError
        If the file is not such a table; the message names the file, the line and the column.

    Notes
    -----
    Rates are integrated by Simpson's rule.  How far the pointing went in a gap is not known: each piece
    between gaps has its own mean as zero.  Samples without a value (empty, NaN, or a number that
    stands for it: :func:`~jitterkit.loci.trace_file.without_missing`) are left out.
    """
    path = pathlib.Path(path)
    problem = "The unit of rates is empty; give one, such as deg/s, or leave it out."
    refuse_if(rates is not None and not rates.strip(), ErrorCode.UNKNOWN_UNIT, problem)
    cells = csv_rows(path, "give a CSV of t,x,y")
    try:
        header = cells[0][1] if cells else []
        rows, dated = dates_to_seconds(cells[1:], heading(header[0])[1] if header else "")
        factors, integrate = _columns([heading(header[0])[0], *header[1:]] if dated else header, rates)
        if not rates:
            refuse_unit_in_comment(path, header)
        table = np.array([row_numbers(row, COLUMNS, MISSING_WORDS) for row in rows]).reshape(-1, 3)
        table, sentences = without_missing(table, COLUMNS)
        if len(table) < 2:
            table = np.array([row_numbers(row, COLUMNS) for row in rows]).reshape(-1, 3)
        t, x, y = (table * factors).T
        check_trace(t, x, y)
        if not integrate:
            _refuse_wrapped(t, x, y)
    except ConfigurationError as error:
        raise ConfigurationError(error.code, f"{path}: {error}") from None
    for sentence in sentences:
        (log or warnings.warn)(f"{path}: {sentence}")
    if log is not None and not rates:
        of_angle = "arcsec/s" if integrate else "arcsec"
        for sentence in assumed_units(header, ("UTC" if dated else "s", of_angle, of_angle)):
            log(sentence)
    if integrate:
        x, y = _integral(t, np.stack([x, y], axis=1)).T
        if log is not None:
            log("The trace holds rates, which were integrated.")
    return t, x, y


def _refuse_wrapped(t: np.ndarray, x: np.ndarray, y: np.ndarray) -> None:
    """Raise ConfigurationError for angles that go on at 0 behind 360, 180 or 90 degrees."""
    for name, values in (("x", x), ("y", y)):
        jumps = np.flatnonzero(np.abs(np.diff(values)) > _FARTHEST)
        if jumps.size:
            problem = f"{name} jumps by more than 45 degrees after {t[jumps[0]]:g} s"
            message = f"{problem}; unwrap the angles, or check the unit."
            raise ConfigurationError(ErrorCode.OUT_OF_RANGE, message)


_FARTHEST = 45 * 3600
"""Arcsec from one sample to the next."""


def _columns(cells: list[str], rates: str | None) -> tuple[list[float], bool]:
    """Return the factors to s, arcsec and arcsec or arcsec/s; and whether the columns are rates."""
    names, units = zip(*map(heading, cells), strict=True) if cells else ((), ())
    named_rates = names[1:] == ("wx", "wy")
    if not cells or not is_trace(cells) or not (named_rates or names[1:] == ("x", "y")):
        problem = f"begins with {','.join(cells)[:80] or 'nothing'!r}; its first line must be t,x,y"
        remedy = "(s, arcsec, arcsec) or, for rates, t,wx,wy (s, arcsec/s, arcsec/s)"
        raise ConfigurationError(ErrorCode.MALFORMED, f"{problem} {remedy}.")
    refuse_half_stated(cells[1:], units[1:])
    found = [
        unit_factor(name, unit or rates or ("arcsec/s" if named_rates else "arcsec"), "arcsec/s", "arcsec")
        for name, unit in zip(names[1:], units[1:], strict=True)
    ]
    kinds = {kind for _, kind in found}
    if rates and units[1] and unit_factor("rates", rates, "arcsec/s", "arcsec") != found[0]:
        problem = f"The rates are given in {rates}, and the header says {cells[1]}"
        raise ConfigurationError(ErrorCode.CONFLICT, f"{problem}; leave one of them out.")
    if len(kinds) > 1 or (kinds == {"arcsec"} and (named_rates or rates)):
        problem = f"The columns {cells[1]} and {cells[2]} are not two angles or two rates"
        remedy = "give both units alike, and a rate's unit, such as deg/s, for rates"
        raise ConfigurationError(ErrorCode.CONFLICT, f"{problem}; {remedy}.")
    time, _ = unit_factor("t", units[0] or "s", "s")
    return [time, *(factor for factor, _ in found)], kinds == {"arcsec/s"}


def _integral(t: np.ndarray, rates: np.ndarray) -> np.ndarray:
    """Integrals (n, 2) of rates, piece by piece between gaps, each about its mean."""
    angles = []
    for piece in np.split(np.arange(len(t)), trace_gaps(t) + 1):
        angle = cumulative_simpson(rates[piece], x=t[piece], axis=0, initial=0)
        duration = t[piece[-1]] - t[piece[0]]
        mean = np.trapezoid(angle, t[piece], axis=0) / duration if duration > 0 else angle[0]
        angles.append(angle - mean)
    return np.concatenate(angles)
