"""Files that come into a directory, each told once it is whole.

Reach for :class:`Arrivals`.  It looks when it is asked to, and asks the file system for nothing but names,
sizes and times: so it works on network file systems too, where cameras write and where no event is told.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Container, Iterator
from dataclasses import dataclass
from pathlib import Path

from jitterkit.batch.plan import count_frames
from jitterkit.batch.survey import Item
from jitterkit.frames import is_whole
from jitterkit.frames.files import EXTENSIONS
from jitterkit.report.words import printable

__all__ = ["Arrivals"]

log = logging.getLogger(__name__)

_RESTING = 64
"""Looks, a minute of them, for which a file that was taken must rest until it is never looked at again:
frames may be added to it."""


@dataclass
class _Seen:
    """A file that may yet change: its size and time, for how many looks it had them, frames taken of it.

    It is ``doubtful`` once it has changed, or could not be read.
    """

    stamp: tuple[int, int]
    looks: int = 0
    taken: int = 0
    whole: bool = False
    doubtful: bool = False


class Arrivals:
    """Watches a directory for frames.

    Parameters
    ----------
    directory : Path
        Its own files count that :func:`~jitterkit.frames.find_files` would take, not those below it.
    hdu : int, optional
        To look at in a FITS file.
    done : container of (str, int)
        Paths, as a table shows them, and places of frames that are not to be told again.

    Attributes
    ----------
    stirred : bool
        Whether at the last look any file was new or had changed.

    Notes
    -----
    A file is taken that has had its size and time for two looks and can be read to its end.  One that cannot
    is read again after 2, 4, 8, ... looks at rest: its writer may keep its size and time, and it is dear to
    read.  Frames that are added to a file are taken too; a frame that is written anew, in a file of the same
    name, is not.  *Fails when* a writer adds to a file that has rested for a minute.
    """

    def __init__(self, directory: Path, hdu: int | None = None, done: Container = frozenset()) -> None:
        self._directory, self._hdu, self._done = directory, hdu, done
        self._seen: dict[str, _Seen] = {}
        self._settled: set[str] = set()
        self.stirred = self._lost = False

    def look(self) -> Iterator[Item]:
        """Look once; yields the frames that have become whole, in order of name."""
        self.stirred = False
        for name in sorted(self._names()):
            path = self._directory / name
            if self._rests(name, path):
                yield from self._taken(self._seen[name], path)
                self._settle(name)

    def unfinished(self) -> list[Item]:
        """Files that could not be read or were changing, and the first frame of each that was not taken.

        Not those that were left to be looked at.
        """
        seen = sorted(self._seen.items())
        return [(self._directory / name, one.taken) for name, one in seen if one.doubtful and not one.whole]

    def _names(self) -> list[str]:
        """Of files that are new or may yet change; none while the directory cannot be listed."""
        try:
            with os.scandir(self._directory) as entries:
                present = [entry for entry in entries if entry.name not in self._settled]
        except OSError as error:
            if not self._lost:
                log.warning("%s cannot be listed (%s); waiting for it.", self._directory, error.strerror)
            self._lost = True
            return []
        self._lost = False
        names = [entry.name for entry in present if _may_be_frames(entry)]
        for gone in self._seen.keys() - set(names):
            if not self._seen[gone].taken:
                del self._seen[gone]
        return names

    def _rests(self, name: str, path: Path) -> bool:
        """Whether a file is as it was at the look before."""
        try:
            status = path.stat()
        except OSError:  # gone since
            return False
        stamp = (status.st_size, status.st_mtime_ns)
        seen = self._seen.get(name)
        if seen is not None and seen.stamp == stamp:
            seen.looks += 1
            return True
        taken = 0 if seen is None else seen.taken
        self._seen[name] = _Seen(stamp, taken=taken, doubtful=seen is not None)
        self.stirred = True
        return False

    def _taken(self, seen: _Seen, path: Path) -> Iterator[Item]:
        if seen.whole or seen.looks.bit_count() != 1:
            return
        if not is_whole(path):
            seen.doubtful = True
            return
        seen.whole, first, seen.taken = True, seen.taken, count_frames(path, self._hdu)
        for index in range(first, seen.taken):
            if (printable(path), index) not in self._done:
                yield path, index

    def _settle(self, name: str) -> None:
        seen = self._seen[name]
        if seen.whole and seen.looks > _RESTING:
            self._settled.add(name)
            del self._seen[name]


def _may_be_frames(entry: os.DirEntry) -> bool:
    name = entry.name.lower()
    return name.endswith(EXTENSIONS) and not name.startswith(".") and entry.is_file()
