"""Runs that are interrupted, and what happens to their directories and files before they go on.

Frames are letters of text files, and the fit of one is a row whose message is the letter: so a table tells
which content was read.
"""

import os
from functools import partial

import pytest
from refusals import refused

from jitterkit.batch.store import STORE
from jitterkit.errors import ErrorCode
from jitterkit.refit import FitResult, Status
from jitterkit.report.row import make_row
from jitterkit.run import process_files
from jitterkit.run.rows import Record

FILES, SIZE = 6, 2
RESULTS = {"results.ecsv", "summary.json", "report.html", "configuration.json"}


def spell(batches, processor, finish, *, most=FILES, **_):
    """Do some batches, then hear Ctrl-C."""
    for done, batch in enumerate(batches):
        if done == most:
            raise KeyboardInterrupt
        rows = [
            make_row(FitResult(Status.UNREADABLE, path.read_text()[position]), path, position)
            for path, position in batch.items
        ]
        yield Record(batch, rows, {})


@pytest.fixture
def run(tmp_path, processor, monkeypatch):
    """Process the files of the night, a letter each, into a directory."""
    monkeypatch.setattr("jitterkit.run.process.batch_size", lambda shape: SIZE)
    monkeypatch.setattr("jitterkit.run.process.count_frames", lambda path, hdu: len(path.read_text()))
    (tmp_path / "night").mkdir()
    for number in range(FILES):
        (tmp_path / "night" / f"{number}.fits").write_text("a")

    def run(most=FILES, **options):
        executor = partial(spell, most=most)
        done = process_files([tmp_path / "night"], tmp_path / "out", processor, executor=executor, **options)
        return "".join(done.table["message"])

    return run


@pytest.fixture
def stopped(run):
    """After one batch of two frames."""
    with pytest.raises(KeyboardInterrupt):
        run(most=1)
    return run


@pytest.fixture
def night(tmp_path):
    return tmp_path / "night"


@pytest.fixture
def out(tmp_path):
    return tmp_path / "out"


def names(directory):
    return {path.name for path in directory.iterdir()}


def test_a_file_that_was_overwritten_between_two_sessions_is_refused_until_it_is_put_back(stopped, night):
    path, times = night / "1.fits", os.stat(night / "1.fits")
    path.write_text("b")
    with refused(ErrorCode.CHANGED, path):
        stopped(resume=True)
    path.write_text("a")
    os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))
    assert stopped(resume=True) == "aaaaaa"


def test_what_was_refused_is_started_again_by_overwriting(stopped, night):
    (night / "1.fits").write_text("bb")
    assert stopped(overwrite=True) == "abbaaaa"


def test_a_file_of_a_run_that_is_complete_is_looked_at_too(run, night):
    assert run() == "aaaaaa"
    (night / "5.fits").write_text("bb")
    with refused(ErrorCode.CHANGED, night / "5.fits"):
        run(resume=True)


def test_a_file_of_which_nothing_was_done_is_taken_as_it_is_now(stopped, night):
    (night / "3.fits").write_text("bcd")
    with pytest.raises(KeyboardInterrupt):
        stopped(most=2, resume=True)
    assert stopped(resume=True) == "aaabcdaa"
    (night / "3.fits").write_text("e")
    with refused(ErrorCode.CHANGED, night / "3.fits", "3 bytes", "1 now"):
        stopped(resume=True)


def test_a_refusal_leaves_what_was_counted(stopped, night):
    """A file that could be counted anew is not, while another stands in the way."""
    (night / "0.fits").write_text("bb")
    (night / "5.fits").write_text("bbb")
    for _ in range(2):
        with refused(ErrorCode.CHANGED, night / "0.fits"):
            stopped(resume=True)


def test_a_directory_that_has_gained_files_is_reported_with_how_many_and_what_to_do(stopped, night, out):
    for name in ("00.fits", "9.fits"):
        (night / name).write_text("b")
    with refused(ErrorCode.CONFLICT, out, 2, night / "00.fits", "--overwrite", "--resume"):
        stopped(resume=True)


def test_results_without_a_ledger_are_not_replaced_by_going_on(run, out):
    run()
    (out / STORE).unlink()
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    with refused(ErrorCode.EXISTS, out, "results.ecsv", "--overwrite"):
        run(resume=True)
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before
    assert run(overwrite=True) == "aaaaaa"


def test_results_beside_a_ledger_that_holds_no_run_are_not_replaced_either(run, out):
    out.mkdir()
    (out / "report.html").write_text("mine")
    (out / STORE).touch()  # of a run that was killed before it began
    with refused(ErrorCode.EXISTS, out, "report.html"):
        run(resume=True)
    assert (out / "report.html").read_text() == "mine"


def test_a_run_that_is_started_again_and_interrupted_leaves_no_results_of_the_one_before(run, night, out):
    run()
    assert names(out) == RESULTS | {STORE}
    (out / "summary.json.bak").write_text("mine")
    (out / "plots").mkdir()
    (night / "5.fits").write_text("b")
    with pytest.raises(KeyboardInterrupt):
        run(most=1, overwrite=True)
    assert names(out) == {STORE, "summary.json.bak", "plots"}
    assert run(resume=True) == "aaaaab"
    assert names(out) == RESULTS | {STORE, "summary.json.bak", "plots"}


def test_results_that_cannot_be_removed_keep_the_run_to_which_they_belong(run, out):
    run()
    (out / "report.html").unlink()
    (out / "report.html").mkdir()
    with refused(ErrorCode.NOT_WRITABLE, out / "report.html"):
        run(overwrite=True)
    (out / "report.html").rmdir()
    assert run(resume=True, most=0) == "aaaaaa"


def test_a_run_is_not_both_continued_and_started_again(run, out):
    with refused(ErrorCode.CONFLICT, "--resume", "--overwrite"):
        run(resume=True, overwrite=True)
    assert not out.exists()


def test_rows_of_an_earlier_session_are_distinguished_from_those_of_this_one(stopped):
    now, earlier, both = [], [], []
    with pytest.raises(KeyboardInterrupt):
        stopped(most=1, resume=True, watch=now.append, before=earlier.append)
    assert [row["file"] for row in earlier] == ["0.fits", "1.fits"]
    assert [row["file"] for row in now] == ["2.fits", "3.fits"]
    stopped(resume=True, watch=both.append)
    assert [row["file"] for row in both] == [f"{number}.fits" for number in range(FILES)]
