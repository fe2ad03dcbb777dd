"""What a run that goes on keeps on the screen: what was found so far, how fast, and the last frame.

Reach for :func:`on_screen`: at a terminal it keeps some lines at the bottom, elsewhere it writes a line every
few seconds.
"""

from __future__ import annotations

import contextlib
import math
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator
from typing import Any

from jitterkit.cli.progress import Follow, Tally
from jitterkit.cli.runtime import say

__all__ = ["Screen", "on_screen"]

_LATE = 50
"""Frames of which the kernel on the screen is the mean."""

_EVERY = 5.0
"""Seconds between two lines where there is no terminal."""


class Screen:
    """What rows amount to, in a few lines.

    Parameters
    ----------
    where : str
        What is watched.
    """

    def __init__(self, where: str) -> None:
        self._where, self._tally = where, Tally()
        self._statuses: Counter[str] = Counter()
        self._late: deque[tuple[float, float, float]] = deque(maxlen=_LATE)
        self._last = ""

    def add(self, row: dict[str, Any], now: float | None = None) -> None:
        """Count a row that was done at a time [s]; without one it was done in an earlier session."""
        self._tally.add(row, now)
        self._statuses[row["status"]] += 1
        moments = row["sxx"], row["sxy"], row["syy"]
        if row["status"] == "ok" and all(map(math.isfinite, moments)):
            self._late.append(moments)
        self._last = f"{row['file']} [{row['frame']}] {row['message']}"

    def lines(self) -> dict[str, str]:
        """Lines by what they tell; before the first frame, only that it is waited for."""
        from jitterkit.report.words import number, with_error

        if not self._statuses:
            return {"waiting for": f"frames in {self._where}"}
        rate, separation = self._tally.rate, self._tally.separation
        counts = ", ".join(f"{n} {status}" for status, n in self._statuses.most_common())
        told = {
            "separation": f"{with_error(*separation)} arcsec" if separation[1] == separation[1] else "",
            "kernel": self.kernel(),
            "frames": counts,
            "rate": f"{number(rate, 3)} frames/s" if rate == rate else "",
            "last": self._last,
        }
        return {name: text for name, text in told.items() if text}

    def kernel(self) -> str:
        """Mean jitter of late frames: its axes and their direction."""
        if not self._late:
            return ""
        from jitterkit.loci.base import principal_axes
        from jitterkit.report.words import ellipse_size

        mean = [math.fsum(values) / len(self._late) for values in zip(*self._late, strict=True)]
        major, minor, angle = principal_axes(mean)
        direction = f" at {angle:.0f}°" if major > 0 else ""
        return f"{ellipse_size(major, minor)} rms{direction}, of the last {len(self._late)}"


@contextlib.contextmanager
def on_screen(where: str) -> Iterator[tuple[Follow, Follow]]:
    """Keep the screen; yields what to call with each row that is done now, and of an earlier session."""
    from rich.console import Console
    from rich.live import Live
    from rich.table import Table
    from rich.text import Text

    console, screen = Console(stderr=True), Screen(where)
    if not console.is_terminal:
        yield _lines(screen), screen.add
        return

    def drawn() -> Table:
        grid = Table.grid(padding=(0, 2))
        for name, text in screen.lines().items():
            grid.add_row(Text(name), Text(text, overflow="ellipsis", no_wrap=True))
        return grid

    with Live(console=console, get_renderable=drawn, transient=True):
        yield lambda row: screen.add(row, time.monotonic()), screen.add


def _lines(screen: Screen, clock: Callable[[], float] = time.monotonic) -> Follow:
    """Say what there is with the first row and then every few seconds."""
    said = -math.inf

    def follow(row: dict[str, Any]) -> None:
        nonlocal said
        now = clock()
        screen.add(row, now)
        if now >= said + _EVERY:
            said = now
            say("; ".join(f"{name} {text}" for name, text in screen.lines().items()))

    return follow
