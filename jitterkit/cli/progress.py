"""The line that a run keeps on the screen: how far, how fast, and what it has found."""

from __future__ import annotations

import contextlib
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

__all__ = ["Tally", "following", "watching"]

_WINDOW = 30.0
"""Seconds over which the rate is taken: long enough for the steps in which batches come."""


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
            self._times.append((now, self.rows))
            while self._times[0][0] < now - _WINDOW:
                self._times.popleft()
        separation, error = row["separation"], row["separation_err"]
        if row["status"] != "ok":
            self.failed += 1
        elif 0 < error < float("inf"):
            self._first = (
                separation if self._weight == 0 else self._first
            )  # sums about it keep the last digits
            self._weight += error**-2
            self._sum += (separation - self._first) * error**-2

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


@contextlib.contextmanager
def following(total: int | None = None) -> Iterator[Callable[[dict[str, Any]], None]]:
    """A line on stderr, at a terminal only; yields a function to call with each row.

    Parameters
    ----------
    total : int, optional
        Files, if their number is known.
    """
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    console, tally = Console(stderr=True), Tally()
    columns = (
        BarColumn(20),
        MofNCompleteColumn(),
        TimeRemainingColumn(compact=True),
        TextColumn("{task.fields[told]}"),
    )
    with Progress(*columns, console=console, disable=not console.is_terminal, transient=True) as progress:
        task, seen = progress.add_task("", total=total, told=""), ""

        def follow(row: dict[str, Any]) -> None:
            nonlocal seen
            tally.add(row, time.monotonic())
            progress.update(task, advance=row["path"] != seen, told=str(tally))
            seen = row["path"]

        yield follow


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
