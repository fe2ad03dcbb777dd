"""From outcomes of frames to rows of the table, their stacked residual, and pictures of the worst.

Reach for :func:`recorder`, which makes what an executor calls, and :func:`duplicate_marker`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial

from jitterkit.batch import FrameProcessor, ProcessedFrame
from jitterkit.batch.executor import Outcome
from jitterkit.batch.plan import Batch
from jitterkit.batch.ranking import Rank, wanted
from jitterkit.frames.reader import Duplicates
from jitterkit.refit import FitResult
from jitterkit.report.pictures import pack_picture
from jitterkit.report.residual_stack import ResidualStack, stack_residuals, to_stack
from jitterkit.report.row import Row, make_row

_KEPT = ("file", "path", "time", "exposure", "seconds", "digest")
"""Columns that a duplicate keeps: none with a number that could be counted twice."""


@dataclass(frozen=True)
class Record:
    """A batch that is done, or a part of one, as the store keeps it.

    Attributes
    ----------
    batch : Batch
    rows : list of dict
        One for each of its frames, in order; one that could not be read, or not be used, has one too.
    pictures : dict from int to bytes
        What pictures are drawn from, of the frames that were worth one, by their position in ``rows``.
    stacks : dict from str to ResidualStack
        Residuals of the fitted frames, from :func:`~jitterkit.report.residual_stack.stack_residuals`.
    """

    batch: Batch
    rows: list[Row]
    pictures: dict[int, bytes]
    stacks: dict[str, ResidualStack] = field(default_factory=dict)


def recorder(
    processor: FrameProcessor, ranks: Sequence[Rank]
) -> Callable[[Batch, Sequence[Outcome]], Record]:
    """Return what makes records of outcomes; it can be sent to other processes.

    Parameters
    ----------
    processor : FrameProcessor
    ranks : sequence of Rank
        Of the frames that are kept for pictures: of better ones nothing is kept.  May change meanwhile.
    """
    return partial(_record, ranks, processor.instrument.shape, processor.plate_scale)


def _record(
    ranks: Sequence[Rank],
    shape: tuple[int, int],
    plate_scale: float,
    batch: Batch,
    outcomes: Sequence[Outcome],
) -> Record:
    frames = [
        one.result if isinstance(one.result, ProcessedFrame) else ProcessedFrame(None, one.result)
        for one in outcomes
    ]
    rows = [_row(one, done) for one, done in zip(outcomes, frames, strict=True)]
    drawable = {index: rows[index] for index, done in enumerate(frames) if done.frame is not None}
    pictures = {}
    for index in wanted(ranks, batch.number, drawable, batch.start):
        frame, result = frames[index].frame, frames[index].result
        assert frame is not None  # else it cannot be drawn
        pictures[index] = pack_picture(frame, result)
    usable = [(one.frame, one.result) for one in frames if one.frame is not None and one.result.status.usable]
    fitted = (to_stack(frame, result, plate_scale) for frame, result in usable)
    return Record(batch, rows, pictures, stack_residuals(fitted, shape))


def _row(one: Outcome, done: ProcessedFrame) -> Row:
    return make_row(
        done.result,
        one.path,
        one.index,
        metadata=one.metadata if done.frame is None else done.frame.metadata,
        flags=() if done.frame is None else done.frame.flags,
        pixel=done.pixel,
        pa=done.pa,
        digest=one.digest,
    )


def duplicate_marker() -> Callable[[Row], Row]:
    """Make a function that marks duplicates among rows.

    Every frame is fitted where it is read, whoever has its pixels too, so that a row depends on its batch
    alone; which rows are duplicates is decided where rows come together.

    Returns
    -------
    mark : callable
        To be called with the rows of a run one after the other.  Returns the row; for a fitted frame whose
        pixels an earlier fitted frame had, one with the status ``duplicate`` and no numbers of a fit.
    """
    return partial(_marked, Duplicates())


def _marked(known: Duplicates, row: Row) -> Row:
    if row["status"] != "ok":  # it counts nowhere, and its own status says more
        return row
    original = known.original(row["digest"], f"{row['path']} [{row['frame']}]")
    if not original:
        return row
    blank = make_row(FitResult.duplicate_of(original), row["path"], row["frame"])
    return blank | {name: row[name] for name in _KEPT}
