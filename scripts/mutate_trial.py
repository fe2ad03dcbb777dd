"""Try mutations, each in a copy of the tree, with the tests that pass without it.

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
    """Outcome of one mutation.

    Attributes
    ----------
    result : {"failed", "import", "timeout", "crash", "survived", "broken"}
        ``broken``: tests of the module fail even without the mutation, so they cannot judge it.
    by : str
        The test that caught the mutation, or that fails without it.
    seconds : float
        Duration of the runs with the mutation.
    """

    result: str
    by: str
    seconds: float

    @property
    def is_caught(self) -> bool:
        return self.result not in ("survived", "broken")


class _Baseline:
    """Runs of the tests without a mutation; each set of tests runs once."""

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
    """Try mutations in copies of a tree, and yield (number, outcome) as each one ends.

    Parameters
    ----------
    root : Path
        Root of the tree, which is not changed.
    mutations : mapping of int to Mutation
    jobs : int
        Number of copies in which tests run at the same time.
    timeout : float
        Seconds after which a mutation counts as caught; three times the duration without it, if that is
        longer.  A run without a mutation may take four times ``timeout``.
    wide : bool
        Also run the tests of the packages that depend on the module's package.

    Raises
    ------
    SystemExit
        If the tests would not import jitterkit from a copy.
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
    """Mutate a module of a copy inside a block, and delete its bytecode, which could count as current."""
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
