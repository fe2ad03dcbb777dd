"""Ledgers that are killed, locked out, damaged and starved of disk."""

import inspect
import multiprocessing
import os
import shutil
import signal
import sys
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from refusals import refused

from jitterkit.batch.store import STORE, Store
from jitterkit.errors import ConfigurationError, ErrorCode

CONFIGURATION = {"size": 5}
NIGHT = 250
"""Batches of a run that is killed and killed again."""


def batch_rows(batch):
    import math
    import random

    rng = random.Random(batch)
    return [
        {
            "file": f"{batch}.fits",
            "frame": position,
            "status": rng.choice(["ok", "ok", "no_star"]),
            "chi2_dof": rng.choice([rng.random(), math.nan]),
            "separation": rng.gauss(10, 1e-6),
            "separation_err": rng.random(),
        }
        for position in range(5)
    ]


def work(directory, batches, opened):
    """Go on with a run of some batches, each of which takes 2 ms."""
    import time
    from pathlib import Path

    from jitterkit.batch.ranking import wanted
    from jitterkit.batch.store import Store

    with Store.resume(Path(directory), {"size": 5}) as store:
        opened.send(True)
        for batch in sorted(set(range(batches)) - store.done()):
            time.sleep(0.002)
            rows = batch_rows(batch)
            positions = wanted(store.ranks(), batch, dict(enumerate(rows)))
            picture = bytes([batch % 256]) * 20_000
            store.add(batch, rows, dict.fromkeys(positions, picture))


def hold(directory, opened, leave):
    """Open a store, or say why not, and keep it until told to leave."""
    from pathlib import Path

    from jitterkit.batch.store import Store
    from jitterkit.errors import ConfigurationError

    try:
        with Store.resume(Path(directory), {"size": 5}):
            opened.send("mine")
            leave.recv()
    except ConfigurationError as error:
        opened.send(error.code.value)


def fill(directory, answer):
    """Enter batches until the file may not grow any more, and say what came of it."""
    import resource
    import signal
    from pathlib import Path

    from jitterkit.batch.store import Store
    from jitterkit.errors import ConfigurationError

    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, resource.getrlimit(resource.RLIMIT_FSIZE)[1]))
    with Store.resume(Path(directory), {"size": 5}) as store:
        batch = 0
        try:
            while True:
                store.add(batch, batch_rows(batch) * 20)
                batch += 1
        except ConfigurationError as error:
            answer.send((error.code, str(error), batch, sorted(store.done())))


