"""Thousands of failures are a handful of reasons."""

import numpy as np
import pytest
from long_run import FAILURES, long_run

from jitterkit.report.failures import group_failures, reason


def _row(message, file="a.fits", path="/n/a.fits", status="failed"):
    return {"file": file, "path": path, "status": status, "message": message}


@pytest.mark.parametrize(
    ("message", "expected"),
    [
        ("/n/a.fits: is empty (0 bytes); copy it again.", "is empty (# bytes); copy it again."),
        ("/n/a.fits[3]: plane 3 is cut short.", "plane # is cut short."),
        ("a.fits is odd.", "… is odd."),
        ("chi²/dof is 1.675.", "chi²/dof is #."),
        ("flux −3.1 × 10⁷ e-/s at (1.5, -2e-05).", "flux # e-/s at (#, #)."),
        ("NAXIS3 and noll4 are names, 4 is not.", "NAXIS3 and noll4 are names, # is not."),
        ("OBJECT = '12 \"x\" <b>' is no star.", "OBJECT = '…' is no star."),
        ("flat/master.fits does not suit it.", "… does not suit it."),
        ("", ""),
    ],
)
def test_what_is_a_frames_own_is_taken_out_of_its_sentence(message, expected):
    assert reason(_row(message)) == expected


def test_a_frame_without_a_name_keeps_its_sentence():
    assert reason(_row("nothing shines.", file="", path="")) == "nothing shines."


def test_frames_that_failed_alike_are_counted_the_commonest_first():
    rows = [_row(f"/n/{k}.fits: holds {k} bytes.", f"{k}.fits", f"/n/{k}.fits") for k in range(5)]
    kinds = group_failures([_row("nothing shines.", status="no_star"), *rows])
    assert [(kind.status, kind.reason, kind.count) for kind in kinds] == [
        ("failed", "holds # bytes.", 5), ("no_star", "nothing shines.", 1),
    ]  # fmt: skip
    assert kinds[0].example == rows[0]


def test_one_sentence_of_two_statuses_is_two_kinds():
    assert len(group_failures([_row("x", status="failed"), _row("x", status="no_star")])) == 2


def test_a_long_run_has_as_many_kinds_as_reasons():
    rows = [row for row in long_run(4000, np.random.default_rng(1)) if row["status"] != "ok"]
    kinds = group_failures(rows)
    assert len(kinds) == len(FAILURES)
    assert sum(kind.count for kind in kinds) == len(rows)
