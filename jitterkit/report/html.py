"""The report: one HTML file that shows a run, with its pictures inside and nothing outside.

The page needs no network, no script and no second file.  Everything that came from a file or a header
is escaped, invisible and direction-changing characters become visible, and the page's own policy forbids
the browser to run or load anything, so a frame named ``<script>`` is a frame with an odd name.  A page is
as long as a person reads: of 60,000 frames it has the reasons of failure, not the failures, and pictures of
the worst.  This is the only module that imports jinja2.
"""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Iterable
from importlib.resources import files
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from astropy.table import QTable
from jinja2 import Environment, StrictUndefined
from markupsafe import Markup

from jitterkit.errors import printable
from jitterkit.frames.writer import replacing
from jitterkit.report.flags import FLAGS, decode_flags
from jitterkit.report.pictures import MOST_PICTURES, FrameReport, choose_pictures
from jitterkit.report.residual_stack import ResidualStack
from jitterkit.report.row import FailureKind, Row, group_failures
from jitterkit.report.run_pictures import run_pictures
from jitterkit.report.sequence import describe_loci, describe_misfits, describe_run_fit
from jitterkit.report.table import aberration_names
from jitterkit.report.words import NOTHING, angle_size, by_scale, ellipse_size, number, with_error

MAX_ROWS = 1000
"""Frames listed; a longer run is thinned evenly, and the page says so."""

MAX_FAILURES = 300
"""Failures listed one by one, the first of them; their kinds are counted over all."""

_FEW, _KINDS = 12, 30
"""Failures that a list shows as well as a count of kinds does, and kinds that fit the page."""

_FAILURE_COLUMNS = ("file", "frame", "path", "status", "reason", "message")
_LONGEST = 600
"""Characters of one sentence or name: a command line may hold 60,000 names, a header a page of text."""


def write_report(
    path: str | Path,
    entries: Iterable[FrameReport],
    table: QTable,
    summary: dict[str, Any],
    stack: ResidualStack | None = None,
    *,
    max_pictures: int = MOST_PICTURES,
    title: str = "jitterkit report",
    overwrite: bool = False,
) -> None:
    """Write the report of a run.

    Parameters
    ----------
    path : str or Path
    entries : iterable of FrameReport
        The frames with pictures; of a long run, the worst of them.
    table : QTable
        All frames.
    summary : dict
        From :func:`~jitterkit.report.summary.summarise`.
    stack : ResidualStack, optional
        Of the residuals of all frames.
    max_pictures : int
        At most so many frames are shown: those that failed and those that fit worst.  Every
        failure's sentence is given all the same.
    title : str
        Heading of the page.
    overwrite : bool
        Whether a file of that name may be replaced.

    Raises
    ------
    FrameError
        If the file exists and may not be overwritten, or cannot be written.
    """
    entries = list(entries)
    shown = [entries[index] for index in choose_pictures([entry.row for entry in entries], max_pictures)]
    page = _template().render(
        title=printable(title),
        style=Markup(_resource("report.css")),
        table=_Listing(table),
        summary=summary,
        plots=run_pictures(table, summary, stack),
        pictures=shown,
        provenance=_flattened({k: v for k, v in table.meta.items() if k != "flags"}),
    )
    with replacing(Path(path), overwrite) as temporary:
        temporary.write_text(page, encoding="utf-8", newline="\n")


def _resource(name: str) -> str:
    return files("jitterkit.report").joinpath(name).read_text(encoding="utf-8")


def _template():
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, finalize=_readable, trim_blocks=True, lstrip_blocks=True
    )
    filters = (angle_size, by_scale, describe_loci, describe_misfits, describe_run_fit, number)
    environment.filters |= {function.__name__: function for function in filters}
    environment.filters |= {
        "base64": lambda data: Markup(base64.b64encode(data).decode("ascii")),
        "remarks": lambda code: [(word.replace("_", " "), FLAGS[word]) for word in decode_flags(code)],
        "said": lambda row: row["message"].removeprefix(f"{row['path']}: "),
        "status": lambda name: name.replace("_", " "),
        "grouped": "{:,}".format,
        "several": lambda n, word: f"{n} {word}" if n == 1 else f"{n:,} {word}s",
    }
    environment.globals |= {
        "aberration_names": aberration_names,
        "candidates": _candidates,
        "ellipse_size": ellipse_size,
        "isfinite": math.isfinite,
        "NOTHING": NOTHING,
        "pm": lambda row, name: with_error(row[name], row[f"{name}_err"]),
        "with_error": with_error,
    }
    return environment.from_string(_resource("report.html.j2"))


def _readable(value: Any) -> Any:
    """Return what a page shows of any value: nothing invisible, and no more than a person reads."""
    if isinstance(value, Markup | int | float):
        return value
    text = printable(value)
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]} … ({len(text)} characters)"


def _candidates(row: Row) -> list[dict[str, Any]]:
    """Loci that were tried, with how much worse than the best each fits; a missing number is NaN again."""
    tried = json.loads(row["candidates"] or "[]")
    tried = [{key: math.nan if value is None else value for key, value in one.items()} for one in tried]
    best = min((one["objective"] for one in tried), default=math.nan)
    return [one | {"excess": one["objective"] - best} for one in tried]


def _flattened(nested: Any, prefix: str = "") -> list[tuple[str, str]]:
    """Nested metadata as lines of a list."""
    if isinstance(nested, dict):
        inner = (_flattened(value, f"{prefix} {key}".strip()) for key, value in nested.items())
        return [*chain.from_iterable(inner)]
    if isinstance(nested, list):
        return [(prefix, " ".join(printable(item) for item in nested))]
    return [(prefix, printable(nested))]


class _Listing:
    """The rows of a table that the page lists, as plain dicts."""

    def __init__(self, table: QTable) -> None:
        self.length = len(table)
        self._columns = {name: np.asarray(table[name]) for name in table.colnames}
        self._failed = np.flatnonzero(~np.isin(self._columns["status"], ("ok", "duplicate")))
        self.failures = len(self._failed)
        self.step = max(1, math.ceil(self.length / MAX_ROWS))
        paths, counts = np.unique(self._columns["path"], return_counts=True)
        self._several = set(paths[counts > 1].tolist())

    def failed(self) -> list[Row]:
        """Return the first failures."""
        return self._rows(self._failed[:MAX_FAILURES])

    def kinds(self) -> tuple[list[FailureKind], int]:
        """Return the commonest kinds of failure, and how many more there are; none of few failures."""
        if self.failures <= _FEW:
            return [], 0
        kinds = group_failures(self._row(int(index), _FAILURE_COLUMNS) for index in self._failed)
        return kinds[:_KINDS], len(kinds[_KINDS:])

    def thinned(self) -> list[Row]:
        """Frames from the first to the last, evenly."""
        return self._rows(range(0, self.length, self.step))

    def _rows(self, indices: Iterable[int]) -> list[Row]:
        return [self._row(int(index)) for index in indices]

    def _row(self, index: int, names: Iterable[str] | None = None) -> Row:
        """Return a row with its ``number`` from 1 and its ``name``."""
        wanted = (name for name in names or self._columns if name in self._columns)
        row = {name: self._columns[name][index].item() for name in wanted}
        several = row["frame"] > 0 or row["path"] in self._several
        name = f"{row['file']}[{row['frame']}]" if several else row["file"]
        return row | {"number": index + 1, "name": name}
