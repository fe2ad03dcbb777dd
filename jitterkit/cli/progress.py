"""Show the progress of a run on the screen: files done, rate, time left, and the mean separation.

Reach for :func:`run_progress`, a line for a known number of files, and for :func:`live_screen` where frames
arrive: at a terminal it keeps some lines at the bottom, elsewhere it writes a line every few seconds.
"""

from __future__ import annotations

import contextlib
import math
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

from jitterkit.cli.runtime import log
from jitterkit.report.words import ellipse_size, number, with_error

_WINDOW = 30.0
"""Seconds over which the rate is taken: several batches."""

_SIMULTANEOUS = 0.1
"""Seconds within which rows belong to one batch, which reports them within a few milliseconds."""

_RECENT = 50
"""Number of frames of which the kernel on the screen is the mean."""

_EVERY = 5.0
"""Seconds between two lines where there is no terminal."""


@dataclass
class RunningStatistics:
    """Accumulate counts, rate and mean separation of rows.

    Attributes
    ----------
    rows, failed : int
    """

    rows: int = 0
    failed: int = 0
    _first: float = float("nan")
    _weight: float = 0.0
    _sum: float = 0.0
    _times: deque[tuple[float, int]] = field(default_factory=deque, repr=False)

    def add(self, row: dict[str, Any], now: float | None = None) -> None:
        """Count a row that was done at a time [s], or without a time in an earlier session."""
        self.rows += 1
        if now is not None:
            self._record(now)
        separation, error = row["separation"], row["separation_err"]
        if row["status"] not in ("ok", "duplicate"):
            self.failed += 1
        elif row["status"] == "ok" and 0 < error < float("inf"):
            if self._weight == 0:
                self._first = separation  # sums about it keep the last digits
            self._weight += error**-2
            self._sum += (separation - self._first) * error**-2

    def _record(self, now: float) -> None:
        """Record the number of rows when the last row of a batch has come."""
        if self._times and now - self._times[-1][0] < _SIMULTANEOUS:
            now, _ = self._times.pop()
        self._times.append((now, self.rows))
        while self._times[0][0] < now - _WINDOW:
            self._times.popleft()

    @property
    def rate(self) -> float:
        """Recent rows per second; NaN before two batches have come."""
        if not self._times or self._times[-1][0] == self._times[0][0]:
            return float("nan")
        (start, first), (end, last) = self._times[0], self._times[-1]
        return (last - first) / (end - start)

    @property
    def separation(self) -> tuple[float, float]:
        """Weighted mean and its error [arcsec]; NaN before the first separation."""
        if not self._weight:
            return float("nan"), float("nan")
        return self._first + self._sum / self._weight, self._weight**-0.5

    def __str__(self) -> str:
        parts = [f"{self.rate:.1f} frames/s"] if self.rate == self.rate else []
        parts += [f'separation {with_error(*self.separation)}"'] if self._weight else []
        return "  ".join([*parts, *[f"{self.failed} failed"] * bool(self.failed)])


def time_left(statistics: RunningStatistics, done: int, total: int) -> str:
    """Return the time that the remaining files will take, if they hold as many frames as those that are done.

    Parameters
    ----------
    statistics : RunningStatistics
        Statistics of the rows.
    done, total : int
        Numbers of files.

    Returns
    -------
    time : str
        Hours, minutes and seconds; dashes before there is a rate.

    Examples
    --------
    >>> statistics = RunningStatistics()
    >>> for now in range(5):
    ...     statistics.add({"status": "failed", "separation": 0.0, "separation_err": 0.0}, now=2.0 * now)
    >>> time_left(statistics, done=5, total=2005), time_left(RunningStatistics(), done=0, total=3)
    ('1:06:40', '-:--:--')
    """
    if statistics.rate != statistics.rate or not done:
        return "-:--:--"
    seconds = round((total - done) * statistics.rows / done / statistics.rate)
    return f"{seconds // 3600}:{seconds // 60 % 60:02d}:{seconds % 60:02d}"


ProgressCallback = Callable[[dict[str, Any]], None]
"""Function that is called with each row."""


