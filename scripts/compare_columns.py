"""Compare two tables of one command, column by column: :func:`compare` returns a :class:`Comparison`.

Rows are matched by their keys.  Numbers are compared only in rows that both versions fitted (status ``ok``)
with the same locus; numbers of different loci differ legitimately.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from compare_values import NUMBERS, Values, error_column

PERIODS = {
    "theta": 360.0,
    "pa": 360.0,
    "smear_direction": 360.0,
    "jitter_angle": 180.0,
    "angle": 180.0,
}
"""Period in deg: 360 for directions, 180 for axes."""

ABSOLUTE = frozenset({"locus_weight", "correlation", "x_pixel", "y_pixel"})
"""Columns whose differences are absolute, in their own unit (1 or a pixel), like those of every ``_corr``."""

AXES = frozenset({"jitter_major", "jitter_minor", "major", "minor"})
"""Sizes along the axes of the blur; their squares are compared in errors of the second moments."""

LISTED_APART = frozenset({"status", "locus", "message", "evidences"})


@dataclass(frozen=True)
class ColumnDifference:
    """Difference of one numeric column.

    Attributes
    ----------
    name, unit : str
        Column, and unit of a difference: ``error`` (OLD's standard error), ``ratio`` (of two errors, less 1),
        ``relative`` or ``absolute``.
    rows : int
        Rows compared.
    rms, largest : float
    row : str
        Row of the largest difference; ``old`` and ``new`` are the values in it.
    """

    name: str
    unit: str
    rows: int
    rms: float
    largest: float
    row: str
    old: float
    new: float


@dataclass(frozen=True)
class CellDifference:
    """A cell that differs as text, or that is a number in one version only."""

    row: str
    column: str
    old: str
    new: str
    old_message: str = ""
    new_message: str = ""


@dataclass(frozen=True)
class LocusDifference:
    """A frame that the versions fitted with different loci; ``shift`` is the separation's, in errors."""

    row: str
    old: str
    new: str
    old_evidences: str
    new_evidences: str
    shift: float


@dataclass(frozen=True)
class Comparison:
    """All differences of two tables."""

    rows: int = 0
    compared: int = 0
    missing_rows: tuple[str, ...] = ()
    new_rows: tuple[str, ...] = ()
    missing_columns: tuple[str, ...] = ()
    new_columns: tuple[str, ...] = ()
    statuses: tuple[CellDifference, ...] = ()
    loci: tuple[LocusDifference, ...] = ()
    texts: tuple[CellDifference, ...] = ()
    not_numbers: tuple[CellDifference, ...] = ()
    columns: tuple[ColumnDifference, ...] = field(default=())

    def worst(self) -> ColumnDifference | None:
        """Return the column that differs most."""
        return max(self.columns, key=lambda column: column.largest, default=None)

    def agrees(self, tolerance: float) -> bool:
        """Return whether nothing differs by more than ``tolerance``; NEW may have additional columns."""
        listed = (self.missing_rows, self.new_rows, self.missing_columns, self.statuses, self.loci)
        worst = self.worst()
        nothing = self.rows > 0 and self.compared == 0  # no row that both versions fitted
        return not any((*listed, self.texts, self.not_numbers, nothing)) and (
            worst is None or worst.largest <= tolerance
        )


def compare(old: Values, new: Values) -> Comparison:
    """Compare two tables.

    Parameters
    ----------
    old, new : Values
        Tables with the same keys.

    Returns
    -------
    comparison : Comparison
        Differences of numbers are new - old, in units of OLD's error if there is one.
    """
    for name, table in (("OLD", old), ("NEW", new)):
        if len(rows := table.rows()) != len(set(rows)):
            twice = next(key for key in rows if rows.count(key) > 1)
            raise ValueError(f"{name} has more than one row {_label(twice)!r}.")
    there, here = ({key: n for n, key in enumerate(table.rows())} for table in (old, new))
    shared = [key for key in there if key in here]
    first = {name: column[[there[key] for key in shared]] for name, column in old.columns.items()}
    second = {name: column[[here[key] for key in shared]] for name, column in new.columns.items()}
    names = np.array([_label(key) for key in shared], dtype=str)
    both = [name for name in old.columns if name in new.columns and name not in old.keys]
    alike = _alike(first, second, len(shared))
    numeric = [name for name in both if {first[name].dtype.kind, second[name].dtype.kind} == {"f"}]
    texts = [name for name in both if name not in numeric and name not in LISTED_APART]
    kept = [{name: column[alike] for name, column in table.items()} for table in (first, second)]
    single = old.keys in (NUMBERS, ("parameter",))
    missing = [_label(key) for key in there if key not in here]
    added = [_label(key) for key in here if key not in there]
    missing_columns = [name for name in old.columns if name not in new.columns]
    new_columns = [name for name in new.columns if name not in old.columns]
    if old.keys == NUMBERS:  # each row is a quantity, like a column of other tables
        missing_columns, new_columns, missing, added = missing, added, [], []
    return Comparison(
        rows=len(shared),
        compared=int(alike.sum()),
        missing_rows=tuple(missing),
        new_rows=tuple(added),
        missing_columns=tuple(missing_columns),
        new_columns=tuple(new_columns),
        statuses=tuple(_status_differences(first, second, names)),
        loci=tuple(_locus_differences(first, second, names)),
        texts=tuple(cell for name in texts for cell in _text_differences(name, first, second, names)),
        not_numbers=tuple(cell for name in numeric for cell in _not_numbers(name, *kept, names[alike])),
        columns=tuple(_difference(name, *kept, names[alike], single) for name in numeric),
    )


def _label(key: tuple[str, ...]) -> str:
    return " ".join(key)


def _alike(first: dict[str, np.ndarray], second: dict[str, np.ndarray], rows: int) -> np.ndarray:
    """Return which rows both versions fitted with the same locus."""
    alike = np.ones(rows, bool)
    for table in (first, second):
        if "status" in table:
            alike &= table["status"] == "ok"
    if "locus" in first and "locus" in second:
        alike &= first["locus"] == second["locus"]
    return alike


def _status_differences(first, second, names):
    if "status" not in first or "status" not in second:
        return
    empty = np.full(len(names), "")
    messages = [table.get("message", empty) for table in (first, second)]
    for n in np.flatnonzero(first["status"] != second["status"]):
        texts = (str(message[n]) for message in messages)
        yield CellDifference(
            str(names[n]), "status", str(first["status"][n]), str(second["status"][n]), *texts
        )


def _locus_differences(first, second, names):
    if "locus" not in first or "locus" not in second:
        return
    empty = np.full(len(names), "")
    evidences = [table.get("evidences", empty) for table in (first, second)]
    both_ok = np.ones(len(names), bool)
    for table in (first, second):
        both_ok &= table.get("status", np.full(len(names), "ok")) == "ok"
    for n in np.flatnonzero(both_ok & (first["locus"] != second["locus"])):
        shift = np.nan
        if {"separation", "separation_err"} <= first.keys() and "separation" in second:
            shift = (second["separation"][n] - first["separation"][n]) / first["separation_err"][n]
        texts = (str(evidence[n]) for evidence in evidences)
        loci = str(first["locus"][n]), str(second["locus"][n])
        yield LocusDifference(str(names[n]), *loci, *texts, float(shift))


def _text_differences(name, first, second, names):
    texts = [_as_text(table[name]) for table in (first, second)]
    for n in np.flatnonzero(texts[0] != texts[1]):
        yield CellDifference(str(names[n]), name, str(texts[0][n]), str(texts[1][n]))


def _as_text(cells: np.ndarray) -> np.ndarray:
    return cells if cells.dtype.kind == "U" else np.array([f"{cell:g}" for cell in cells], dtype=str)


def _not_numbers(name, first, second, names):
    old, new = first[name], second[name]
    same = (old == new) | (np.isnan(old) & np.isnan(new))
    for n in np.flatnonzero(~same & ~(np.isfinite(old) & np.isfinite(new))):
        yield CellDifference(str(names[n]), name, f"{old[n]:g}", f"{new[n]:g}")


def _difference(name, first, second, names, single: bool) -> ColumnDifference:
    """Compare the finite numbers of one column; ``single`` if each row is another quantity."""
    old, new = first[name], second[name]
    finite = np.isfinite(old) & np.isfinite(new)
    if not finite.any():
        return ColumnDifference(name, "relative", 0, 0.0, 0.0, "", np.nan, np.nan)
    away = distance(name, old, new, names if single else None)
    scale, unit = scale_of(name, first)
    beside = _fallback(old[finite] ** 2 if name in AXES else old[finite], single)  # as the distance
    usable = np.isfinite(scale[finite]) & (scale[finite] > 0)
    if name in PERIODS:
        usable |= np.isposinf(scale[finite])  # of a round blur every axis is right
    scale = np.where(usable, scale[finite], beside)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(away[finite] == 0, 0.0, away[finite] / scale)
    worst = int(np.argmax(ratio))
    where = np.flatnonzero(finite)[worst]
    return ColumnDifference(
        name,
        unit if usable.any() else "relative",
        int(finite.sum()),
        float(np.sqrt(np.mean(ratio**2))),
        float(ratio[worst]),
        str(names[where]),
        float(old[where]),
        float(new[where]),
    )


def _fallback(old: np.ndarray, single: bool) -> np.ndarray:
    """Return the scale of relative differences: the value, or the column's median value if that is larger."""
    return np.abs(old) if single else np.maximum(np.abs(old), np.median(np.abs(old)))


def distance(name: str, old: np.ndarray, new: np.ndarray, labels: np.ndarray | None = None) -> np.ndarray:
    """Return |new - old|: of angles modulo 360 or 180 deg, of axes of the blur the change of their squares.

    ``labels`` are the names of the rows if each row is another quantity (``theta.mean``).
    """
    if name in AXES:
        return np.abs(new**2 - old**2)
    away = np.abs(new - old)
    if labels is None:
        period = np.full(len(old), PERIODS.get(name, np.inf))
    else:
        parts = [label.replace("[", ".").split(".") for label in labels]
        period = np.array([min(PERIODS.get(part, np.inf) for part in every) for every in parts])
        period = np.where(np.full(len(old), name == "value"), period, np.inf)
    with np.errstate(invalid="ignore"):
        turned = np.where(np.isfinite(period), away % period, away)
    return np.minimum(turned, np.abs(period - turned))


def scale_of(name: str, old: dict[str, np.ndarray]) -> tuple[np.ndarray, str]:
    """Return the divisor of a column's differences, and its name; NaN means relative to the value."""
    blank = np.full(len(old[name]), np.nan)
    error = error_column(name, old)
    if error is not None and error.dtype.kind == "f":
        return error, "error"
    if name == "error" or name.endswith("_err"):
        return np.abs(old[name]), "ratio"
    if name == "chi2_dof" and "dof" in old:
        return np.sqrt(2 / np.maximum(old["dof"], 1)), "error"
    if {"sxx_err", "sxy_err", "syy_err"} <= old.keys():
        moment = np.max([old["sxx_err"], old["sxy_err"], old["syy_err"]], axis=0)
        if name in AXES:
            return moment, "error"
        if name in ("jitter_angle", "angle"):
            # turning the axis shifts sxy by the angle times the difference of the variances along both axes
            gap = np.hypot(old["sxx"] - old["syy"], 2 * old["sxy"])
            turn = np.divide(moment, gap, where=gap > 0, out=np.full(len(gap), np.inf))
            return np.degrees(turn), "error"
    stem = name.removesuffix("sxy")
    if stem != name and {f"{stem}sxx", f"{stem}syy"} <= old.keys():
        return np.sqrt(np.abs(old[f"{stem}sxx"] * old[f"{stem}syy"])), "relative"
    if name in ABSOLUTE or name.endswith("_corr"):
        return np.ones(len(blank)), "absolute"
    return blank, "relative"
