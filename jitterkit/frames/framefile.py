"""A file of frames, opened: what every format offers, and how its troubles become sentences.

A format is one module with a class derived from :class:`FrameFile`; it implements ``_read``, opens its
files by ``enter_context`` and sets the attributes.  The rest of the package sees only this.
"""

from __future__ import annotations

import logging
import os
import threading
import warnings
from abc import abstractmethod
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np

from jitterkit.errors import ErrorCode, FrameError, JitterkitError
from jitterkit.frames.files import damage_code
from jitterkit.frames.frame import RawFrame
from jitterkit.frames.metadata import Metadata

#: Catching warnings swaps what belongs to the whole process: of two threads that do, the second to leave
#: would put back what the first had put there, and warnings would be lost from then on.
_CATCHING = threading.RLock()
#: What a library raises that believed a damaged file, rather than found it out.
_STUMBLES = (TypeError, AttributeError, LookupError, ArithmeticError, AssertionError)


class FrameFile(Sequence[RawFrame], ExitStack):
    """The frames of one file, a sequence of which each is read when it is asked for.

    It is a context manager that closes what it has opened; ``close()`` does so too, and may be called twice.

    Attributes
    ----------
    path : Path
        The file.
    kind : str
        ``"FITS"`` or ``"TIFF"``.
    shape : (int, int)
        ``(ny, nx)`` of the first frame, as it is handed out.
    dtype : numpy.dtype
        Of the pixels as stored, in native byte order.
    hdu : int or None
        The FITS HDU chosen.
    metadata : Metadata
        What holds for the whole file.
    """

    kind: str = ""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.path = path
        self.shape: tuple[int, int] = (0, 0)
        self.dtype = np.dtype(float)
        self.hdu: int | None = None
        self.metadata = Metadata()
        self._count = 0
        with translated(path):
            self._status = os.stat(path)

    @abstractmethod
    def _read(self, index: int) -> RawFrame:
        """Return what the file says of a frame; any exception is translated."""

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, index: int) -> RawFrame:  # type: ignore[override]  # one at a time
        """Read one frame; negative indices count from the end.

        Raises
        ------
        IndexError
            If there is no such frame.
        FrameError
            If it cannot be read, or the file has changed since it was opened: nothing in it is sure then.

        Notes
        -----
        A change is recognised by the size, the time of change and the inode.  *Fails when* a file is
        overwritten in place with as many bytes within one tick of the file system's clock (milliseconds).
        """
        number = range(self._count)[index]
        with translated(self.path) as caught:
            frame = self._read(number)
            before, now = self._status, os.stat(self.path)
            if any(getattr(now, of) != getattr(before, of) for of in ("st_size", "st_mtime_ns", "st_ino")):
                how = f"from {before.st_size} to {now.st_size} bytes"
                how = how if now.st_size != before.st_size else f"its {now.st_size} bytes are others"
                problem = f"changed while it was being read ({how})"
                raise FrameError(ErrorCode.CHANGED, self.path, problem, "read it again when it is finished")
        metadata = frame.metadata.warn(*caught)
        return frame.with_fields(metadata=metadata, path=self.path, index=number, several=self._count > 1)

    def describe(self) -> list[tuple[str, str, str, str]]:
        """Return ``(name, value, unit, source)`` rows: the file first, then the metadata."""
        ny, nx = self.shape
        where = "content" if self.hdu is None else f"HDU {self.hdu}"
        file = [
            ("format", self.kind, "", "content"),
            ("frames", str(self._count), self._stacking(), where),
            ("size", f"{nx} x {ny}", "pixel", where),
            ("stored as", str(self.dtype), "", where),
        ]
        return file + self._contents() + self.metadata.rows()

    def text(self, key: str) -> str:
        """Return a keyword of the file's header as text, empty where there is none."""
        return ""

    def _stacking(self) -> str:
        """Return what the frames of the file have in common, in a few words."""
        return ""

    def _contents(self) -> list[tuple[str, str, str, str]]:
        """Rows on the parts of the file, where a format has several."""
        return []


@contextmanager
def translated(path: Path) -> Iterator[list[str]]:
    """Turn whatever a reading library raises into FrameError, and collect what it warns about.

    Yields
    ------
    caught : list of str
        Filled with the warnings, one line each and each once, when the block ends.
    """
    messages: list[str] = []
    with collected() as caught:
        try:
            yield messages
        except JitterkitError:
            raise
        except MemoryError as error:
            problem = "declares more pixels than fit in memory"
            raise FrameError(ErrorCode.OUT_OF_MEMORY, path, problem, "check its header") from error
        except Exception as error:  # the readers raise almost anything on a damaged file
            remedy = "the file seems damaged: copy it again or convert it"
            stumbled = "its values make no sense: " if isinstance(error, _STUMBLES) else ""
            problem = f"cannot be read ({stumbled}{one_line(error)})"
            raise FrameError(damage_code(error, path), path, problem, remedy) from error
    messages += dict.fromkeys(map(one_line, caught))


@contextmanager
def collected() -> Iterator[list[object]]:
    """Collect the warnings of this thread; what others warn of meanwhile says nothing of a file."""
    caught: list[object] = []
    reader = threading.get_ident()

    def collect(message: object, *_: object, **__: object) -> None:
        if threading.get_ident() == reader:
            caught.append(message)

    with _CATCHING, warnings.catch_warnings():
        warnings.simplefilter("always")
        warnings.showwarning = collect
        yield caught


@contextmanager
def overheard(log: logging.Logger) -> Iterator[list[str]]:
    """Collect what a library logs meanwhile, one line each, instead of printing it."""
    said: list[str] = []

    def note(record: logging.LogRecord) -> bool:
        said.append(one_line(record.getMessage()))
        return False

    log.addFilter(note)
    try:
        yield said
    finally:
        log.removeFilter(note)


def one_line(message: object) -> str:
    """The beginning of a message, on one line and without characters that a terminal would obey."""
    words = " ".join(str(message).split()) or type(message).__name__
    text = "".join(c if c.isprintable() else "?" for c in words)
    return text if len(text) <= 160 else text[:157] + "..."
