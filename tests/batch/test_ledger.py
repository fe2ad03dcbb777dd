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

from jitterkit.batch.ledger import LEDGER, Ledger
from jitterkit.errors import ErrorCode
from jitterkit.report.pictures import FrameReport

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
def ledger(tmp_path):
    with Ledger.create(tmp_path, CONFIGURATION) as ledger:
        yield ledger


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


def test_rows_come_back_exactly(ledger, tmp_path):
    rows = [{"value": value, "other": "x"} for value in VALUES]
    ledger.add(0, rows)
    ledger.close()
    with Ledger.resume(tmp_path, CONFIGURATION) as again:
        back = list(again.rows())
    assert [list(one) for one in back] == [["value", "other"]] * len(VALUES)
    assert [bits(one["value"]) for one in back] == [bits(value) for value in VALUES]


def test_columns_may_differ_between_rows_and_have_any_name(ledger):
    rows = [{"noll4": 1.0}, {"NOLL4": 2.0, "noll4": 3.0}, {}, {'"; DROP TABLE batches; --': 1, "\udcff": 2}]
    ledger.add(0, rows)
    assert list(ledger.rows()) == rows


def test_rows_are_in_the_order_of_the_plan_whichever_batch_came_first(ledger):
    for batch in (2, 8, 1, 3):
        ledger.add(batch, [row(frame=10 * batch + place) for place in range(2)])
    assert [one["frame"] for one in ledger.rows()] == [10, 11, 20, 21, 30, 31, 80, 81]
    assert ledger.done() == {1, 2, 3, 8}


def test_a_batch_without_rows_is_done(ledger):
    ledger.add(7, [])
    assert ledger.done() == {7}


def test_a_batch_is_entered_once(ledger):
    ledger.add(0, [row(frame=1)])
    with pytest.raises(ValueError, match=f"Batch 0 .* {re.escape(str(ledger.path))}"):
        ledger.add(0, [row(frame=2)])
    assert [one["frame"] for one in ledger.rows()] == [1]


def test_a_batch_that_breaks_off_leaves_nothing(ledger):
    picture = FrameReport("a", row(), b"png")
    with pytest.raises(IndexError):
        ledger.add(0, [row()], {5: picture})
    with pytest.raises(TypeError, match="not JSON serializable"):
        ledger.add(0, [row(), {"value": object()}])
    assert (ledger.done(), list(ledger.rows()), ledger.pictures()) == (set(), [], [])
    ledger.add(0, [row()], {0: picture})
    assert ledger.pictures() == [picture]


def test_a_person_reads_it_in_the_sqlite_shell(ledger, tmp_path):
    name = os.fsdecode(b"\xff.fits")
    ledger.add(1, [row(file=name, frame=2**70, separation=math.nan, status="no_star")])
    ledger.add(0, [row(frame=3)])
    ledger.close()
    shell = sqlite3.connect(tmp_path / LEDGER)
    read = shell.execute("SELECT file, frame, status, separation, separation_err FROM frames").fetchall()
    (configuration,) = shell.execute("SELECT value FROM run WHERE name = 'configuration'").fetchone()
    shell.close()
    assert read == [("a.fits", 3, "ok", 10.0, 0.1), ("\\udcff.fits", None, "no_star", None, 0.1)]
    assert '"--locus": "auto"' in configuration


def test_threads_may_share_it(ledger):
    with ThreadPoolExecutor(4) as threads:
        list(threads.map(lambda batch: ledger.add(batch, [row(frame=batch)]), range(40)))
    assert [one["frame"] for one in ledger.rows()] == list(range(40))


def test_frames_are_counted_once_and_stay_counted(ledger, tmp_path):
    files, asked = [Path(str(n)) for n in range(200)], []

    def count(path):
        asked.append(int(path.name))
        return int(path.name) % 3 + 1

    counts = ledger.frame_counts(files, count)
    assert [next(counts) for _ in range(5)] == [1, 2, 3, 1, 2]
    first = len(asked)
    assert 5 <= first < 100
    ledger.close()
    with Ledger.resume(tmp_path, CONFIGURATION) as again:
        assert list(again.frame_counts(files, count)) == [n % 3 + 1 for n in range(200)]
        assert asked == list(range(200))
        assert list(again.frame_counts(files, pytest.fail)) == [n % 3 + 1 for n in range(200)]


def test_a_run_is_not_begun_twice_unless_it_may_be_forgotten(ledger, tmp_path):
    ledger.add(0, [row()], {0: FrameReport("a", row(), b"png")})
    list(ledger.frame_counts([Path("a")], lambda path: 3))
    ledger.close()
    with refused(ErrorCode.EXISTS, tmp_path, "--resume", "--overwrite"):
        Ledger.create(tmp_path, CONFIGURATION)
    with Ledger.create(tmp_path, {"--locus": "mvn"}, overwrite=True) as again:
        assert (list(again.rows()), again.pictures()) == ([], [])
        assert list(again.frame_counts([Path("a")], lambda path: 4)) == [4]
        assert again.configuration == {"--locus": "mvn"}


def test_a_run_that_was_interrupted_before_it_began_is_begun(tmp_path):
    with Ledger.resume(tmp_path, CONFIGURATION, {"date": "Monday"}) as ledger:
        ledger.add(0, [row()])
    with Ledger.resume(tmp_path, CONFIGURATION, {"date": "Tuesday"}) as ledger:
        assert ledger.done() == {0}
        assert ledger.notes == {"date": "Monday"}
        assert ledger.configuration["--locus"] == "auto"
