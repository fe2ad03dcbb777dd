"""The line that a run keeps on the screen: how fast it goes, and for how long yet."""

from types import SimpleNamespace

import pytest

from jitterkit.cli.progress import RunningStatistics, run_progress, time_left


def row(file=0, **changes):
    fitted = {"status": "ok", "separation": 10.0, "separation_err": 0.1}
    return {"path": f"{file}.fits", **fitted, **changes}


def test_rows_of_an_earlier_session_say_nothing_of_how_fast_it_goes():
    tally = RunningStatistics()
    for _ in range(60_000):
        tally.add(row())
    assert tally.rate != tally.rate
    for second in range(3):
        tally.add(row(), now=100.0 + second)
    assert (tally.rows, tally.rate) == (60_003, 1.0)


def test_the_rate_is_that_of_batches_whose_rows_come_together():
    """Thirty-two rows every two seconds, each batch told within milliseconds."""
    tally, rates = RunningStatistics(), []
    for batch in range(30):
        for position in range(32):
            tally.add(row(), now=2.0 * batch + 1e-4 * position)
        rates.append(tally.rate)
    assert rates[0] != rates[0]
    assert rates[1:] == pytest.approx([16.0] * 29)


def test_the_time_left_is_that_of_the_frames_in_files_that_are_yet_to_come():
    tally = RunningStatistics()
    for _ in range(90):
        tally.add(row())
    assert time_left(tally, 9, 100) == "-:--:--"
    for second in range(10):
        tally.add(row(), now=second)
    assert time_left(tally, 10, 100) == "0:15:00"  # ninety files of ten frames, one a second


@pytest.fixture
def terminal(monkeypatch):
    monkeypatch.setattr("rich.console.Console.is_terminal", True)
    monkeypatch.setenv("COLUMNS", "120")


def test_the_line_counts_the_files_of_earlier_sessions_but_not_their_time(terminal, capsys, monkeypatch):
    clock = SimpleNamespace(monotonic=iter([50.0, 51.0, 52.0]).__next__)
    monkeypatch.setattr("jitterkit.cli.progress.time", clock)
    monkeypatch.setattr("jitterkit.cli.progress.time_left", lambda rows, *files: f"{rows.rate} {files}")
    with run_progress(9) as (follow, recall):
        for file in (0, 0, 1):
            recall(row(file))
        for file in (2, 3, 3):
            follow(row(file))
    assert "1.0 (4, 9)" in capsys.readouterr().err
