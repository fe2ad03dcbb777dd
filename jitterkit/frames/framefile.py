"""A file of frames, opened: what every format offers, and how its troubles become sentences.

A format is one module with a class derived from :class:`FrameFile`; it implements ``_read`` and
``close`` and sets the attributes.  The rest of the package sees only this.
"""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Self

import numpy as np

from jitterkit.errors import FrameError, JitterkitError
from jitterkit.frames.frame import RawFrame
from jitterkit.frames.metadata import Metadata

__all__ = ["FrameFile", "translated"]


class FrameFile(ABC):
    """The frames of one file, read one at a time when they are asked for.

    Use it as a context manager; ``len(file)``, ``file[i]`` and iteration give the frames.

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
        self.path = path
        self.shape: tuple[int, int] = (0, 0)
        self.dtype = np.dtype(float)
        self.hdu: int | None = None
        self.metadata = Metadata()
        self._count = 0

    @abstractmethod
    def _read(self, index: int) -> tuple[np.ndarray, np.ndarray, Metadata]:
        """Return the pixels, the mask and the metadata of a frame; any exception is translated."""

    @abstractmethod
    def close(self) -> None:
        """Give the file back; harmless when done twice."""

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, index: int) -> RawFrame:
        """Read one frame; negative indices count from the end.

        Raises
        ------
        IndexError
            If there is no such frame.
        FrameError
            If it cannot be read.
        """
        place = range(self._count)[index]
        with translated(self.path) as caught:
            data, mask, metadata = self._read(place)
        metadata = metadata.warn(*caught)
        return RawFrame(data, mask, metadata, self.path, place, self.hdu, several=self._count > 1)

    def __iter__(self) -> Iterator[RawFrame]:
        return (self[index] for index in range(self._count))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def describe(self) -> list[tuple[str, str, str, str]]:
        """Return ``(name, value, unit, source)`` rows: the file first, then the metadata."""
        ny, nx = self.shape
        where = "content" if self.hdu is None else f"HDU {self.hdu}"
        file = [
            ("format", self.kind, "", "content"),
            ("frames", str(self._count), "", where),
            ("size", f"{nx} x {ny}", "pixel", where),
            ("stored as", str(self.dtype), "", where),
        ]
        return file + self.metadata.rows()


@contextmanager
def translated(path: Path) -> Iterator[list[str]]:
    """Turn whatever a reading library raises into FrameError, and collect what it warns about.

    Yields
    ------
    caught : list of str
        Filled with the warnings, one line each and each once, when the block ends.
    """
    messages: list[str] = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            yield messages
        except JitterkitError:
            raise
        except MemoryError as error:
            raise FrameError(path, "declares more pixels than fit in memory", "check its header") from error
        except Exception as error:  # the readers raise almost anything on a damaged file
            remedy = "the file seems damaged: copy it again or convert it"
            raise FrameError(path, f"cannot be read ({_one_line(error)})", remedy) from error
    messages += dict.fromkeys(_one_line(w.message) for w in caught)


def _one_line(message: object) -> str:
    text = " ".join(str(message).split()) or type(message).__name__
    return text if len(text) <= 160 else text[:157] + "..."