@pytest.fixture(scope="module")
def context():
    """Processes forked from one that has the package loaded and runs no threads."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["jitterkit.batch.store"])
    return context


@pytest.fixture
def start(context):
    """Run a function above in a process of its own; whatever still runs at the end is killed."""
    begun = []

    def start(function, *arguments):
        source = "\n".join(map(inspect.getsource, (batch_rows, function)))
        call = f"{source}\n{function.__name__}(*arguments)"
        process = context.Process(target=exec, args=(call, {"arguments": arguments}))
        process.start()
        begun.append(process)
        return process

    yield start
    for process in begun:
        process.kill()
        process.join()


def test_twenty_kills_lose_nothing_and_do_nothing_twice(tmp_path, start, context):
    rng = np.random.default_rng(20)
    for _ in range(20):
        ours, theirs = context.Pipe()
        process = start(work, str(tmp_path), NIGHT, theirs)
        if rng.uniform() < 0.8:  # else it is killed as it starts, opens or recovers
            assert ours.poll(30)
        time.sleep(rng.uniform(0, 0.03))
        process.kill()
        process.join()
        assert process.exitcode == -signal.SIGKILL
    with Store.resume(tmp_path, CONFIGURATION) as store:
        assert 0 < len(store.done()) < NIGHT  # the kills were in mid-run
    (tmp_path / "whole").mkdir()
    ours, theirs = context.Pipe()
    for directory in (tmp_path, tmp_path / "whole"):
        process = start(work, str(directory), NIGHT, theirs)
        process.join()
        assert process.exitcode == 0
    with (
        Store.resume(tmp_path, CONFIGURATION) as killed,
        Store.resume(tmp_path / "whole", CONFIGURATION) as whole,
    ):
        expected = [one for batch in range(NIGHT) for one in batch_rows(batch)]
        assert repr(list(killed.rows())) == repr(list(whole.rows())) == repr(expected)
        assert repr(killed.pictures()) == repr(whole.pictures())
    assert sorted(path.name for path in tmp_path.iterdir()) == [STORE, "whole"]


def test_a_second_process_is_refused_until_the_first_is_gone(tmp_path, start, context):
    ours, theirs = context.Pipe()
    stay = context.Pipe()
    first = start(hold, str(tmp_path), theirs, stay[1])
    assert ours.recv() == "mine"
    began = time.monotonic()
    with refused(ErrorCode.LOCKED, tmp_path):
        Store.resume(tmp_path, CONFIGURATION)
    with refused(ErrorCode.LOCKED, tmp_path):
        Store.create(tmp_path, CONFIGURATION, overwrite=True)
    assert time.monotonic() - began < 20  # twice 0.75 s on an idle machine
    first.kill()
    first.join()
    with Store.resume(tmp_path, CONFIGURATION) as store:
        store.add(0, batch_rows(0))
        with refused(ErrorCode.LOCKED, tmp_path):  # nor twice in one process
            Store.resume(tmp_path, CONFIGURATION)


def test_of_runs_that_begin_together_one_goes_on(tmp_path, start, context):
    for n in range(3):
        (tmp_path / str(n)).mkdir()
        pipes, stays = [context.Pipe() for _ in range(3)], [context.Pipe() for _ in range(3)]
        processes = [
            start(hold, str(tmp_path / str(n)), pipe[1], stay[1])
            for pipe, stay in zip(pipes, stays, strict=True)
        ]
        answers = [pipe[0].recv() for pipe in pipes]
        assert answers.count("mine") == 1
        assert answers.count("locked") == 2
        stays[answers.index("mine")][0].send(True)
        for process in processes:
            process.join()


def test_what_was_entered_is_in_the_files_at_once(tmp_path):
    """What a machine that lost its power finds: a copy of the files as they were, with nothing closed."""
    (tmp_path / "copy").mkdir()
    with Store.create(tmp_path, CONFIGURATION) as store:
        assert store._file.connection.execute("PRAGMA journal_mode").fetchone() == ("wal",)
        assert store._file.connection.execute("PRAGMA synchronous").fetchone() == (
            2,
        )  # FULL: flushed at each commit
        store.add(0, batch_rows(0))
        for path in tmp_path.glob(f"{STORE}*"):
            shutil.copy(path, tmp_path / "copy")
        store.add(1, batch_rows(1))
    with Store.resume(tmp_path / "copy", CONFIGURATION) as copy:
        assert copy.done() == {0}
        assert repr(list(copy.rows())) == repr(batch_rows(0))


def test_a_full_disk_ends_the_run_in_a_sentence_and_keeps_what_was_done(tmp_path):
    with Store.create(tmp_path, CONFIGURATION) as store:
        store.add(0, batch_rows(0))
        pages = store._file.connection.execute("PRAGMA page_count").fetchone()[0]
        store._file.connection.execute(f"PRAGMA max_page_count = {pages + 2}")  # SQLite's own full disk
        for batch in range(1, 4):
            with suppress(ConfigurationError):
                store.add(batch, batch_rows(batch))
        with refused(ErrorCode.NOT_WRITABLE, tmp_path / STORE, "full"):  # SQLite's own word
            store.add(999, batch_rows(999) * 100)
        entered = store.done()
        assert 0 in entered
        store._file.connection.execute(f"PRAGMA max_page_count = {pages + 1000}")
        store.add(1000, batch_rows(1000))
    with Store.resume(tmp_path, CONFIGURATION) as again:
        assert again.done() == entered | {1000}
        assert len(list(again.rows())) == sum(len(batch_rows(batch)) for batch in again.done())


@pytest.mark.skipif(sys.platform == "win32", reason="no limit on the size of files")
def test_a_write_that_the_system_refuses_is_reported_and_keeps_what_was_done(tmp_path, start, context):
    ours, theirs = context.Pipe()
    start(fill, str(tmp_path), theirs).join()
    code, sentence, entered, done = ours.recv()
    assert code is ErrorCode.NOT_WRITABLE
    assert str(tmp_path / STORE) in sentence
    assert "disk I/O error" in sentence  # SQLite's own words
    assert entered > 3
    assert done == list(range(entered))
    with Store.resume(tmp_path, CONFIGURATION) as again:
        assert again.done() == set(range(entered))
        assert repr(list(again.rows())) == repr([one for n in range(entered) for one in batch_rows(n) * 20])


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="needs a directory that nobody can write to")
def test_a_directory_that_cannot_be_written_is_refused():
    with refused(ErrorCode.NOT_WRITABLE, f"/proc/self/{STORE}"):
        Store.create("/proc/self", CONFIGURATION)


def test_a_directory_that_is_not_there_is_refused(tmp_path):
    with refused(ErrorCode.NOT_WRITABLE, tmp_path / "gone" / STORE):
        Store.create(tmp_path / "gone", CONFIGURATION)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write to anything")
def test_a_ledger_that_is_read_only_is_refused(tmp_path):
    Store.create(tmp_path, CONFIGURATION).close()
    (tmp_path / STORE).chmod(0o444)
    with refused(ErrorCode.NOT_WRITABLE, tmp_path / STORE):
        Store.resume(tmp_path, CONFIGURATION)


def test_a_directory_in_the_ledgers_place_is_refused(tmp_path):
    (tmp_path / STORE).mkdir()
    with refused(ErrorCode.NOT_WRITABLE, tmp_path / STORE):
        Store.resume(tmp_path, CONFIGURATION)
