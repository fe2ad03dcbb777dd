"""Report the differences of two versions in Markdown and JSON: :func:`markdown` and :func:`as_json`."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from compare_columns import CellDifference, ColumnDifference, Comparison
from compare_runs import Times
from compare_values import SHARE_OF_ERROR

SHOWN = 10
"""Largest number of cells of one column in the Markdown report; the JSON report has all."""

NEARLY_EQUAL = SHARE_OF_ERROR
"""Difference up to which a column has no row of its own: reference values are rounded to this."""


@dataclass(frozen=True)
class TaskResult:
    """Comparison of the outputs of one task.

    Attributes
    ----------
    name : str
    problem : str
        Reason why the outputs were not compared; empty if they were.
    comparisons : dict of str to Comparison
        Comparison of each output.
    times : Times or None
        None for a comparison with reference values.
    """

    name: str
    problem: str = ""
    comparisons: dict[str, Comparison] = field(default_factory=dict)
    times: Times | None = None

    def agrees(self, tolerance: float) -> bool:
        """Return whether the outputs were compared and nothing differs by more than the tolerance."""
        return not self.problem and all(c.agrees(tolerance) for c in self.comparisons.values())


def agree(results: Sequence[TaskResult], tolerance: float) -> bool:
    """Return whether all tasks agree."""
    return all(result.agrees(tolerance) for result in results)


def markdown(results: Sequence[TaskResult], tolerance: float, about: Sequence[str]) -> str:
    """Return the whole report."""
    conclusion = "agree" if agree(results, tolerance) else "DIFFER"
    problems = [f"* **{result.name}: {result.problem}**" for result in results if result.problem]
    parts = [
        "# Comparison of versions",
        "\n".join(f"* {line}" for line in about),
        f"At a tolerance of {tolerance:g} the versions **{conclusion}**.",
        *(["\n".join(problems)] if problems else []),
        _summary(results, tolerance),
        *([_times(results)] if any(result.times for result in results) else []),
        *(
            section
            for result in results
            for output, comparison in result.comparisons.items()
            if (section := _details(f"{result.name}, {output}", comparison))
        ),
    ]
    return "\n\n".join(parts) + "\n"


def _rows(heads: Sequence[str], rows: Sequence[Sequence[str]], text_columns: int = 1) -> str:
    """Return a Markdown table; columns after the first ``text_columns`` are aligned as numbers."""
    rule = ["---"] * text_columns + ["---:"] * (len(heads) - text_columns)
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (heads, rule, *rows))


def _summary(results: Sequence[TaskResult], tolerance: float) -> str:
    heads = ("task, output", "", "rows", "statuses", "loci", "texts", "NaN", "largest", "where", "unit")
    rows = []
    for result in results:
        if result.problem:
            rows.append([result.name, "**not compared**", *[""] * 8])
        for output, found in result.comparisons.items():
            worst = found.worst()
            differs = worst is not None and worst.largest > 0
            where = (f"{worst.name} of {worst.row}", worst.unit) if differs else ("", "")
            largest = ("" if worst is None else f"{worst.largest:.3g}", *where)
            counts = (found.compared, *map(len, (found.statuses, found.loci, found.texts, found.not_numbers)))
            conclusion = "agree" if found.agrees(tolerance) else "**differ**"
            rows.append([f"{result.name}, {output}", conclusion, *map(str, counts), *largest])
    return "## Largest differences\n\n" + _rows(heads, rows, 2)


def _times(results: Sequence[TaskResult]) -> str:
    heads = ("task", "cpu OLD [s]", "NEW [s]", "NEW/OLD", "memory OLD [MB]", "NEW [MB]", "NEW/OLD")
    heads += ("first run OLD [s]", "NEW [s]", "NEW/OLD")
    rows = []
    for result in results:
        times = result.times
        if times is None:
            continue
        cpu, memory = times.typical("cpu"), times.typical("memory")
        first = [done.cpu for done in times.first]
        cells = [_pair(cpu, times.ratio("cpu"), 2), _pair(memory, times.ratio("memory"), 0)]
        cells += [_pair(first, first[1] / first[0], 2)]
        rows.append([result.name, *(cell for triple in cells for cell in triple)])
    notes = (
        "Cpu time of a command with all its threads and processes; medians of alternating pairs of runs with "
        "a filled cache. Memory is the peak of the largest process. The first run has an empty cache."
    )
    return f"## Time and memory\n\n{_rows(heads, rows)}\n\n{notes}"


def _pair(values: Sequence[float], ratio: float, digits: int) -> list[str]:
    """Return the cells of OLD, NEW and their ratio."""
    return [*(f"{value:.{digits}f}" for value in values), "" if math.isnan(ratio) else f"{ratio:.3f}"]


def _details(title: str, found: Comparison) -> str:
    """Return the section of one output; empty if nothing differs."""
    lists = [
        *_names("Rows missing in NEW", found.missing_rows),
        *_names("Rows in NEW only", found.new_rows),
        *_names("Columns missing in NEW", found.missing_columns),
        *_names("Columns in NEW only", found.new_columns),
        *(f"* Status of {_cell(cell)}" for cell in found.statuses),
        *(
            f"* Locus of {d.row}: {d.old} -> {d.new}; the separation moved by {d.shift:.3g} errors; "
            f"evidences {d.old_evidences or 'unknown'} -> {d.new_evidences or 'unknown'}"
            for d in found.loci
        ),
        *_listed("differs", found.texts),
        *_listed("is a number in one version only", found.not_numbers),
    ]
    differing = [column for column in found.columns if column.largest > NEARLY_EQUAL]
    equal = [column.name for column in found.columns if column.largest <= NEARLY_EQUAL]
    heads = ("column", "unit", "rows", "rms", "largest", "at", "OLD", "NEW")
    rows = [_column_cells(column) for column in sorted(differing, key=lambda column: -column.largest)]
    tables = [_rows(heads, rows, 2)] if rows else []
    tables += [f"Equal, or within {NEARLY_EQUAL:g}: {', '.join(equal)}."] if equal else []
    if not lists and not rows:
        return ""
    head = f"## {title}\n\n{found.compared} of {found.rows} rows have comparable numbers."
    return "\n\n".join([head, *(["\n".join(lists)] if lists else []), *tables])


def _column_cells(column: ColumnDifference) -> list[str]:
    sizes = (f"{column.rms:.3g}", f"{column.largest:.3g}")
    values = (f"{column.old:.10g}", f"{column.new:.10g}")
    return [column.name, column.unit, str(column.rows), *sizes, column.row, *values]


def _names(what: str, names: Sequence[str]) -> list[str]:
    return [f"* {what}: {', '.join(names)}"] if names else []


def _cell(cell: CellDifference) -> str:
    """Return the values of a cell in both versions, with the messages if it is a status."""
    messages = (("OLD", cell.old_message), ("NEW", cell.new_message))
    said = "; ".join(f"{side}: {text}" for side, text in messages if text)
    return f"{cell.row}: {cell.old!r} -> {cell.new!r}" + (f" ({said})" if said else "")


def _listed(what: str, cells: Sequence[CellDifference]) -> list[str]:
    """Return a line for each column, with the values of its first cells."""
    lines = []
    for name in dict.fromkeys(cell.column for cell in cells):
        those = [cell for cell in cells if cell.column == name]
        more = f"; and {len(those) - SHOWN} more" if len(those) > SHOWN else ""
        shown = "; ".join(map(_cell, those[:SHOWN]))
        lines.append(f"* {name} {what} in {len(those)} rows: {shown}{more}")
    return lines


def as_json(results: Sequence[TaskResult], tolerance: float, about: dict[str, Any]) -> dict[str, Any]:
    """Return everything in types of JSON; NaN and infinity become text."""
    tasks = [dataclasses.asdict(result) | {"agrees": result.agrees(tolerance)} for result in results]
    for task, result in zip(tasks, results, strict=True):
        if result.times:
            task["ratios"] = {name: result.times.ratio(name) for name in ("cpu", "memory")}
    return _finite({**about, "tolerance": tolerance, "agree": agree(results, tolerance), "tasks": tasks})


def _finite(tree: Any) -> Any:
    if isinstance(tree, dict):
        return {key: _finite(item) for key, item in tree.items()}
    if isinstance(tree, list | tuple):
        return [_finite(item) for item in tree]
    return str(tree) if isinstance(tree, float) and not math.isfinite(tree) else tree
