"""Find the files that are frames, by their content and not by their names.

:func:`find_files` expands what a user typed; :func:`sniff` says what a file is, or why it is not a
frame.  Refusals that FITS and TIFF share are here too, with the limits of what a file may claim to hold: a
header of a few bytes can declare terabytes, and a compressed file can unpack to them.
"""

from __future__ import annotations

import contextlib
import errno
import gzip
import os
import re
import zlib
from collections.abc import Iterable
from pathlib import Path
from typing import BinaryIO

from jitterkit.errors import ErrorCode, FrameError, reading_code

#: What is looked for in a directory, in lower case.
EXTENSIONS = (".fits", ".fit", ".fts", ".fits.gz", ".fit.gz", ".fits.fz", ".fz", ".tif", ".tiff")

#: How a gzip begins.
GZIP = b"\x1f\x8b"
TIFF = (b"II*\x00", b"MM\x00*", b"II+\x00", b"MM\x00+")
ASDF = b"#ASDF"
#: How files begin that people hand in by mistake, and what to call them.
OTHERS = {
    b"\x89PNG": "a PNG image", b"\xff\xd8\xff": "a JPEG image", b"GIF8": "a GIF image", b"BM": "a BMP image",
    b"%PDF": "a PDF document", b"PK\x03\x04": "a ZIP archive", b"\x89HDF": "an HDF5 file",
    b"\x93NUMPY": "a NumPy array file", b"BZh": "a bzip2 archive", b"\xfd7zXZ": "an xz archive",
    b"LUCAM-RECORDER": "a SER video", b"RIFF": "an AVI video", b"XISF0100": "an XISF image",
    ASDF: "an ASDF file, as Roman's are",
    b"<!DOCTYPE": "a web page", b"<html": "a web page",
}  # fmt: skip
REMEDY = "give a FITS or TIFF file"
ASDF_REMEDY = "write each image (Roman: ['roman']['data'] of asdf.open) to FITS, with EXPTIME and BUNIT"

_NOAO = re.compile(r"(?<=_)(oo|op|os)i(?=[_.])")
"""In the name of an image of the NOAO (NOIRLab) pipelines."""

_NOAO_ROLES = {"quality": "d", "weight": "w"}
"""Letters of the files beside it."""

#: Errors of the operating system that arise when a file points to an impossible position.
_MISLED = (errno.EINVAL, errno.EOVERFLOW)


def find_files(paths: Iterable[str | Path]) -> list[Path]:
    """Expand files and directories to the files that may hold frames.

    Parameters
    ----------
    paths : iterable of str or Path
        A file is taken as it is; a directory stands for its own files (not those of its
        subdirectories) with one of :data:`EXTENSIONS`, sorted by name, hidden ones left out.

    Returns
    -------
    files : list of Path
        In the order given, each once; without the quality and weight files of the NOAO pipelines whose image
        is among them.

    Raises
    ------
    FrameError
        If a path does not exist, or a directory holds no such file or cannot be listed.
    """
    found: dict[Path, None] = {}
    for path in map(Path, paths):
        found.update(dict.fromkeys(_expand(path)))
    beside = {file for path in found for _, file in files_beside(path)}
    return [path for path in found if path not in beside]


def files_beside(path: Path) -> list[tuple[str, Path]]:
    """Return the files beside an image of the NOAO pipelines that belong to it.

    Parameters
    ----------
    path : Path
        Its name has ``_ooi_`` (``_opi_``, ``_osi_``), theirs has ``_ood_`` and ``_oow_``.

    Returns
    -------
    files : list of (str, Path)
        ``"quality"`` and ``"weight"``, where there are such files.
    """
    names = {role: _NOAO.sub(rf"\g<1>{letter}", path.name) for role, letter in _NOAO_ROLES.items()}
    files = {role: path.with_name(name) for role, name in names.items() if name != path.name}
    return [(role, file) for role, file in files.items() if file.is_file()]


def _expand(path: Path) -> list[Path]:
    if not path.exists():
        raise FrameError(ErrorCode.NOT_FOUND, path, "does not exist", "check the name")
    if not path.is_dir():
        return [path]
    try:
        files = sorted(filter(may_be_frames, path.iterdir()))
    except OSError as error:
        problem = f"cannot be listed ({error.strerror})"
        raise FrameError(damage_code(error, path), path, problem, "check its permissions") from error
    if not files:
        problem, remedy = "is a directory without FITS or TIFF files", f"{REMEDY}, or another directory"
        if any(other.suffix.lower() == ".asdf" for other in path.iterdir()):
            problem, remedy = f"{problem}, but with ASDF files", ASDF_REMEDY
        raise FrameError(ErrorCode.NO_IMAGE, path, problem, remedy)
    return files


def require_directory(directory: Path) -> None:
    """Raise FrameError unless a path is a directory, to be watched for frames."""
    if not directory.is_dir():
        code = ErrorCode.NOT_READABLE if directory.exists() else ErrorCode.NOT_FOUND
        raise FrameError(code, directory, "is not a directory", "give the one into which the camera writes")


def may_be_frames(entry: Path | os.DirEntry[str]) -> bool:
    """Return whether an entry of a directory is a file with one of :data:`EXTENSIONS`, and not hidden."""
    name = entry.name.lower()
    return name.endswith(EXTENSIONS) and not name.startswith(".") and entry.is_file()


