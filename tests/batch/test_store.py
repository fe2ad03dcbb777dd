"""Ledgers give back what they got, to the last bit and in the order of the plan."""

import math
import os
import re
import sqlite3
import struct
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from refusals import refused

from jitterkit.batch.store import STORE, Store
from jitterkit.errors import ErrorCode

CONFIGURATION = {"--locus": "auto"}


def row(**changes):
    return {
        "file": "a.fits",
        "frame": 0,
        "status": "ok",
        "chi2_dof": 1.0,
        "separation": 10.0,
        "separation_err": 0.1,
    } | changes


@pytest.fixture
def store(tmp_path):
    with Store.create(tmp_path, CONFIGURATION) as store:
        yield store


VALUES = [
    0.1 + 0.2,
    -0.0,
    5e-324,
    1.7976931348623157e308,
    math.inf,
    -math.inf,
    math.nan,
    3.0,
    3,
    -1,
    2**63,
    -(2**200),
    True,
    False,
    "",
    "σ'\"; DROP TABLE frames; --\x00\n",
    os.fsdecode(b"night\xff\x80.fits"),
    "\ud83d\ude00",  # two halves of a character, which are not the character
]


def bits(value):
    return type(value), struct.pack("<d", value) if isinstance(value, float) else value


def test_rows_come_back_exactly(store, tmp_path):
    rows = [{"value": value, "other": "x"} for value in VALUES]
    store.add(0, rows)
    store.close()
    with Store.resume(tmp_path, CONFIGURATION) as again:
        back = list(again.rows())
    assert [list(one) for one in back] == [["value", "other"]] * len(VALUES)
    assert [bits(one["value"]) for one in back] == [bits(value) for value in VALUES]


def test_columns_may_differ_between_rows_and_have_any_name(store):
    rows = [{"noll4": 1.0}, {"NOLL4": 2.0, "noll4": 3.0}, {}, {'"; DROP TABLE batches; --': 1, "\udcff": 2}]
    store.add(0, rows)
    assert list(store.rows()) == rows


def test_rows_are_in_the_order_of_the_plan_whichever_batch_came_first(store):
    for batch in (2, 8, 1, 3):
        store.add(batch, [row(frame=10 * batch + position) for position in range(2)])
    assert [one["frame"] for one in store.rows()] == [10, 11, 20, 21, 30, 31, 80, 81]
    assert store.done() == {1, 2, 3, 8}


def test_a_batch_without_rows_is_done(store):
    store.add(7, [])
    assert store.done() == {7}


def test_a_batch_is_entered_once(store):
    store.add(0, [row(frame=1)])
    with pytest.raises(ValueError, match=f"Batch 0 .* {re.escape(str(store.path))}"):
        store.add(0, [row(frame=2)])
    assert [one["frame"] for one in store.rows()] == [1]


def test_a_batch_that_breaks_off_leaves_nothing(store):
    picture = b"arrays"
    with pytest.raises(IndexError):
        store.add(0, [row()], {5: picture})
    with pytest.raises(TypeError, match="not JSON serializable"):
        store.add(0, [row(), {"value": object()}])
    assert (store.done(), list(store.rows()), store.pictures()) == (set(), [], [])
    store.add(0, [row()], {0: picture})
    assert store.pictures() == [(row(), picture)]


def test_a_person_reads_it_in_the_sqlite_shell(store, tmp_path):
    name = os.fsdecode(b"\xff.fits")
    store.add(1, [row(file=name, frame=2**70, separation=math.nan, status="no_star")])
    store.add(0, [row(frame=3)])
    store.close()
    shell = sqlite3.connect(tmp_path / STORE)
    read = shell.execute("SELECT file, frame, status, separation, separation_err FROM frames").fetchall()
    (configuration,) = shell.execute("SELECT value FROM run WHERE name = 'configuration'").fetchone()
    shell.close()
    assert read == [("a.fits", 3, "ok", 10.0, 0.1), ("\\udcff.fits", None, "no_star", None, 0.1)]
    assert '"--locus": "auto"' in configuration


def test_threads_may_share_it(store):
    with ThreadPoolExecutor(4) as threads:
        list(threads.map(lambda batch: store.add(batch, [row(frame=batch)]), range(40)))
    assert [one["frame"] for one in store.rows()] == list(range(40))


def test_frames_are_counted_once_and_stay_counted(store, tmp_path):
    files, asked = [Path(str(n)) for n in range(200)], []

    def count(path):
        asked.append(int(path.name))
        return int(path.name) % 3 + 1

    counts = store.counts.frames(files, count)
    assert [next(counts) for _ in range(5)] == [1, 2, 3, 1, 2]
    first = len(asked)
    assert 5 <= first < 100
    store.close()
    with Store.resume(tmp_path, CONFIGURATION) as again:
        assert list(again.counts.frames(files, count)) == [n % 3 + 1 for n in range(200)]
        assert asked == list(range(200))
        assert list(again.counts.frames(files, pytest.fail)) == [n % 3 + 1 for n in range(200)]


def test_a_run_is_not_started_twice_unless_it_may_be_forgotten(store, tmp_path):
    store.add(0, [row()], {0: b"arrays"})
    list(store.counts.frames([Path("a")], lambda path: 3))
    store.close()
    with refused(ErrorCode.EXISTS, tmp_path, "--resume", "--overwrite"):
        Store.create(tmp_path, CONFIGURATION)
    with Store.create(tmp_path, {"--locus": "mvn"}, overwrite=True) as again:
        assert (list(again.rows()), again.pictures()) == ([], [])
        assert list(again.counts.frames([Path("a")], lambda path: 4)) == [4]
        assert again.configuration == {"--locus": "mvn"}


def test_a_run_that_was_interrupted_before_it_began_is_started(tmp_path):
    with Store.resume(tmp_path, CONFIGURATION, {"date": "Monday"}) as store:
        store.add(0, [row()])
    with Store.resume(tmp_path, CONFIGURATION, {"date": "Tuesday"}) as store:
        assert store.done() == {0}
        assert store.notes == {"date": "Monday"}
        assert store.configuration["--locus"] == "auto"


def test_sums_over_frames_are_those_of_the_last_batch_and_are_forgotten_with_the_run(store, tmp_path):
    store.add(0, [row()], stacks={"binary": b"1", "star": b"7"})
    store.add(1, [row()], stacks={"binary": b"2"})
    with pytest.raises(ValueError, match="before"):
        store.add(1, [row()], stacks={"binary": b"3"})
    store.close()
    with Store.resume(tmp_path, CONFIGURATION) as again:
        assert again.stacks() == {"binary": b"2", "star": b"7"}
    with Store.create(tmp_path, CONFIGURATION, overwrite=True) as anew:
        assert anew.stacks() == {}
