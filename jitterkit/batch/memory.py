"""A limit on how many tasks run at a time, which falls when memory runs out."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from jitterkit.errors import out_of_memory

log = logging.getLogger(__name__)

T = TypeVar("T")


class _Stay:
    """A task that runs: how many ran at a time meanwhile."""

    most = 0


class MemoryLimiter:
    """Lets some tasks run at a time, and fewer when memory has run out.

    Parameters
    ----------
    concurrency : int
        How many to begin with.
    """

    def __init__(self, concurrency: int) -> None:
        self._concurrency, self._want_all = concurrency, 0
        self._stays: list[_Stay] = []
        self._changed = threading.Condition()

    def run(self, task: Callable[[bool], T]) -> T:
        """Call a task when it may run; if it runs out of memory, again with nothing beside it.

        Where that helps, the others were to blame, and from then on fewer run at a time.

        Parameters
        ----------
        task : callable
            Called with whether it is alone: then what it raises is raised, else what is no lack of memory.
        """
        with self._stay(lambda: not self._want_all and len(self._stays) < self._concurrency) as stay:
            try:
                return task(False)
            except Exception as error:
                if not out_of_memory(error):
                    raise
        with self._changed:
            self._want_all += 1
        try:
            with self._stay(lambda: not self._stays):  # all others have ended, and none may begin
                result = task(True)
        finally:
            with self._changed:
                self._want_all -= 1
                self._changed.notify_all()
        with self._changed:
            if 0 < stay.most - 1 < self._concurrency:
                self._concurrency = stay.most - 1
                log.warning("Memory ran out: no more than %d threads work from here on.", self._concurrency)
        return result

    @contextmanager
    def _stay(self, may_run: Callable[[], bool]) -> Iterator[_Stay]:
        stay = _Stay()
        with self._changed:
            self._changed.wait_for(may_run)
            self._stays.append(stay)
            for one in self._stays:
                one.most = max(one.most, len(self._stays))
        try:
            yield stay
        finally:
            with self._changed:
                self._stays.remove(stay)
                self._changed.notify_all()
