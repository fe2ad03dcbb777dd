"""Records of one size, kept on disk in the order they came, and read back from either end.

What a run keeps of every frame would fill the memory after a night; it is needed in order only.
"""

from __future__ import annotations

import tempfile
import weakref
from collections.abc import Iterator

import numpy as np

__all__ = ["RecordFile"]

_BLOCK = 512
"""Records read or written at once."""


class RecordFile:
    """A file of float64 records that is deleted with its owner.

    Parameters
    ----------
    width : int
        Numbers in a record.
    """

    def __init__(self, width: int) -> None:
        self.width = width
        self._file = tempfile.TemporaryFile(prefix="jitterkit-")  # noqa: SIM115 (closed below)
        self.close = weakref.finalize(self, self._file.close)
        self._waiting: list[np.ndarray] = []
        self._written = 0

    def __len__(self) -> int:
        return self._written + len(self._waiting)

    def append(self, *parts) -> None:
        """Add a record, given in pieces of any shape."""
        record = np.concatenate([np.ravel(np.asarray(part, float)) for part in parts])
        if record.size != self.width:
            raise ValueError(f"A record of {record.size} numbers does not fit a file of {self.width}.")
        self._waiting.append(record)
        if len(self._waiting) == _BLOCK:
            self._flush()

    def __iter__(self) -> Iterator[np.ndarray]:
        for first in range(0, len(self), _BLOCK):
            yield from self._read(first)

    def __reversed__(self) -> Iterator[np.ndarray]:
        for first in reversed(range(0, len(self), _BLOCK)):
            yield from self._read(first)[::-1]

    def _flush(self) -> None:
        if self._waiting:
            self._file.seek(self._written * self.width * 8)
            self._file.write(np.array(self._waiting).tobytes())
            self._written += len(self._waiting)
            self._waiting = []

    def _read(self, first: int) -> np.ndarray:
        self._flush()
        self._file.seek(first * self.width * 8)
        count = min(_BLOCK, len(self) - first)
        return np.frombuffer(self._file.read(count * self.width * 8)).reshape(count, self.width)