@contextlib.contextmanager
def run_progress(total: int) -> Iterator[tuple[ProgressCallback, ProgressCallback]]:
    """Keep a line on stderr, at a terminal only.

    Parameters
    ----------
    total : int
        Number of files.

    Yields
    ------
    update, recall : callable
        Functions to call with each row that is done now, and with each row of an earlier session, which does
        not count for the rate.
    """
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn

    statistics = RunningStatistics()
    left, text = TextColumn("{task.fields[left]}"), TextColumn("{task.fields[text]}")
    with _progress(BarColumn(20), MofNCompleteColumn(), left, text) as progress:
        task, seen, files = progress.add_task("", total=total, text="", left=""), "", 0

        def count(row: dict[str, Any], now: float | None) -> None:
            nonlocal seen, files
            statistics.add(row, now)
            seen, files = row["path"], files + (row["path"] != seen)
            remaining = time_left(statistics, files, total)
            progress.update(task, completed=files, text=str(statistics), left=remaining)

        yield lambda row: count(row, time.monotonic()), lambda row: count(row, None)


@contextlib.contextmanager
def progress_bar(total: int, label: str) -> Iterator[Callable[[str], None]]:
    """Keep a progress bar on stderr, at a terminal only; yield a function to call with each item's name."""
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn

    name = TextColumn("{task.fields[item]}", markup=False)
    with _progress(
        TextColumn(label), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(), name
    ) as progress:
        task = progress.add_task(label, total=total, item="")
        yield lambda item: progress.update(task, advance=1, item=item)


def _progress(*columns):
    """Return a line of columns on stderr, which is hidden where stderr is no terminal."""
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    return Progress(*columns, console=console, disable=not console.is_terminal, transient=True)


class Screen:
    """Summarise rows in a few lines.

    Parameters
    ----------
    where : str
        Name of the directory that is watched.
    """

    def __init__(self, where: str) -> None:
        self._where, self._statistics = where, RunningStatistics()
        self._statuses: Counter[str] = Counter()
        self._recent: deque[tuple[float, float, float]] = deque(maxlen=_RECENT)
        self._last = ""

    def add(self, row: dict[str, Any], now: float | None = None) -> None:
        """Count a row that was done at a time [s], or without a time in an earlier session."""
        self._statistics.add(row, now)
        self._statuses[row["status"]] += 1
        moments = row["sxx"], row["sxy"], row["syy"]
        if row["status"] == "ok" and all(map(math.isfinite, moments)):
            self._recent.append(moments)
        self._last = f"{row['file']} [{row['frame']}] {row['message']}"

    def lines(self) -> dict[str, str]:
        """Return the lines by their titles; before the first frame, one line that names the directory."""
        if not self._statuses:
            return {"waiting for": f"frames in {self._where}"}
        rate, separation = self._statistics.rate, self._statistics.separation
        counts = ", ".join(f"{n} {status}" for status, n in self._statuses.most_common())
        lines = {
            "separation": f"{with_error(*separation)} arcsec" if separation[1] == separation[1] else "",
            "kernel": self.kernel(),
            "frames": counts,
            "rate": f"{number(rate, 3)} frames/s" if rate == rate else "",
            "last": self._last,
        }
        return {name: text for name, text in lines.items() if text}

    def kernel(self) -> str:
        """Return the mean jitter of recent frames: its axes and their direction."""
        if not self._recent:
            return ""
        from jitterkit.loci.base import principal_axes

        mean = [math.fsum(values) / len(self._recent) for values in zip(*self._recent, strict=True)]
        major, minor, angle = principal_axes(mean)
        direction = f" at {angle:.0f}°" if major > 0 else ""
        return f"{ellipse_size(major, minor)} rms{direction}, of the last {len(self._recent)}"


@contextlib.contextmanager
def live_screen(where: str) -> Iterator[tuple[ProgressCallback, ProgressCallback]]:
    """Keep the screen; yield functions to call with each row that is done now, and of an earlier session."""
    from rich.console import Console
    from rich.live import Live
    from rich.table import Table
    from rich.text import Text

    console, screen = Console(stderr=True), Screen(where)
    if not console.is_terminal:
        yield _lines(screen), screen.add
        return

    def render() -> Table:
        grid = Table.grid(padding=(0, 2))
        for name, text in screen.lines().items():
            grid.add_row(Text(name), Text(text, overflow="ellipsis", no_wrap=True))
        return grid

    with Live(console=console, get_renderable=render, transient=True):
        yield lambda row: screen.add(row, time.monotonic()), screen.add


def _lines(screen: Screen, clock: Callable[[], float] = time.monotonic) -> ProgressCallback:
    """Return a function that logs the lines with the first row and then every few seconds."""
    last = -math.inf

    def update(row: dict[str, Any]) -> None:
        nonlocal last
        now = clock()
        screen.add(row, now)
        if now >= last + _EVERY:
            last = now
            log("; ".join(f"{name} {text}" for name, text in screen.lines().items()))

    return update
