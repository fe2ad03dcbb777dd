"""Show the state of a run in progress: the result so far, the rate, and the last frame.

Reach for :func:`live_screen`: at a terminal it keeps some lines at the bottom, elsewhere it writes a line
every few seconds.
"""

from __future__ import annotations

import contextlib
import math
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator
from typing import Any

from jitterkit.cli.progress import ProgressCallback, RunningStatistics
from jitterkit.cli.runtime import log

_RECENT = 50
"""Number of frames of which the kernel on the screen is the mean."""

_EVERY = 5.0
"""Seconds between two lines where there is no terminal."""


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
        from jitterkit.report.words import number, with_error

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
        from jitterkit.report.words import ellipse_size

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
