"""The stored results of a run, so that nothing is lost or processed twice.

Reach for :meth:`Store.create` to start a run and :meth:`Store.resume` to continue one.  The rows of a
batch or a part of one, what its pictures are drawn from, sums over frames and the fact that it was done enter
``ledger.sqlite`` together or not at all; once :meth:`Store.add` returns they survive a kill and the loss of
power.  Table, summary and report are made from the store, in the order of the plan, whoever did which batch
and when.

In the ``sqlite3`` shell, when no run has it open, the tables ``frames`` and ``run`` are for reading.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any, Self

from jitterkit.batch.plan import Batch
from jitterkit.batch.ranking import Rank, Row, rank, top
from jitterkit.batch.resume import refuse_difference
from jitterkit.batch.store_file import FileCounts, StoreFile, translate_errors, unwritable
from jitterkit.errors import ConfigurationError, ErrorCode, printable

STORE = "ledger.sqlite"
"""Its name in the directory of a run."""

_READABLE_COLUMNS = ("file", "frame", "status", "locus", "separation", "separation_err", "chi2_dof")
"""Columns of a row that stand in the table ``frames`` besides, for people."""


class Store(AbstractContextManager["Store"]):
    """The store of a run; a context manager that keeps every other process out while it is open.

    Threads may share it.

    Attributes
    ----------
    path : Path
        ``ledger.sqlite`` in the run's directory.
    counts : FileCounts
        How many frames each file of the run has.
    configuration : dict
        The configuration with which the run was started.
    notes : dict
        Further notes from the start of the run.

    Notes
    -----
    Rows come back exactly: floats to the last bit, NaN, infinities, integers of any size, and any text,
    undecodable file names among it.  A batch is one compressed JSON.  Of rows of 80 columns, 48 a batch,
    60,000 take 75 MB, enter at 11,000/s with a flush of the disk for each batch, and are read in 1.7 s.

    *Fails when* the file system lies about locks or about flushing, or when the process itself opens and
    closes the file by other means: POSIX then drops its lock.
    """

    def __init__(self, path: Path) -> None:
        self.path, self._file = path, StoreFile(path)
        self.counts = FileCounts(self._file)
        with self._closed_on_error():
            noted = dict(self._file.read("SELECT name, value FROM run"))
            with translate_errors(path):
                self.configuration: dict[str, Any] = json.loads(noted.get("configuration", "{}"))
                self.notes: dict[str, Any] = json.loads(noted.get("notes", "{}"))

    @classmethod
    def create(
        cls,
        directory: str | Path,
        configuration: Mapping[str, Any],
        notes: Mapping[str, Any] | None = None,
        *,
        overwrite: bool = False,
        results: Sequence[str] = (),
    ) -> Self:
        """Begin a run.

        Parameters
        ----------
        directory : str or Path
            Exists.
        configuration : mapping
            All that the rows depend on, as JSON knows it, the list of files, the size of a batch and the
            ``versions`` of programs among it: whoever resumes must come with the same.
        notes : mapping, optional
            What is only kept: the command line, the date.
        overwrite : bool
            Whether a run that is in the directory may be forgotten; its results, which would be taken for
            those of the new one, are removed then.
        results : sequence of str
            Names of the files that a run writes at its end.

        Raises
        ------
        ConfigurationError
            If there is a run and it may not be forgotten, another process is writing to it, or the
            directory cannot be written.
        """
        store = cls(Path(directory) / STORE)
        with store._closed_on_error():
            if store._has_run and not overwrite:
                problem = f"{printable(store.path)} holds a run already"
                remedy = "give --resume to continue it, --overwrite to start again, or another directory"
                raise ConfigurationError(ErrorCode.EXISTS, f"{problem}; {remedy}.")
            for name in results if overwrite else ():  # first: whatever kills it now, none outlive their run
                try:
                    (store.path.parent / name).unlink(missing_ok=True)
                except OSError as error:
                    raise unwritable(store.path.parent / name, error.strerror) from None
            store._start_run(configuration, notes or {})
        return store

    @classmethod
    def resume(
        cls,
        directory: str | Path,
        configuration: Mapping[str, Any],
        notes: Mapping[str, Any] | None = None,
        *,
        results: Sequence[str] = (),
    ) -> Self:
        """Go on with a run, or begin it if it was interrupted before it began.

        Parameters
        ----------
        directory, configuration, notes, results
            As for :meth:`create`; the notes of a run that was started stay as they were.

        Raises
        ------
        ConfigurationError
            If the configuration is not that of the run, there is none but results of one, the ledger is
            damaged, another process is writing to it, or the directory cannot be written.
        """
        path = Path(directory) / STORE
        if not path.exists():
            _refuse_results(path.parent, results)  # before there is an empty ledger beside them
        store = cls(path)
        with store._closed_on_error():
            if store._has_run:
                refuse_difference(path.parent, store.configuration, _as_json(configuration))
            else:
                _refuse_results(path.parent, results)
                store._start_run(configuration, notes or {})
        return store

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Let the file go; harmless when done twice."""
        self._file.close()

    def add(
        self,
        batch: int,
        rows: Sequence[Row],
        pictures: Mapping[int, bytes] | None = None,
        start: int = 0,
        stacks: Mapping[str, bytes] | None = None,
    ) -> None:
        """Enter a batch that is done, or a part of one.

        Parameters
        ----------
        batch : int
            Its number in the plan.
        rows : sequence of dict
            In order: text, integers, floats, booleans.
        pictures : mapping from int to bytes, optional
            By position in ``rows``, what pictures are drawn from, of those that :func:`wanted` named.  Only
            the worst of the run are kept, some tens.
        start : int
            Position of the first row in the batch.
        stacks : mapping from str to bytes, optional
            By name, sums over all that has been entered, this included; they replace those of these names.

        Raises
        ------
        ConfigurationError
            If the disk is full or fails; nothing is entered then.
        ValueError
            If one of the rows has been entered before.
        """
        # surrogatepass: the undecodable bytes of a file name.  Level 6 saves a sixth and takes twice as long.
        text = json.dumps(rows, ensure_ascii=False).encode("utf-8", "surrogatepass")
        packed, count = zlib.compress(text, 1), len(rows)
        shown = [
            (batch, start + i, *(_readable(row.get(name)) for name in _READABLE_COLUMNS))
            for i, row in enumerate(rows)
        ]
        overlapping = "SELECT 1 FROM batches WHERE batch = ? AND start < ? AND start + max(count, 1) > ?"
        with self._file.transaction() as execute:
            if execute(overlapping, (batch, start + max(count, 1), start)).fetchone():
                raise ValueError(f"Batch {batch} has been entered in {self.path} before.")
            execute("INSERT INTO batches VALUES (?, ?, ?, ?)", (batch, start, count, packed))
            for values in shown:
                execute("INSERT INTO frames VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)", values)
            for index, data in (pictures or {}).items():
                usable, order, *position = rank(rows[index], batch, start + index)
                execute("INSERT INTO pictures VALUES (?, ?, ?, ?, ?)", (*position, usable, -order, data))
            for name, data in (stacks or {}).items():
                execute("INSERT OR REPLACE INTO stacks VALUES (?, ?)", (name, zlib.compress(data, 1)))
            ranks = self.ranks() if pictures else []
            for _, _, *position in set(ranks) - set(top(ranks)):
                execute("DELETE FROM pictures WHERE batch = ? AND place = ?", position)

    def done(self) -> frozenset[int]:
        """Return the numbers of the batches of which anything has been entered."""
        return frozenset(batch for (batch,) in self._file.read("SELECT batch FROM batches"))

    def missing(self, batches: Iterable[Batch]) -> Iterator[Batch]:
        """Yield what has not been entered of planned batches, whole batches or parts of them."""
        kept: dict[int, list[tuple[int, int]]] = {}
        for number, start, count in self._file.read("SELECT batch, start, count FROM batches"):
            kept.setdefault(number, []).append((start, start + count))
        for batch in batches:
            begin, size = 0, len(batch.items)
            for start, end in [*sorted(kept.get(batch.number, ())), (size, size)]:
                if start > begin:
                    yield batch.part(begin, start)
                begin = max(begin, end)

    def rows(self) -> Iterator[Row]:
        """Yield all rows in the order of the plan, one batch in memory at a time."""
        for batch, start in self._file.read("SELECT batch, start FROM batches ORDER BY batch, start"):
            yield from self._rows_of(batch, start)

    def _rows_of(self, batch: int, start: int) -> list[Row]:
        with translate_errors(self.path):
            query = "SELECT rows FROM batches WHERE batch = ? AND start = ?"
            packed = self._file.read(query, (batch, start))[0][0]
            return json.loads(zlib.decompress(packed).decode("utf-8", "surrogatepass"))

    def ranks(self) -> list[Rank]:
        """Return the ranks of the frames of which data for a picture are kept, for :func:`wanted`."""
        ranks = self._file.read("SELECT usable, misfit, batch, place FROM pictures")
        return [(bool(usable), -misfit, batch, index) for usable, misfit, batch, index in ranks]

    def pictures(self) -> list[tuple[Row, bytes]]:
        """Return rows of the worst frames, with what their pictures are drawn from, in order of the plan."""
        query = """SELECT batch, start, place, data FROM pictures JOIN batches USING (batch)
            WHERE place >= start AND place < start + count ORDER BY batch, place"""
        found = self._file.read(query)
        return [(self._rows_of(batch, start)[index - start], data) for batch, start, index, data in found]

    def stacks(self) -> dict[str, bytes]:
        """Return the latest sums of each name."""
        with translate_errors(self.path):
            found = self._file.read("SELECT name, data FROM stacks")
            return {name: zlib.decompress(packed) for name, packed in found}

    @property
    def _has_run(self) -> bool:
        return bool(self._file.read("SELECT 1 FROM run WHERE name = 'configuration'"))

    def _start_run(self, configuration: Mapping[str, Any], notes: Mapping[str, Any]) -> None:
        self.configuration, self.notes = _as_json(configuration), _as_json(notes)
        with self._file.transaction() as execute:
            for table in ("run", "files", "batches", "frames", "pictures", "stacks"):
                execute(f"DELETE FROM {table}")
            for name, value in (("configuration", self.configuration), ("notes", self.notes)):
                execute("INSERT INTO run VALUES (?, ?)", (name, json.dumps(value, indent=1)))

    @contextmanager
    def _closed_on_error(self) -> Iterator[None]:
        try:
            yield
        except BaseException:
            self.close()
            raise


def _refuse_results(directory: Path, results: Iterable[str]) -> None:
    """Raise if a directory has results of a run but no ledger of it."""
    if present := [name for name in results if (directory / name).exists()]:
        problem = f"{printable(directory)} holds {present[0]} but no ledger of a run to continue"
        remedy = "give --overwrite instead of --resume to replace it, or another directory"
        raise ConfigurationError(ErrorCode.EXISTS, f"{problem}; {remedy}.")


def _as_json(value: Mapping[str, Any]) -> dict[str, Any]:
    return json.loads(json.dumps(value))


def _readable(value: Any) -> Any:
    """Return a value as SQLite can hold it, near enough for the eye."""
    if isinstance(value, str):
        return value.encode("utf-8", "backslashreplace").decode()
    return None if isinstance(value, int) and value.bit_length() > 63 else value
