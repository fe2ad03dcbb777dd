"""The pictures of a run are the same in whatever order its batches were done."""

import math

import numpy as np
import pytest

from jitterkit.batch.ledger import Ledger
from jitterkit.batch.ledger_worst import wanted
from jitterkit.report.pictures import MOST_PICTURES, FrameReport, Gallery


def row(frame=0, status="ok", chi2_dof=1.0):
    return {"file": "a.fits", "frame": frame, "status": status, "chi2_dof": chi2_dof}


def report(one):
    return FrameReport(f"{one['file']}[{one['frame']}]", one, f"png of {one['frame']}".encode(), "alt")


def drawn(ledger, batches, order):
    """Enter batches in some order with the pictures that are wanted; how many those are."""
    count = 0
    for batch in order:
        rows = dict(enumerate(batches[batch]))
        places = wanted(ledger.ranks(), batch, rows)
        ledger.add(batch, batches[batch], {place: report(rows[place]) for place in places})
        count += len(places)
    return count


def many_batches(rng, ties):
    """Two thousand frames, one in ten failed; misfits are drawn, or only 1, 2 and none."""
    misfits = rng.choice([1.0, 2.0, math.nan], 2000) if ties else rng.uniform(0.5, 2, 2000)
    status = np.where(rng.uniform(size=2000) < 0.1, "failed", "ok").tolist()
    rows = [row(frame=n, status=status[n], chi2_dof=float(misfits[n])) for n in range(2000)]
    return [rows[n : n + 40] for n in range(0, 2000, 40)]


def test_the_pictures_are_those_a_gallery_of_all_frames_would_choose(tmp_path):
    rng = np.random.default_rng(8)
    batches, gallery = many_batches(rng, ties=False), Gallery()
    with Ledger.create(tmp_path, {}) as ledger:
        count = drawn(ledger, batches, range(50))
        chosen = ledger.pictures()
    for one in (one for rows in batches for one in rows):
        gallery.add(report(one))
    assert chosen == gallery.chosen()
    # of n frames in random order the r-th is among the worst 24 with probability 24/r: 24 (1 + ln(n/24)), of
    # 1800 fitted 128 +- 10, of 200 failed 75 +- 6; within a batch only its worst are drawn, which is fewer
    assert 48 < count < 250


@pytest.mark.parametrize("ties", [False, True])
def test_the_pictures_do_not_depend_on_which_batch_was_done_first(tmp_path, ties):
    rng = np.random.default_rng(9)
    batches, chosen = many_batches(rng, ties), []
    for n, order in enumerate([range(50), range(49, -1, -1), rng.permutation(50).tolist()]):
        (tmp_path / str(n)).mkdir()
        with Ledger.create(tmp_path / str(n), {}) as ledger:
            drawn(ledger, batches, order)
            chosen.append([(one.name, one.picture) for one in ledger.pictures()])
            assert len(ledger.ranks()) == 2 * MOST_PICTURES
    assert len(chosen[0]) == 24
    assert chosen[0] == chosen[1] == chosen[2]


def test_a_frame_that_cannot_be_drawn_takes_no_place():
    rows = [row(status="unreadable", chi2_dof=math.nan) for _ in range(60)]
    assert wanted([], 0, {50: rows[50]}) == [50]
    assert wanted([], 0, dict(enumerate(rows))) == list(range(MOST_PICTURES))
