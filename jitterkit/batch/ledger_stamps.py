"""Whether the files of a run are those that it began with.

Reach for :func:`recounted`: before a run goes on it looks at every file again, and refuses those that would
put the rows of two contents into one table.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from jitterkit.batch.plan import Batch, plan_batches
from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.report.words import printable

__all__ = ["Counted", "counted", "recounted"]

Stamp = tuple[int, int]
"""Size [bytes] of a file and the time [ns] at which it was last written."""

_GRAINS = (1_000_000_000, 1_000, 100)
"""Times [ns] of which file systems keep whole multiples: HFS+ and ext3, many servers of NFS, those of SMB."""

_REMEDY = "put it back as it was, time and all, or give --overwrite instead of --resume to begin anew."


@dataclass(frozen=True)
class Counted:
    """What a run knows of a file.

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
    present = {place: stamp for place, path in enumerate(files[: len(known)]) if (stamp := _stamp(path))}
    changed = {place: now for place, now in present.items() if not _is_same(known[place].stamp, now)}
    if not changed:
        return {}
    frames = [one.frames for one in known]
    planned = _batches(files, frames, size, done)
    looked_at = {path for batch in planned for path, _ in (*batch.items, *batch.lead)}
    if spoilt := [place for place in changed if files[place] in looked_at]:
        raise ConfigurationError(ErrorCode.CHANGED, _spoilt(files, known, changed, spoilt))
    again = {place: Counted(count(files[place]), stamp) for place, stamp in changed.items()}
    shifted = [place for place, one in again.items() if one.frames != frames[place]]
    if _batches(files, _with(frames, again), size, done) != planned:
        first = shifted[0]
        raise ConfigurationError(
            ErrorCode.CHANGED,
            f"The number of frames in {printable(files[first])} was {frames[first]} and is "
            f"{again[first].frames} now, and frames after those have been done; {_REMEDY}",
        )
    return again


def _stamp(path: Path) -> Stamp | None:
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_size, status.st_mtime_ns


def _is_same(then: Stamp | None, now: Stamp) -> bool:
    return then is None or (then[0] == now[0] and _is_same_time(then[1], now[1]))


def _is_same_time(a: int, b: int) -> bool:
    """Whether two times are equal, or one is the other rounded to a grain."""
    return a == b or any(abs(a - b) < grain and (a % grain == 0) != (b % grain == 0) for grain in _GRAINS)


def _batches(files: Sequence[Path], frames: Sequence[int], size: int, done: Collection[int]) -> list[Batch]:
    return [batch for batch in plan_batches(files[: len(frames)], frames, size) if batch.number in done]


def _with(frames: Sequence[int], again: Mapping[int, Counted]) -> list[int]:
    return [again[place].frames if place in again else n for place, n in enumerate(frames)]


def _spoilt(
    files: Sequence[Path], known: Sequence[Counted], changed: Mapping[int, Stamp], spoilt: Sequence[int]
) -> str:
    first = spoilt[0]
    was, now = known[first].stamp, changed[first]
    assert was is not None  # else it would not have changed
    how = f"{was[0]} bytes then, {now[0]} now" if was[0] != now[0] else "it was written at another time"
    others = f", as have {len(spoilt) - 1} more," if len(spoilt) > 1 else ""
    return f"{printable(files[first])} has changed{others} since frames of it were done ({how}); {_REMEDY}"
