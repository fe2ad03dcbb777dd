"""What a user's commands would read of a file, and what must not come of it.

Reach for :func:`ended`.  The readers are imported late: a fuzzer that watches their coverage comes first.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from jitterkit.errors import ErrorCode, FrameError

__all__ = ["REFUSALS", "FindingError", "ended", "examine"]

#: Codes that a file may be refused with because of its contents.
REFUSALS = frozenset(
    {
        ErrorCode.UNKNOWN_FORMAT,
        ErrorCode.DAMAGED,
        ErrorCode.TRUNCATED,
        ErrorCode.NO_IMAGE,
        ErrorCode.COLOUR,
        ErrorCode.UNSUPPORTED_ENCODING,
        ErrorCode.TOO_LARGE,
        ErrorCode.MISSING_PACKAGE,
    }
)
#: Codes that a detector refuses a frame with, of a file that is whole.
UNCONVERTED = frozenset({ErrorCode.UNKNOWN_UNIT, ErrorCode.MISSING_VALUE})
MOST_FRAMES, MOST_PIXELS = 20, 1 << 22  # of a file that are read, and of a frame that is calibrated


def ended(path: Path) -> str:
    """:func:`examine`, with what must not be as a finding."""
    try:
        return examine(path)
    except Exception as error:
        words = str(error).replace(str(path), "PATH")[:300]
        return f"finding: {type(error).__name__}: {words} ({_where(error)})"


def _where(error: BaseException) -> str:
    trace, position = error.__traceback__, ""
    while trace is not None:
        position = f"{Path(trace.tb_frame.f_code.co_filename).name}:{trace.tb_lineno}"
        trace = trace.tb_next
    return position


class FindingError(Exception):
    """What must not happen, and happened."""


def examine(path: Path) -> str:
    """Read everything of a file; return how it ended, or raise what must not be.

    Returns
    -------
    outcome : str
        ``"read"``, or ``"refused: "`` with the code and the message, without the parts specific to a file.
    """
    from jitterkit.frames import is_whole

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        refusal = _refusal(_read_all, path)
        if refusal is not None and not refusal.startswith(tuple(UNCONVERTED)) and is_whole(path):
            raise FindingError(f"is_whole says yes to what is refused: {refusal}")
        if _is_fits(path):
            from jitterkit.frames.fits import read_image, read_images

            for read in (read_image, read_images):
                _refusal(read, path)
    return "read" if refusal is None else f"refused: {refusal}"


def _refusal(read: Callable[[Path], Any], path: Path) -> str | None:
    """Return the code and the kind of message with which a reader refuses a file, or None."""
    try:
        read(path)
    except FrameError as error:
        if error.code not in REFUSALS | UNCONVERTED:
            raise FindingError(f"a code not about a file's contents: {error.code}, {error}") from error
        return f"{error.code}: {_kind(path, str(error))}"
    return None


def _read_all(path: Path) -> None:
    from jitterkit.detectors import Detector
    from jitterkit.frames import open_frames

    with open_frames(path) as file:
        rows = file.describe()
        if not all(isinstance(cell, str) for row in rows for cell in row):
            raise FindingError("the description is not text")
        count = len(file)
        for index in sorted({*range(min(count, MOST_FRAMES)), count - 1}):  # a bomb may hold a million
            frame = file[index]
            _insist_on_a_frame(frame, file.shape if index == 0 else frame.shape)
            if frame.data.size <= MOST_PIXELS:
                _insist_on_electrons(Detector().calibrate(frame))


def _insist_on_a_frame(frame: Any, shape: tuple[int, int]) -> None:
    if frame.data.shape != shape or frame.mask.shape != shape:
        raise FindingError(f"a frame of shape {frame.data.shape} where {shape} was announced")
    if not np.isfinite(frame.data).all():
        raise FindingError("pixels that are not finite")
    if not all(text and text.isprintable() for text in frame.metadata.warnings):
        raise FindingError("a warning that is not one line of text")


def _insist_on_electrons(frame: Any) -> None:
    if not np.isfinite(frame.electrons).all() or not np.isfinite(frame.variance[~frame.mask]).all():
        raise FindingError("electrons or a variance that is not finite")


def _kind(path: Path, sentence: str) -> str:
    """What all sentences of one kind have in common."""
    if not re.fullmatch(r"\S.*: \S.*; \S.*\.", sentence) or not sentence.startswith(f"{path}: "):
        raise FindingError(f"not one sentence that names the file: {sentence!r}")
    if not sentence.isprintable() or len(sentence) > 700:
        raise FindingError(f"a sentence of {len(sentence)} characters, or with odd ones: {sentence!r}")
    problem = sentence[len(str(path)) + 2 :].split("; ")[0]
    problem = re.sub(r"\(.*\)?", "(...)", re.sub(r"""["'].*["']""", "'...'", problem))
    return re.sub(r"\d+( x \d+)*", "N", problem)[:90]


def _is_fits(path: Path) -> bool:
    return ".fits" in path.name or path.name.endswith(".fz")
