"""How much is done at a time: as much as there are processors, until memory runs out."""

from __future__ import annotations

import logging
from collections.abc import Callable
from threading import Condition
from typing import TypeVar

__all__ = ["Room", "out_of_memory"]

T = TypeVar("T")

log = logging.getLogger(__name__)


def out_of_memory(error: BaseException) -> bool:
    """Whether an exception says that there was no memory, the device's or this machine's."""
    return isinstance(error, MemoryError) or "RESOURCE_EXHAUSTED" in str(error)


class Room:
    """Lets so many tasks work at a time, and fewer when memory has run out.

    Parameters
    ----------
    places : int
        How many to begin with.
    """

    def __init__(self, places: int) -> None:
        self._places, self._busy, self._changed = places, 0, Condition()

    def do(self, task: Callable[[bool], T]) -> T:
        """Call a task when there is a place; if it runs out of memory, again with fewer beside it.

        Parameters
        ----------
        task : callable
            Called with whether nothing may be beside it: then what it raises is raised here, else what is not
            a lack of memory.
        """
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._busy < self._places)
                self._busy += 1
                alone = self._places == 1
            try:
                return task(alone)
            except Exception as error:
                if alone or not out_of_memory(error):
                    raise
                self._narrow()
            finally:
                with self._changed:
                    self._busy -= 1
                    self._changed.notify_all()

    def _narrow(self) -> None:
        with self._changed:
            places = max(1, min(self._places, self._busy - 1))
            if places < self._places:
                log.warning("Memory ran out: no more than %d frames at a time from here on.", places)
            self._places = places
