"""Try mutations: each in a copy of the tree, against the tests that pass without it.

Reach for :func:`try_all`.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue
from threading import Lock

from mutate_draw import Mutation
from mutate_tests import Run, check_import, copy_tree, run_tests, stages

__all__ = ["Outcome", "try_all"]


@dataclass(frozen=True)
class Outcome:
    """What became of a mutation.

    Attributes
    ----------
    result : {"failed", "import", "timeout", "crash", "survived", "broken"}
        ``broken``: tests of the module fail without the mutation, which says nothing of it.
    by : str
        The test that caught it or is broken.
    seconds : float
        Of the runs with the mutation.
    """

    result: str
    by: str
    seconds: float

    @property
    def is_caught(self) -> bool:
        return self.result not in ("survived", "broken")


class _Baseline:
    """Runs without a mutation, each set of tests once."""

    def __init__(self, limit: float) -> None:
        self._limit = limit
        self._runs: dict[tuple[str, ...], Future[Run]] = {}
        self._lock = Lock()

    def run(self, copy: Path, tests: tuple[str, ...]) -> Run:
        with self._lock:
            is_first = tests not in self._runs
            future = self._runs.setdefault(tests, Future())
        if is_first:
            try:
                future.set_result(run_tests(copy, tests, self._limit))
            except BaseException as error:
                future.set_exception(error)
        return future.result()


def try_all(
    root: Path, mutations: Mapping[int, Mutation], jobs: int, timeout: float, wide: bool
) -> Iterator[tuple[int, Outcome]]:
    """Try mutations in copies of a tree, and yield (number, outcome) as they are done.

    Parameters
    ----------
    root : Path
        Of the tree, which stays as it is.
    mutations : mapping of int to Mutation
    jobs : int
        Copies in which tests run at the same time.
    timeout : float
        Seconds after which a run counts as caught, or three times what it takes without a mutation if that is
        more.  Without a mutation a run may take four times as long.
    wide : bool
        Also run the tests of the packages that depend on the module's.

    Raises
    ------
    SystemExit
        If a copy would not be what the tests import.
    """
    baseline, copies = _Baseline(4 * timeout), SimpleQueue[Path]()

    def tried(mutation: Mutation) -> Outcome:
        copy = copies.get()
        try:
            return _try(copy, mutation, baseline, timeout, wide)
        finally:
            copies.put(copy)

    with tempfile.TemporaryDirectory(prefix="mutate-") as work, ThreadPoolExecutor(jobs) as pool:
        for i in range(jobs):
            copy_tree(root, Path(work) / str(i))
            check_import(Path(work) / str(i))
            copies.put(Path(work) / str(i))
        numbers = {pool.submit(tried, mutation): number for number, mutation in mutations.items()}
        try:
            for future in as_completed(numbers):
                yield numbers[future], future.result()
        finally:
            pool.shutdown(cancel_futures=True)


def _try(copy: Path, mutation: Mutation, baseline: _Baseline, timeout: float, wide: bool) -> Outcome:
    seconds = 0.0
    for tests in stages(copy, mutation.path, wide):
        before = baseline.run(copy, tests)
        if before.ended != "passed":
            return Outcome("broken", before.by or before.ended, seconds)
        with _mutated(copy, mutation):
            after = run_tests(copy, tests, max(timeout, 3 * before.seconds))
        seconds += after.seconds
        if after.ended != "passed":
            return Outcome(after.ended, after.by, seconds)
    return Outcome("survived", "", seconds)


@contextmanager
def _mutated(copy: Path, mutation: Mutation) -> Iterator[None]:
    """Mutate a module of a copy for a while, and drop its compiled code, which may pass for current."""
    path = copy / mutation.path
    content = path.read_bytes()
    try:
        path.write_bytes(mutation.of(content))
        _forget_compiled(path)
        yield
    finally:
        path.write_bytes(content)
        _forget_compiled(path)


def _forget_compiled(path: Path) -> None:
    for compiled in (path.parent / "__pycache__").glob(f"{path.stem}.*.pyc"):
        compiled.unlink()
