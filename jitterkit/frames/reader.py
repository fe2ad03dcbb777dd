"""Open any frame file.  :func:`read_frames` is the short way, :func:`open_frames` the one with handles."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from jitterkit.frames.backends import backend
from jitterkit.frames.files import sniff
from jitterkit.frames.frame import RawFrame
from jitterkit.frames.framefile import FrameFile

__all__ = ["open_frames", "read_frames"]


def open_frames(path: str | Path, *, hdu: int | None = None) -> FrameFile:
    """Open a FITS or TIFF file, told by its content, without reading pixels.

    Parameters
    ----------
    path : str or Path
        FITS (plain, gzipped, tile-compressed) or TIFF.
    hdu : int, optional
        The FITS HDU, from 0; by default the first that holds a two- or three-dimensional image.

    Returns
    -------
    file : FrameFile
        A context manager; ``file[i]`` reads frame i, ``len(file)`` counts them.

    Raises
    ------
    FrameError
        If the file cannot be used; the message says what it is and what to do.
    ConfigurationError
        If a TOML beside a TIFF has an unknown key or an unbelievable value.
    """
    path = Path(path)
    return backend(sniff(path)).open(path, hdu)


def read_frames(path: str | Path, *, hdu: int | None = None) -> Iterator[RawFrame]:
    """Read the frames of a file one after the other; the file is closed behind the last.

    Parameters and errors are those of :func:`open_frames`; the first error comes with the first frame.
    """
    with open_frames(path, hdu=hdu) as file:
        yield from file