def sniff(path: Path) -> str:
    """Tell the format of a file by its first bytes.

    Returns
    -------
    kind : {"FITS", "TIFF"}
        A gzipped FITS is ``"FITS"``.

    Raises
    ------
    FrameError
        If the file is missing, a directory, unreadable, empty, or something else; the message says
        what it is.
    """
    if not path.exists():
        raise FrameError(ErrorCode.NOT_FOUND, path, "does not exist", "check the name")
    if path.is_dir():
        raise FrameError(ErrorCode.NOT_READABLE, path, "is a directory", "name a file in it")
    if not path.is_file():
        raise FrameError(ErrorCode.NOT_READABLE, path, "is not a regular file", REMEDY)
    try:
        with open_bytes(path) as handle:
            start = handle.read(256)
    except (OSError, EOFError, zlib.error) as error:
        reason = getattr(error, "strerror", None) or str(error)
        problem, remedy = f"cannot be read ({reason})", "check the file and its permissions"
        raise FrameError(damage_code(error, path), path, problem, remedy) from error
    if not start:
        raise FrameError(ErrorCode.TRUNCATED, path, "is empty (0 bytes)", "copy it again from where it came")
    if start.startswith(b"SIMPLE"):
        return "FITS"
    if start.startswith(TIFF):
        return "TIFF"
    problem = f"is {_describe(start)}, not a FITS or TIFF file"
    remedy = ASDF_REMEDY if start.startswith(ASDF) else REMEDY
    raise FrameError(ErrorCode.UNKNOWN_FORMAT, path, problem, remedy)


def open_bytes(path: Path) -> BinaryIO:
    """Open a file for its bytes, unzipped where it is gzipped."""
    handle = path.open("rb")
    if not handle.peek(len(GZIP)).startswith(GZIP):
        return handle
    handle.close()
    return gzip.open(path)  # type: ignore[return-value]


def damage_code(error: Exception, path: Path) -> ErrorCode:
    """Return the code of an exception that Python or a library raised while a file was read.

    Parameters
    ----------
    error : Exception
        An OSError without ``errno`` comes from a library that could not interpret the contents.
    path : Path
        The file.  An EOFError means that a gzipped file is truncated, or that a compressed part of another
        file is damaged.
    """
    if isinstance(error, OSError) and error.errno is not None and error.errno not in _MISLED:
        return reading_code(error)
    if isinstance(error, NotImplementedError):
        return ErrorCode.UNSUPPORTED_ENCODING
    with contextlib.suppress(OSError), path.open("rb") as handle:
        if isinstance(error, EOFError) and handle.read(2) == GZIP:
            return ErrorCode.TRUNCATED
    return ErrorCode.DAMAGED


def _describe(start: bytes) -> str:
    for magic, words in OTHERS.items():
        if start.lower().startswith(magic.lower()):
            return words
    try:
        start.decode("utf-8")
        cut = len(start)
    except UnicodeDecodeError as error:
        cut = error.start  # a character may be cut in half by the limit
    if re.fullmatch(rb"[\t\n\r\x20-\x7e\x80-\xff]+", start) and cut > len(start) - 4:
        line = start.decode("utf-8", "replace").strip().splitlines() or [""]
        return f"a text file (it begins {line[0][:40]!r})"
    return f"of unknown kind (it begins with the bytes {start[:8].hex(' ')})"


#: A frame of more pixels (16384 x 16384) would take more than 2 GB as float64: no detector has as many.
MOST_PIXELS = 1 << 28
#: Packed files are believed up to so many bytes and pixels (an 8192 x 8192 frame, 0.5 GB as float64) ...
SMALL = 1 << 26
#: ... and beyond that up to so many times their size: noise does not pack better than 10 to 1.
LIKELY_PACKING = 20


def damaged(path: Path, problem: str) -> FrameError:
    """Return the exception for a file that contradicts itself."""
    remedy = "the file is damaged: copy it again or convert it"
    return FrameError(ErrorCode.DAMAGED, path, problem, remedy)


def truncated(path: Path, problem: str) -> FrameError:
    """Return the exception for a file that ends early."""
    return FrameError(ErrorCode.TRUNCATED, path, problem, "it is truncated: copy it again")


def in_colour(path: Path, channels: int, names: str) -> FrameError:
    """Return the exception for an image with several channels."""
    remedy = "it is a colour image: convert it to one channel"
    return FrameError(ErrorCode.COLOUR, path, f"has {channels} channels ({names})", remedy)


def refuse_giant(path: Path, where: str, nx: int, ny: int) -> None:
    """Raise FrameError for a frame that is larger than any detector's.

    Parameters
    ----------
    path : Path
        The file.
    where : str
        The part of it that says so: ``"HDU 1"``.
    nx, ny : int
        Columns and rows declared.
    """
    if nx * ny > MOST_PIXELS:
        problem = f"{where} declares a frame of {nx} x {ny} pixels, more than any detector has"
        raise FrameError(ErrorCode.TOO_LARGE, path, problem, "cut it into parts")


def unpacks_believably(declared: int, pixels: int, stored: int) -> bool:
    """Tell whether a compressed image may be what it says.

    Parameters
    ----------
    declared : int
        Bytes it is to unpack to.
    pixels : int
        Of one frame.
    stored : int
        Bytes it takes.
    """
    return max(declared, pixels) <= max(SMALL, LIKELY_PACKING * stored)
