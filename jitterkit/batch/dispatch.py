"""Parts of a run handed to workers, and what is done about those that end with their worker."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError
from dataclasses import replace
from pathlib import Path
from typing import Any

from jitterkit.batch.equipment import Part, distributed, fit
from jitterkit.batch.ledger_worst import Rank
from jitterkit.batch.plan import Batch
from jitterkit.batch.stream import Done
from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.refit import FitResult, Status
from jitterkit.report.pictures import FrameReport
from jitterkit.report.row import Row, make_row

__all__ = ["Dispatch", "threads_of"]

_HOPELESS = 8
"""Parts that killed their workers, with none done, after which it is no frame's fault."""

_KILLED = FitResult(
    Status.FAILED,
    f"{Status.FAILED.value}: it killed the process that fitted it, and again when it was alone there.",
    code=ErrorCode.WORKER_LOST,
)


def threads_of(client: Any) -> int:
    """Threads of all workers that there are at this moment; one if there is none."""
    return max(1, sum(client.nthreads().values()))


class Dispatch:
    """Hands parts to workers and sees to what becomes of them."""

    def __init__(self, client: Any, name: str, ranks: Callable[[], Iterable[Rank]]) -> None:
        self._client, self._name, self._ranks = client, name, ranks
        self._done = self._killed = 0

    def all(self, parts: Iterable[Part]) -> Iterator[Done]:
        """Parts; then, of those that killed, the batches; then, of those, the frames."""
        killed: list[Batch] = []
        yield from self._each(parts, killed)
        again, killed = killed, []
        yield from self._each(((batch,) for batch in again), killed)
        for batch in killed:
            yield self._frame_by_frame(batch)

    def _each(self, parts: Iterable[Part], killed: list[Batch]) -> Iterator[Done]:
        """Keep every thread at work, with no part waiting at a worker, which might be blamed for its end."""
        parts, going = iter(parts), distributed.as_completed()
        sent: dict[Any, Part] = {}

        def send() -> None:
            for _ in range(len(sent), threads_of(self._client)):
                if (part := next(parts, None)) is None:
                    return
                future = self._submit(part)
                sent[future] = part
                going.add(future)

        send()
        for future in going:
            part, finished = sent.pop(future), self._result(future)
            send()
            if finished is None:
                killed += part
            else:
                yield from finished

    def _submit(self, part: Part) -> Any:
        return self._client.submit(fit, self._name, part, tuple(self._ranks()), pure=False)

    def _result(self, future: Any) -> list[Done] | None:
        """What came of a part; None if it killed its worker."""
        try:
            finished = future.result()
        except distributed.KilledWorker:
            self._killed += 1
            if self._killed >= _HOPELESS and not self._done:
                raise ConfigurationError(
                    ErrorCode.WORKER_LOST,
                    f"Workers died {self._killed} times and none has finished anything; see that there is "
                    "memory for them (1 GB each), or start fewer.",
                ) from None
            return None
        except (distributed.scheduler.NoValidWorkerError, distributed.scheduler.NoWorkerError):
            raise ConfigurationError(
                ErrorCode.WORKER_LOST, "No worker is left; see why they end, and go on with --resume."
            ) from None
        except CancelledError:
            raise ConfigurationError(
                ErrorCode.WORKER_LOST, "The scheduler is gone; see why it ended, and go on with --resume."
            ) from None
        self._done += 1
        return finished

    def _alone(self, batch: Batch) -> Done | None:
        finished = self._result(self._submit((batch,)))
        return None if finished is None else finished[0]

    def _frame_by_frame(self, batch: Batch) -> Done:
        """A batch that killed: each frame is tried alone, with nothing else at any worker."""
        rows: list[Row] = []
        pictures: dict[int, FrameReport] = {}
        lead = self._sound(batch)
        for place, item in enumerate(batch.items):
            done = self._alone(Batch(batch.number, (item,), lead))
            rows.append(make_row(_KILLED, *item) if done is None else done.rows[0])
            if done is not None and done.pictures:
                pictures[place] = done.pictures[0]
        return Done(batch, rows, pictures)

    def _sound(self, batch: Batch) -> tuple[tuple[Path, int], ...]:
        """The lead, without those that kill whoever looks at them."""
        if self._alone(replace(batch, items=())) is not None:
            return batch.lead
        return tuple(item for item in batch.lead if self._alone(Batch(batch.number, (item,))) is not None)
