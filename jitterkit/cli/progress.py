"""The line that a run keeps on the screen: how far, how fast, and what it has found."""

from __future__ import annotations

import contextlib
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

__all__ = ["Follow", "Tally", "following", "watching"]

_WINDOW = 30.0
"""Seconds over which the rate is taken: long enough for the steps in which batches come."""

_TOGETHER = 0.1
"""Seconds within which rows come at one time: those of a batch take a few milliseconds to be told."""


@dataclass
class Tally:
    """What rows amount to, one after the other.

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
        """Count a row that was done at a time [s]; without one it was done in an earlier session."""
        self.rows += 1
        if now is not None:
            self._note(now)
        separation, error = row["separation"], row["separation_err"]
        if row["status"] not in ("ok", "duplicate"):
            self.failed += 1
        elif row["status"] == "ok" and 0 < error < float("inf"):
            self._first = (
                separation if self._weight == 0 else self._first
            )  # sums about it keep the last digits
            self._weight += error**-2
            self._sum += (separation - self._first) * error**-2

    def _note(self, now: float) -> None:
        """Note how many rows there were when the last of those that come together had come."""
        if self._times and now - self._times[-1][0] < _TOGETHER:
            now, _ = self._times.pop()
        self._times.append((now, self.rows))
        while self._times[0][0] < now - _WINDOW:
            self._times.popleft()

    @property
    def rate(self) -> float:
        """Rows a second of late; NaN before two have come at different times."""
        if not self._times or self._times[-1][0] == self._times[0][0]:
            return float("nan")
        (began, first), (ended, last) = self._times[0], self._times[-1]
        return (last - first) / (ended - began)

    @property
    def separation(self) -> tuple[float, float]:
        """Weighted mean and its error [arcsec]; NaN before the first."""
        if not self._weight:
            return float("nan"), float("nan")
        return self._first + self._sum / self._weight, self._weight**-0.5

    def __str__(self) -> str:
        from jitterkit.report.words import with_error

        parts = [f"{self.rate:.1f} frames/s"] if self.rate == self.rate else []
        parts += [f'separation {with_error(*self.separation)}"'] if self._weight else []
        return "  ".join([*parts, *[f"{self.failed} failed"] * bool(self.failed)])


def time_left(tally: Tally, done: int, total: int) -> str:
    """How long files will take that are yet to come, if they hold as many frames as those that are done.

    Parameters
    ----------
    tally : Tally
        Of their rows.
    done, total : int
        Files.

    Returns
    -------
    time : str
        Hours, minutes and seconds; dashes before there is a rate.

    Examples
    --------
    >>> tally = Tally()
    >>> for now in range(5):
    ...     tally.add({"status": "failed", "separation": 0.0, "separation_err": 0.0}, now=2.0 * now)
    >>> time_left(tally, done=5, total=2005), time_left(Tally(), done=0, total=3)
    ('1:06:40', '-:--:--')
    """
    if tally.rate != tally.rate or not done:
        return "-:--:--"
    seconds = round((total - done) * tally.rows / done / tally.rate)
    return f"{seconds // 3600}:{seconds // 60 % 60:02d}:{seconds % 60:02d}"


Follow = Callable[[dict[str, Any]], None]
"""To be called with a row."""


@contextlib.contextmanager
def following(total: int) -> Iterator[tuple[Follow, Follow]]:
    """A line on stderr, at a terminal only.

    Parameters
    ----------
    total : int
        Files.

    Yields
    ------
    follow, recall : callable
        To be called with each row: one that is done now, and one of an earlier session, which tells nothing
        of how fast it goes.
    """
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

    console, tally = Console(stderr=True), Tally()
    columns = (
        BarColumn(20),
        MofNCompleteColumn(),
        TextColumn("{task.fields[left]}"),
        TextColumn("{task.fields[told]}"),
    )
    with Progress(*columns, console=console, disable=not console.is_terminal, transient=True) as progress:
        task, seen, files = progress.add_task("", total=total, told="", left=""), "", 0

        def count(row: dict[str, Any], now: float | None) -> None:
            nonlocal seen, files
            tally.add(row, now)
            seen, files = row["path"], files + (row["path"] != seen)
            left = time_left(tally, files, total)
            progress.update(task, completed=files, told=str(tally), left=left)

        yield lambda row: count(row, time.monotonic()), lambda row: count(row, None)


@contextlib.contextmanager
def watching(total: int, label: str) -> Iterator[Callable[[str], None]]:
    """A progress bar on stderr, at a terminal only; yields a function to call with each item's name."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    columns = (
        TextColumn(label),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[item]}", markup=False),
    )
    with Progress(*columns, console=console, disable=not console.is_terminal, transient=True) as progress:
        task = progress.add_task(label, total=total, item="")

        def advance(item: str) -> None:
            progress.update(task, advance=1, item=item)

        yield advance
