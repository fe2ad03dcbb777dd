"""Watch a directory for new frames, each yielded when its file is complete.

Reach for :class:`DirectoryWatcher`.  It scans when it is called, and asks the file system for nothing but
names, sizes and times: so it works on network file systems too, where cameras write and there are no events.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import count, islice
from pathlib import Path

from jitterkit.batch.plan import Item
from jitterkit.errors import JitterkitError, printable
from jitterkit.frames import is_whole, open_frames
from jitterkit.frames.files import may_be_frames

log = logging.getLogger(__name__)

_RETIRED_AFTER = 64
"""Scans, a minute of them, without a change after which a complete file is no longer scanned: frames may be
added to it until then."""


@dataclass(slots=True)
class _Seen:
    """Hold a file's size and time, scans without a change, number of frames, and the frames yielded.

    It is ``uncertain`` once it has changed, or could not be read.
    """

    stamp: tuple[int, int]
    scans: int = 0
    frames: int = 0
    yielded: set[int] = field(default_factory=set)
    whole: bool = False
    uncertain: bool = False


class DirectoryWatcher:
    """Watches a directory for frames.

    Parameters
    ----------
    directory : Path
        Its own files that :func:`~jitterkit.frames.find_files` would find, not those below it.
    hdu : int, optional
        To read in a FITS file, which is not complete without it.
    done : mapping from (str, int) to str, optional
        Of frames that are not to be yielded again, by name of file, as in a table, and index: the digest of
        their pixels, or an empty text.

    Attributes
    ----------
    changed : bool
        Whether at the last scan any file was new or had changed.

    Notes
    -----
    A file is complete that has had its size and time for two scans and can be read to its end.  One that
    cannot is read again after 2, 4, 8, ... scans without a change: its writer may keep its size and time, and
    reading is slow.  Frames that are added to a file are yielded too.

    A frame counts once: if it is rewritten, in a file of the same name, what was read first stays.  One that
    was yielded and could not be read (:meth:`retry`) is yielded again, with the content of the file then.

    A file that has changed since its frames were yielded is warned of, unless there are more of them; so is
    one with other pixels than those of frames that were done before.

    *Fails when* a writer adds to a file that was unchanged for a minute, or pauses for two scans while what
    it has written can be read: later changes of a frame are not seen.
    """

    def __init__(
        self, directory: Path, hdu: int | None = None, done: Mapping[tuple[str, int], str] | None = None
    ) -> None:
        self._directory, self._hdu, self._done = directory, hdu, done or {}
        self._seen: dict[str, _Seen] = {}
        self._retired: dict[str, _Seen] = {}
        self.changed = self._lost = False

    def scan(self) -> Iterator[Item]:
        """Scan once; yield the frames that have become complete, in order of name."""
        self.changed = False
        for name in sorted(self._names()):
            path = self._directory / name
            if self._is_unchanged(name, path):
                seen = self._seen[name]
                yield from self._whole_frames(seen, path)
                if seen.whole and seen.scans > _RETIRED_AFTER:
                    self._retired[name] = self._seen.pop(name)

    def retry(self, path: Path, index: int) -> None:
        """Take back a frame that was yielded, and then could not be read: its file may be being rewritten.

        It is yielded again when the file is complete, and unchanged for a scan, or for 2, 4, 8, ... scans.
        """
        if path.name in self._retired:
            self._seen[path.name] = self._retired.pop(path.name)
        seen = self._seen[path.name]
        if seen.whole:
            warning = "%s cannot be read after all; it is read again when it changes."
            log.warning(warning, printable(path))
        seen.yielded.discard(index)
        seen.whole, seen.uncertain = False, True

    def unfinished(self) -> Iterator[Item]:
        """Yield the frames not yet yielded of files that could not be read, or were changing.

        For a file that cannot be opened, the first frame.  Files still to be scanned are excluded.
        """
        for name, seen in sorted(self._seen.items()):
            if seen.uncertain and not seen.whole:
                path = self._directory / name
                frames = _count(path, self._hdu)
                missing = self._missing(seen, path, range(frames) if frames else count())
                yield from missing if frames else islice(missing, 1)

    def pending(self) -> str:
        """Describe what is still to be yielded: ``"3 frames of a.fits and 2 files"``, or nothing."""
        words, waiting = [], 0
        for name, seen in sorted(self._seen.items()):
            frames = sum(1 for _ in self._missing(seen, self._directory / name, range(seen.frames or 1)))
            if seen.whole and frames:
                words.append(f"{_counted(frames, 'frame')} of {printable(name)}")
            waiting += frames > 0 and not seen.whole and not seen.uncertain
        return " and ".join(words + [_counted(waiting, "file")] * (waiting > 0))

    def _names(self) -> list[str]:
        """Return the names of files that are new or may change; none while the directory cannot be listed."""
        try:
            with os.scandir(self._directory) as entries:
                present = [entry for entry in entries if entry.name not in self._retired]
        except OSError as error:
            if not self._lost:
                log.warning("%s cannot be listed (%s); waiting for it.", self._directory, error.strerror)
            self._lost = True
            return []
        self._lost = False
        names = [entry.name for entry in present if may_be_frames(entry)]
        for gone in self._seen.keys() - set(names):
            if not self._seen[gone].yielded:
                del self._seen[gone]
        return names

    def _is_unchanged(self, name: str, path: Path) -> bool:
        """Return whether a file is unchanged since the scan before."""
        try:
            status = path.stat()
        except OSError:  # gone since
            return False
        stamp = (status.st_size, status.st_mtime_ns)
        seen = self._seen.get(name)
        if seen is not None and seen.stamp == stamp:
            seen.scans += 1
            return True
        yielded = set() if seen is None else seen.yielded
        self._seen[name] = _Seen(stamp, yielded=yielded, uncertain=seen is not None)
        self.changed = True
        return False

    def _whole_frames(self, seen: _Seen, path: Path) -> Iterator[Item]:
        if seen.whole or seen.scans.bit_count() != 1:
            return
        seen.frames = _count(path, self._hdu) if is_whole(path, hdu=self._hdu) else 0
        seen.whole = seen.frames > 0
        rewritten = seen.uncertain and bool(seen.yielded)
        replaced = not seen.uncertain and self._is_replaced(path, seen.frames)
        seen.uncertain = seen.uncertain or not seen.whole
        for item in self._missing(seen, path, range(seen.frames)):
            rewritten = False
            seen.yielded.add(item[1])
            yield item
        if seen.whole and (rewritten or replaced):
            warning = (
                "%s has changed since it was read, and what was read first stays: give new frames new names."
            )
            log.warning(warning, printable(path))

    def _is_replaced(self, path: Path, frames: int) -> bool:
        """Return whether a file has other pixels than those of its frames that were done before."""
        digests = [self._done.get((printable(path.name), index), "") for index in range(frames)]
        if not any(digests):
            return False
        try:
            with open_frames(path, hdu=self._hdu) as file:
                return any(digest and file[n].digest != digest for n, digest in enumerate(digests))
        except JitterkitError:  # changed since it was whole
            return False

    def _missing(self, seen: _Seen, path: Path, indices: Iterable[int]) -> Iterator[Item]:
        """Return the frames that have not been yielded, in this session or before."""
        name = printable(path.name)
        return ((path, i) for i in indices if i not in seen.yielded and (name, i) not in self._done)


def _count(path: Path, hdu: int | None) -> int:
    """Count the frames of a file; 0 if it cannot be opened."""
    try:
        with open_frames(path, hdu=hdu) as file:
            return len(file)
    except JitterkitError:
        return 0


def _counted(number: int, noun: str) -> str:
    return f"{number} {noun}{'s' * (number != 1)}"
