"""Batches processed as a run does it, a record for each."""

from functools import reduce

from jitterkit.batch.executor import execute
from jitterkit.report.residual_stack import join_stacks
from jitterkit.run.rows import Record, recorder


def process_batches(batches, processor, *, ranks=(), executor=execute, **options):
    """Yield a record of every batch in order: parts of one that took long, in whatever order, are joined."""
    records = {}
    for one in executor(list(batches), processor, recorder(processor, list(ranks)), **options):
        records.setdefault(one.batch.number, []).append(one)
    for _, parts in sorted(records.items()):
        parts.sort(key=lambda part: part.batch.start)
        begun = [part.batch.start - parts[0].batch.start for part in parts]
        rows = [row for part in parts for row in part.rows]
        pictures = {
            start + position: packed
            for start, part in zip(begun, parts, strict=True)
            for position, packed in part.pictures.items()
        }
        stacks = reduce(join_stacks, [part.stacks for part in parts])
        yield Record(parts[0].batch, rows, pictures, stacks)
