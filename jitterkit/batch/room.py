"""How much is done at a time: as much as there are processors, until memory runs out."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Condition
from typing import TypeVar

from jitterkit.errors import out_of_memory

__all__ = ["Room"]

T = TypeVar("T")

log = logging.getLogger(__name__)


class _Stay:
    """Of one task in the room: how many were there at a time."""

    most = 0


class Room:
    """Lets so many tasks work at a time, and fewer when memory has run out.

    Parameters
    ----------
    places : int
        How many to begin with.
    """

    def __init__(self, places: int) -> None:
        self._places, self._want_all = places, 0
        self._stays: list[_Stay] = []
        self._changed = Condition()

    def do(self, task: Callable[[bool], T]) -> T:
        """Call a task when there is a place; if it runs out of memory, again with nothing beside it.

        Where that helps, the others were to blame, and from then on there is room for fewer.

        Parameters
        ----------
        task : callable
            Called with whether it is alone: then what it raises is raised, else what is no lack of memory.
        """
        with self._stay(lambda: not self._want_all and len(self._stays) < self._places) as stay:
            try:
                return task(False)
            except Exception as error:
                if not out_of_memory(error):
                    raise
        with self._alone():
            result = task(True)
        self._narrow(stay.most - 1)
        return result

    @contextmanager
    def _stay(self, may_enter: Callable[[], bool]) -> Iterator[_Stay]:
        stay = _Stay()
        with self._changed:
            self._changed.wait_for(may_enter)
            self._stays.append(stay)
            for one in self._stays:
                one.most = max(one.most, len(self._stays))
        try:
            yield stay
        finally:
            with self._changed:
                self._stays.remove(stay)
                self._changed.notify_all()

    @contextmanager
    def _alone(self) -> Iterator[None]:
        """When all others have left, and none may enter."""
        with self._changed:
            self._want_all += 1
        try:
            with self._stay(lambda: not self._stays):
                yield
        finally:
            with self._changed:
                self._want_all -= 1
                self._changed.notify_all()

    def _narrow(self, places: int) -> None:
        with self._changed:
            if 0 < places < self._places:
                self._places = places
                log.warning("Memory ran out: no more than %d threads work at a time from here on.", places)
