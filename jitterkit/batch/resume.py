"""Check that a resumed run is the run that was started: its settings, and the files that it has read.

Reach for :func:`refuse_difference` and :func:`recounted`: rows of two configurations, or of two contents of
a file, in one table would be worse than none.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jitterkit.batch.plan import Batch, plan_batches
from jitterkit.errors import ConfigurationError, ErrorCode, printable
from jitterkit.frames.files import files_beside
from jitterkit.frames.sidecar import FOLDER_FILE, sidecar_path

FILES = "files"
"""Key of a configuration under which the names of files stand, in order."""

VERSIONS = "versions"
"""Key of a configuration under which the versions of programs stand."""

_LONGEST = 80
"""Characters of a value that are worth reading in a sentence."""

_ABSENT = object()
_NOT_MADE: tuple[Any, ...] = (None, {}, _ABSENT)
"""What stands for a setting that is left alone, or that there was not when a run began."""


def refuse_difference(directory: Path, stored: Any, now: Any) -> None:
    """Compare two configurations and refuse the second if anything in it is different.

    Parameters
    ----------
    directory : Path
        Of the run.
    stored, now : dict
        As JSON gives them back: nested dicts and lists of text, numbers, booleans and None.

    Raises
    ------
    ConfigurationError
        It names the first difference.
    """
    if (difference := _first_difference(stored, now)) is None:
        return
    path, before, after = difference
    inside_files = path[0] == FILES and len(path) > 1
    if inside_files and (sentence := _come_or_gone(printable(directory), stored[FILES], now[FILES])):
        raise ConfigurationError(ErrorCode.CONFLICT, sentence)
    names = [f"[{key}]" if isinstance(key, int) else f".{key}" for key in path]
    name = printable("".join(names).removeprefix("."))
    if before is _ABSENT:
        how = f"without {name}, not with {name} {_short(after)}"
    elif after is _ABSENT:
        how = f"with {name} {_short(before)}, not without"
    else:
        how = f"with {name} {_short(before)}, not {_short(after)}"
    what = f"{printable(directory)} was started {how}"
    if path[0] == VERSIONS:
        problem = f"{what}, and the last digits need the same versions; install those"
        raise ConfigurationError(ErrorCode.CONFLICT, f"{problem}, or give another directory.")
    raise ConfigurationError(ErrorCode.CONFLICT, f"{what}; give the same, or another directory.")


def _first_difference(a: Any, b: Any, path: tuple = ()) -> tuple[tuple, Any, Any] | None:
    """Return the key path where two values first differ, and both values there; None if they are equal."""
    if isinstance(a, list) and isinstance(b, list):
        a, b = dict(enumerate(a)), dict(enumerate(b))
    if isinstance(a, dict) and isinstance(b, dict):
        pairs = ((key, a.get(key, _ABSENT), b.get(key, _ABSENT)) for key in dict.fromkeys([*a, *b]))
        found = (_first_difference(x, y, (*path, key)) for key, x, y in pairs)
        return next(filter(None, found), None)
    same = a == b or (a != a and b != b)  # NaN is NaN
    same = same or all(value in _NOT_MADE for value in (a, b))
    return None if same else (path, a, b)


def _come_or_gone(directory: str, stored: list[str], now: list[str]) -> str:
    """Say what to do about new files, or about missing ones; empty if there are both, or neither."""
    before, after = set(stored), set(now)
    new, gone = [name for name in now if name not in before], [name for name in stored if name not in after]
    if new and not gone:
        return (
            f"{directory} was started without {len(new)} of these files ({_some(new)}); process what is new "
            "into another directory, give --overwrite instead of --resume to start again with all, or let "
            "'jitterkit watch' follow a directory that grows."
        )
    if gone and not new:
        return (
            f"{directory} was started with {len(gone)} file{'s' * (len(gone) > 1)} more than these "
            f"({_some(gone)}); put back what is missing, or give another directory."
        )
    return ""


def _some(names: list[str]) -> str:
    return printable(names[0]) + " for one" * (len(names) > 1)


def _short(value: Any) -> str:
    text = printable(value if isinstance(value, str) and value else json.dumps(value))
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 3]}..."


Stamp = tuple[int, int]
"""Size [bytes] of a file and the time [ns] at which it was last written."""

_GRAINS = (1_000_000_000, 1_000, 100)
"""Times [ns] of which file systems keep whole multiples: HFS+ and ext3, many servers of NFS, those of SMB."""

_REMEDY = "put it back as it was, time and all, or give --overwrite instead of --resume to start again."


@dataclass(frozen=True)
class Counted:
    """Hold the stored count of a file's frames.

    Attributes
    ----------
    frames : int
    stamp : (int, int), optional
        Its size and time when it was counted; None if it could not be asked for them.
    """

    frames: int
    stamp: Stamp | None = None


def counted(path: Path, count: Callable[[Path], int]) -> Counted:
    """Count the frames of a file; what is written to it meanwhile makes its stamp one of the past."""
    stamp = _stamp(path)
    return Counted(count(path), stamp)


def recounted(
    files: Sequence[Path],
    known: Sequence[Counted],
    count: Callable[[Path], int],
    size: int,
    done: Collection[int],
) -> dict[int, Counted]:
    """Look at files again before a run goes on, and count those that are others now.

    Parameters
    ----------
    files : sequence of Path
        In the order of the plan.
    known : sequence of Counted
        Of as many of them as have been counted.
    count : callable
        Counts the frames of a file.
    size : int
        Frames in a batch.
    done : collection of int
        Numbers of batches.

    Returns
    -------
    changed : dict from int to Counted
        By place in the list, files that have changed and of which no frame has been looked at.

    Raises
    ------
    ConfigurationError
        If a file has changed of which frames were fitted, or showed the optics to frames that were; or if it
        has another number of frames now, so that batches which are done would mean other frames.

    Notes
    -----
    *Assumes* that a file of the same size and time is the same.  A time that a file system has since rounded
    to a coarser grain is the same time.  A file that is gone, or was not to be had when it was
    counted, is taken as it was counted: reading it tells what is wrong.

    *Fails when* a file is replaced by one of its size within the grain of the file system's clock, or with
    its time set back.
    """
    present = {index: stamp for index, path in enumerate(files[: len(known)]) if (stamp := _stamp(path))}
    changed = {index: now for index, now in present.items() if not _is_same(known[index].stamp or now, now)}
    if not changed:
        return {}
    frames = [one.frames for one in known]
    planned = _batches(files, frames, size, done)
    looked_at = {path for batch in planned for path, _ in (*batch.items, *batch.references)}
    if spoilt := [index for index in changed if files[index] in looked_at]:
        first = spoilt[0]
        was, stamp = known[first].stamp, changed[first]
        assert was is not None  # else it would not have changed
        how = (
            f"{was[0]} bytes then, {stamp[0]} now" if was[0] != stamp[0] else "it was written at another time"
        )
        others = f", as have {len(spoilt) - 1} more," if len(spoilt) > 1 else ""
        problem = f"{printable(files[first])} has changed{others} since frames of it were done ({how})"
        raise ConfigurationError(ErrorCode.CHANGED, f"{problem}; {_REMEDY}")
    recounted_files = {index: Counted(count(files[index]), stamp) for index, stamp in changed.items()}
    now = [recounted_files[index].frames if index in recounted_files else n for index, n in enumerate(frames)]
    if _batches(files, now, size, done) != planned:
        first = next(index for index in recounted_files if now[index] != frames[index])
        counts = f"was {frames[first]} and is {now[first]} now, and frames after those have been done"
        problem = f"The number of frames in {printable(files[first])} {counts}"
        raise ConfigurationError(ErrorCode.CHANGED, f"{problem}; {_REMEDY}")
    return recounted_files


def _stamp(path: Path) -> Stamp | None:
    """Return the size of a file with those beside it that are read too, and the latest of their times."""
    beside = [other for _, other in files_beside(path)]
    if path.suffix.lower() in (".tif", ".tiff"):
        beside += filter(Path.is_file, (sidecar_path(path), path.with_name(FOLDER_FILE)))
    try:
        known = [file.stat() for file in (path, *beside)]
    except OSError:
        return None
    return sum(status.st_size for status in known), max(status.st_mtime_ns for status in known)


def _is_same(then: Stamp, now: Stamp) -> bool:
    """Return whether sizes and times are equal, or one time is the other rounded to a grain."""
    a, b = then[1], now[1]
    rounded = any(abs(a - b) < grain and (a % grain == 0) != (b % grain == 0) for grain in _GRAINS)
    return then[0] == now[0] and (a == b or rounded)


def _batches(files: Sequence[Path], frames: Sequence[int], size: int, done: Collection[int]) -> list[Batch]:
    return [batch for batch in plan_batches(files[: len(frames)], frames, size) if batch.number in done]
