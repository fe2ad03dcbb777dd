"""Thousands of failures are counted by a few codes."""

import numpy as np
import pytest
from long_run import FAILURES, long_run

from jitterkit.errors import ErrorCode
from jitterkit.report.row import group_failures


def _row(reason, status="failed", message="x"):
    return {"file": "a.fits", "path": "/n/a.fits", "status": status, "reason": reason, "message": message}


def test_frames_that_failed_alike_are_counted_the_commonest_first():
    rows = [_row("truncated", "unreadable", f"{k}.fits: holds {k} bytes.") for k in range(5)]
    kinds = group_failures([_row("no_star", "no_star"), *rows])
    assert [(kind.status, kind.reason, kind.count) for kind in kinds] == [
        ("unreadable", "truncated", 5), ("no_star", "no_star", 1),
    ]  # fmt: skip
    assert kinds[0].example == rows[0]
    assert kinds[0].meaning == ErrorCode.TRUNCATED.meaning


@pytest.mark.parametrize("other", [_row("damaged"), _row("truncated", "unreadable")])
def test_another_reason_or_status_is_another_kind(other):
    assert len(group_failures([_row("truncated"), other])) == 2


def test_a_reason_of_another_version_is_shown_as_it_is():
    rows = [_row("struck_by_lightning"), {"status": "failed", "message": "no reason was kept"}]
    assert [kind.meaning for kind in group_failures(rows)] == ["struck by lightning", ""]


def test_a_long_run_has_as_many_kinds_as_reasons():
    rows = [row for row in long_run(4000, np.random.default_rng(1)) if row["status"] != "ok"]
    kinds = group_failures(rows)
    assert len(kinds) == len(FAILURES)
    assert sum(kind.count for kind in kinds) == len(rows)
