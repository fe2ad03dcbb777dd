"""Files that come into a directory, each told once it is whole.

Reach for :class:`DirectoryWatcher`.  It looks when it is asked to, and asks the file system for nothing but
names, sizes and times: so it works on network file systems too, where cameras write and no event is told.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Container, Iterable, Iterator
from dataclasses import dataclass, field
from itertools import count, islice
from pathlib import Path

from jitterkit.batch.plan import Item
from jitterkit.errors import JitterkitError, printable
from jitterkit.frames import is_whole, open_frames
from jitterkit.frames.files import EXTENSIONS

__all__ = ["DirectoryWatcher"]

log = logging.getLogger(__name__)

_RESTING = 64
"""Looks, a minute of them, for which a file that was taken must rest until it is never looked at again:
frames may be added to it."""


@dataclass(slots=True)
class _Seen:
    """A file: its size and time, for how many looks it had them, how many frames it held, which were told.

    It is ``doubtful`` once it has changed, or could not be read.
    """

    stamp: tuple[int, int]
    looks: int = 0
    frames: int = 0
    told: set[int] = field(default_factory=set)
    whole: bool = False
    doubtful: bool = False


class DirectoryWatcher:
    """Watches a directory for frames.

    Parameters
    ----------
    directory : Path
        Its own files count that :func:`~jitterkit.frames.find_files` would take, not those below it.
    hdu : int, optional
        To look at in a FITS file; until it has that one it is not whole.
    done : container of (str, int)
        Names of files, as a table shows them, and places of frames that are not to be told again.

    Attributes
    ----------
    changed : bool
        Whether at the last look any file was new or had changed.

    Notes
    -----
    A file is taken that has had its size and time for two looks and can be read to its end.  One that cannot
    is read again after 2, 4, 8, ... looks at rest: its writer may keep its size and time, and it is dear to
    read.  Frames that are added to a file are taken too.

    A frame counts once: of one that is written anew, in a file of the same name, what was read first stays.
    One that was told and could not be read (:meth:`again`) is told again, of whatever the file holds then.

    *Fails when* a writer adds to a file that has rested for a minute, or rests for two looks while what it
    has written can be read: what it mends in a frame afterwards is not seen.
    """

    def __init__(self, directory: Path, hdu: int | None = None, done: Container = frozenset()) -> None:
        self._directory, self._hdu, self._done = directory, hdu, done
        self._seen: dict[str, _Seen] = {}
        self._settled: dict[str, _Seen] = {}
        self.changed = self._lost = False

    def look(self) -> Iterator[Item]:
        """Look once; yields the frames that have become whole, in order of name."""
        self.changed = False
        for name in sorted(self._names()):
            path = self._directory / name
            if self._rests(name, path):
                yield from self._taken(self._seen[name], path)
                self._settle(name)

    def again(self, path: Path, index: int) -> None:
        """Take back a frame that was told, and then could not be read: its file may be in the making anew.

        It is told again when the file is whole, and has rested since it changed, or for 2, 4, 8, ... looks.
        """
        if path.name in self._settled:
            self._seen[path.name] = self._settled.pop(path.name)
        seen = self._seen[path.name]
        if seen.whole:
            said = "%s cannot be read after all; it is looked at again when it changes."
            log.warning(said, printable(path))
        seen.told.discard(index)
        seen.whole, seen.doubtful = False, True

    def unfinished(self) -> Iterator[Item]:
        """Yield the frames that were not told of files that could not be read, or were changing.

        Of a file that cannot even be opened the first.  None of files that were left to be looked at.
        """
        for name, seen in sorted(self._seen.items()):
            if seen.doubtful and not seen.whole:
                path = self._directory / name
                frames = _count(path, self._hdu)
                missing = self._missing(seen, path, range(frames) if frames else count())
                yield from missing if frames else islice(missing, 1)

    def pending(self) -> str:
        """What there is that nobody asked for, in words: ``"3 frames of a.fits and 2 files"``, or nothing."""
        words, waiting = [], 0
        for name, seen in sorted(self._seen.items()):
            frames = sum(1 for _ in self._missing(seen, self._directory / name, range(seen.frames or 1)))
            if seen.whole and frames:
                words.append(f"{_counted(frames, 'frame')} of {printable(name)}")
            waiting += frames > 0 and not seen.whole and not seen.doubtful
        return " and ".join(words + [_counted(waiting, "file")] * (waiting > 0))

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
            if not self._seen[gone].told:
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
        told = set() if seen is None else seen.told
        self._seen[name] = _Seen(stamp, told=told, doubtful=seen is not None)
        self.changed = True
        return False

    def _taken(self, seen: _Seen, path: Path) -> Iterator[Item]:
        if seen.whole or seen.looks.bit_count() != 1:
            return
        seen.frames = _count(path, self._hdu) if is_whole(path, hdu=self._hdu) else 0
        seen.whole = seen.frames > 0
        seen.doubtful = seen.doubtful or not seen.whole
        for item in self._missing(seen, path, range(seen.frames)):
            seen.told.add(item[1])
            yield item

    def _missing(self, seen: _Seen, path: Path, places: Iterable[int]) -> Iterator[Item]:
        """Those frames that have not been told, in this session or before."""
        name = printable(path.name)
        return ((path, i) for i in places if i not in seen.told and (name, i) not in self._done)

    def _settle(self, name: str) -> None:
        seen = self._seen[name]
        if seen.whole and seen.looks > _RESTING:
            self._settled[name] = self._seen.pop(name)


def _may_be_frames(entry: os.DirEntry) -> bool:
    name = entry.name.lower()
    return name.endswith(EXTENSIONS) and not name.startswith(".") and entry.is_file()


def _count(path: Path, hdu: int | None) -> int:
    """Frames of a file, 0 of one that cannot be opened."""
    try:
        with open_frames(path, hdu=hdu) as file:
            return len(file)
    except JitterkitError:
        return 0


def _counted(number: int, noun: str) -> str:
    return f"{number} {noun}{'s' * (number != 1)}"
