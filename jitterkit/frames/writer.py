"""Write frames.  Each file appears whole or not at all, and never in place of another unasked.

:func:`replacing` does that for every file that jitterkit writes, reports and tables too.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from uuid import uuid4

import numpy as np

from jitterkit.errors import ErrorCode, FrameError, JitterkitError
from jitterkit.frames.frame import Frame, RawFrame
from jitterkit.frames.sidecar import sidecar_path, sidecar_text


@contextmanager
def replacing(path: Path, overwrite: bool) -> Iterator[Path]:
    """Give a temporary name in the same directory, and rename it to ``path`` if the block succeeds.

    The temporary name ends like the final one, so that a library which looks at the ending sees the
    right one.  If the block fails, nothing is left behind and an existing file is untouched.

    Raises
    ------
    FrameError
        If ``path`` exists and ``overwrite`` is False, or the directory cannot be written to.
    """
    if path.exists() and not overwrite:
        remedy = "choose another name or allow it to be overwritten"
        raise FrameError(ErrorCode.EXISTS, path, "exists already", remedy)
    # not the whole name, as a longer one than that may be too long for the file system
    temporary = path.with_name(f".{uuid4().hex[:8]}.{path.name[-20:]}")
    try:
        yield temporary
        with temporary.open("rb") as written:
            os.fsync(written.fileno())  # a name must not survive a power cut that its content does not
        os.replace(temporary, path)
    except OSError as error:
        reason = error.strerror or str(error)
        problem = f"cannot be written ({reason})"
        remedy = "check the directory and its permissions"
        raise FrameError(ErrorCode.NOT_WRITABLE, path, problem, remedy) from error
    finally:
        temporary.unlink(missing_ok=True)


def write_fits(
    path: str | Path,
    frames: np.ndarray | RawFrame | Frame | Iterable[Any],
    *,
    header: Mapping[str, Any] | None = None,
    overwrite: bool = False,
) -> Path:
    """Write an image or a cube as FITS.

    Parameters
    ----------
    path : str or Path
        A name ending in ``.gz`` is gzipped, in ``.fz`` losslessly tile-compressed in HDU 1.
    frames : (ny, nx) or (n, ny, nx) array, RawFrame, Frame, or several of one kind
        uint16 is kept by BZERO, floats and signed integers as they are.  A RawFrame or Frame is
        written as its pixel values; its metadata is not: give what belongs in the header.
    header : mapping, optional
        Keyword to value or ``(value, comment)``.  Keywords longer than 8 characters become
        HIERARCH cards; a value that FITS cannot hold (None, NaN) leaves the card undefined.
    overwrite : bool
        Whether a file of that name may be replaced.

    Returns
    -------
    path : Path

    Raises
    ------
    FrameError
        If the file exists and ``overwrite`` is False, or cannot be written.
    JitterkitError
        If the array is not two- or three-dimensional and real.
    """
    from jitterkit.frames.fitsio import write

    array = _stack(frames)
    with replacing(Path(path), overwrite) as temporary:
        write(temporary, array, header or {})
    return Path(path)


def write_tiff(
    path: str | Path,
    frames: np.ndarray | RawFrame | Frame | Iterable[Any],
    *,
    metadata: Mapping[str, Any] | None = None,
    overwrite: bool = False,
) -> Path:
    """Write an image or a stack as TIFF, one page per frame, top row first as TIFF has it.

    Parameters
    ----------
    path, frames, overwrite
        As in :func:`write_fits`.
    metadata : mapping, optional
        Written as a TOML of the same stem beside the image, which :func:`open_frames` reads:
        exposure, gain, read_noise, saturation, bias, plate_scale, time, unit, and a table
        ``truth`` with anything in it that is not read back.

    Returns
    -------
    path : Path

    Raises
    ------
    FrameError
        If the file or its TOML exists and ``overwrite`` is False, or cannot be written.
    ConfigurationError
        If the metadata has an unknown key or an unbelievable value.
    JitterkitError
        If the array is not two- or three-dimensional and real.
    """
    from jitterkit.frames.tiff import write

    path, array = Path(path), _stack(frames)
    text = None if metadata is None else sidecar_text(metadata)
    with replacing(path, overwrite) as temporary:
        write(temporary, array)
        if text is not None:
            with replacing(sidecar_path(path), overwrite) as beside:
                beside.write_text(text, encoding="utf-8")
    return path


def _stack(frames: Any) -> np.ndarray:
    """Return one array of what was given, two- or three-dimensional."""
    if isinstance(frames, np.ndarray | RawFrame | Frame):
        array = _pixels(frames)
    else:
        array = np.stack([_pixels(frame) for frame in frames])
    if array.ndim not in (2, 3) or 0 in array.shape or array.dtype.kind not in "buif":
        code = ErrorCode.WRONG_SHAPE if array.dtype.kind in "buif" else ErrorCode.WRONG_TYPE
        problem = f"an array of shape {array.shape} and type {array.dtype} cannot be written as frames"
        raise JitterkitError(code, f"{problem}; give real numbers of shape (ny, nx) or (n, ny, nx).")
    return array.astype(np.uint8) if array.dtype.kind == "b" else array


def _pixels(frame: Any) -> np.ndarray:
    if isinstance(frame, RawFrame):
        return frame.data
    return frame.electrons if isinstance(frame, Frame) else np.asarray(frame)
