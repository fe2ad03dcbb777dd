"""The pictures of a run are the same in whatever order its batches were done."""

import math

import numpy as np
import pytest

from jitterkit.batch.ranking import wanted
from jitterkit.batch.store import Store
from jitterkit.report.pictures import MOST_PICTURES, choose_pictures


def row(frame=0, status="ok", chi2_dof=1.0):
    return {"file": "a.fits", "frame": frame, "status": status, "chi2_dof": chi2_dof}


def packed(one):
    return f"arrays of {one['frame']}".encode()


def chosen_of(store):
    """Frames that the report shows, with what their pictures are drawn from."""
    pictures = store.pictures()
    return [
        (pictures[position][0]["frame"], pictures[position][1])
        for position in choose_pictures([one for one, _ in pictures])
    ]


def drawn(store, batches, order):
    """Enter batches in some order with the pictures that are wanted; how many those are."""
    count = 0
    for batch in order:
        rows = dict(enumerate(batches[batch]))
        positions = wanted(store.ranks(), batch, rows)
        store.add(batch, batches[batch], {position: packed(rows[position]) for position in positions})
        count += len(positions)
    return count


def many_batches(rng, ties):
    """Two thousand frames, one in ten failed; misfits are drawn, or only 1, 2 and none."""
    misfits = rng.choice([1.0, 2.0, math.nan], 2000) if ties else rng.uniform(0.5, 2, 2000)
    status = np.where(rng.uniform(size=2000) < 0.1, "failed", "ok").tolist()
    rows = [row(frame=n, status=status[n], chi2_dof=float(misfits[n])) for n in range(2000)]
    return [rows[n : n + 40] for n in range(0, 2000, 40)]


def test_the_pictures_are_those_that_would_be_chosen_among_all_frames(tmp_path):
    rng = np.random.default_rng(8)
    batches = many_batches(rng, ties=False)
    with Store.create(tmp_path, {}) as store:
        count = drawn(store, batches, range(50))
        chosen = chosen_of(store)
    rows = [one for batch in batches for one in batch]
    assert chosen == [(position, packed(rows[position])) for position in choose_pictures(rows)]
    # of n frames in random order the r-th is among the worst 24 with probability 24/r: 24 (1 + ln(n/24)), of
    # 1800 fitted 128 +- 10, of 200 failed 75 +- 6; within a batch only its worst are drawn, which is fewer
    assert 48 < count < 250


@pytest.mark.parametrize("ties", [False, True])
def test_the_pictures_do_not_depend_on_which_batch_was_done_first(tmp_path, ties):
    rng = np.random.default_rng(9)
    batches, chosen = many_batches(rng, ties), []
    for n, order in enumerate([range(50), range(49, -1, -1), rng.permutation(50).tolist()]):
        (tmp_path / str(n)).mkdir()
        with Store.create(tmp_path / str(n), {}) as store:
            drawn(store, batches, order)
            chosen.append(chosen_of(store))
            assert len(store.ranks()) == 2 * MOST_PICTURES
    assert len(chosen[0]) == 24
    assert chosen[0] == chosen[1] == chosen[2]


def test_a_frame_that_cannot_be_drawn_takes_no_place():
    rows = [row(status="unreadable", chi2_dof=math.nan) for _ in range(60)]
    assert wanted([], 0, {50: rows[50]}) == [50]
    assert wanted([], 0, dict(enumerate(rows))) == list(range(MOST_PICTURES))
