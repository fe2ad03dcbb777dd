"""Frames stand where their headers put them in time, as long as that makes an axis."""

import numpy as np
import pytest

from jitterkit.report.means import Clock, fitted, separation_series
from jitterkit.report.table import make_table


def _table(times, status=None, **columns):
    status = ["ok"] * len(times) if status is None else status
    rows = [{"time": t, "status": s, "separation": 8.0 + 1e-4 * k, "separation_err": 1e-4}
            for k, (t, s) in enumerate(zip(times, status, strict=True))]  # fmt: skip
    return make_table(
        [row | {name: values[k] for name, values in columns.items()} for k, row in enumerate(rows)]
    )


def _minute(seconds):
    return [f"2027-03-01T03:{int(s) // 60:02d}:{s % 60:09.6f}" for s in seconds]


def test_frames_stand_at_their_seconds_since_the_first():
    seconds = np.arange(20) * 0.5 + 3
    clock = Clock.of(_table(_minute(seconds)))
    np.testing.assert_allclose(clock.at, seconds - 3, atol=1e-6)  # a double holds a second of 2027 to 0.2 us
    assert (clock.unit, clock.start) == ("s", "2027-03-01 03:00:03")


def test_another_time_zone_is_the_same_time():
    times = _minute(np.arange(20.0))
    there = [time.replace("T03", "T05") + "+02:00" for time in times]
    np.testing.assert_allclose(Clock.of(_table(there)).at, Clock.of(_table(times)).at)
    assert Clock.of(_table(there)).start == "2027-03-01 03:00:00"


def test_a_failure_without_a_time_stands_between_its_neighbours():
    times, status = _minute(np.arange(20.0)), ["ok"] * 20
    times[7], status[7] = "", "unreadable"
    clock = Clock.of(_table(times, status))
    assert clock.unit == "s"
    assert clock.at[7] == pytest.approx(7.0)


@pytest.mark.parametrize(
    "times",
    [
        [""] * 20,
        ["2027-03-01T03:00:00"] * 20,
        [*_minute(np.arange(19.0)), ""],
        [*_minute(np.arange(19.0)), "yesterday"],
        [*_minute(np.arange(19.0)), "1927-03-01T03:00:00"],
        np.repeat(_minute(np.arange(5.0)), 4).tolist(),
    ],
    ids=["none", "one for all", "one missing", "no time", "a wrong year", "one a cube"],
)
def test_frames_are_counted_where_times_make_no_axis(times):
    clock = Clock.of(_table(times))
    assert (clock.unit, clock.start) == ("frame", "")
    np.testing.assert_array_equal(clock.at, np.arange(20) + 1)


def test_a_run_without_frames_has_a_clock():
    assert len(Clock.of(make_table([])).at) == 0


def test_a_series_has_the_frames_that_count():
    times, errors = _minute(np.arange(20.0)), np.full(20, 1e-4)
    errors[[2, 3]] = np.nan, 0.0
    table = _table(times, ["failed", *["ok"] * 19], separation_err=errors)
    np.testing.assert_array_equal(np.flatnonzero(~fitted(table)), [0, 2, 3])
    series = separation_series(table, Clock.of(table))
    np.testing.assert_array_equal(series.good, fitted(table))
    assert series.cadence == pytest.approx(1.0)
    assert separation_series(table[:4], Clock.of(table[:4])) is None
