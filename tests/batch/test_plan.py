"""Plans, checked against cuts made by hand and against what the sample files hold."""

from itertools import islice, repeat
from pathlib import Path

import numpy as np
import pytest
from refusals import refused

from jitterkit.batch import plan
from jitterkit.batch.plan import FrameReader, count_frames, plan_batches
from jitterkit.errors import ErrorCode, FrameError
from jitterkit.frames import write_fits

A, B, C, D = (Path(name) for name in "ABCD")


def test_a_batch_goes_across_files_and_through_cubes_in_order():
    cut = list(plan_batches([A, B, C, D], [1, 4, 1, 1], 3))
    assert [(batch.number, batch.items) for batch in cut] == [
        (0, ((A, 0), (B, 0), (B, 1))),
        (1, ((B, 2), (B, 3), (C, 0))),
        (2, ((D, 0),)),
    ]
    # a few frames show each other their scene, and one has no others
    assert [batch.references for batch in cut] == [cut[0].items, cut[1].items, ()]
    assert [batch.scene_only for batch in cut] == [True, True, False]
    # also for a part that is left of an interrupted run
    assert (cut[0].part(1).references, cut[0].part(1).scene_only) == (cut[0].items, True)


@pytest.mark.parametrize("size", [1, 2, 5, 48, 1000])
def test_every_frame_is_in_one_batch_and_only_the_last_batch_is_short(size):
    counts = np.random.default_rng(1).integers(1, 30, 40).tolist()
    files = [Path(f"{n}.fits") for n in range(40)]
    cut = list(plan_batches(files, counts, size))
    assert [item for batch in cut for item in batch.items] == [
        (path, index) for path, n in zip(files, counts, strict=True) for index in range(n)
    ]
    assert [batch.number for batch in cut] == list(range(len(cut)))
    assert {len(batch.items) for batch in cut[:-1]} <= {size}
    assert 0 < len(cut[-1].items) <= size


def test_the_first_batch_comes_before_later_files_are_counted():
    counted = []

    def counts():
        for n in range(10**9):
            counted.append(n)
            yield 1

    first = next(plan_batches(repeat(A), counts(), 4))
    assert len(first.items) == 4
    assert len(counted) == 4


def test_a_cube_without_end_is_cut_without_listing_it():
    cut = plan_batches([A], [10**15], 2)
    assert [batch.items for batch in islice(cut, 2)] == [((A, 0), (A, 1)), ((A, 2), (A, 3))]


def test_no_files_make_no_batch():
    assert list(plan_batches([], [], 3)) == []


@pytest.mark.parametrize("counts", [[1], [1, 1, 1]])
def test_a_count_too_few_or_too_many_is_refused(counts):
    with pytest.raises(ValueError, match=r"zip\(\) argument"):
        list(plan_batches([A, B], counts, 3))


def test_an_empty_batch_is_refused():
    with refused(ErrorCode.OUT_OF_RANGE, 0):
        list(plan_batches([A], [1], 0))


@pytest.mark.parametrize(("shape", "frames"), [((6, 5), 1), ((1, 6, 5), 1), ((7, 6, 5), 7)])
def test_frames_are_counted_as_the_file_holds_them(tmp_path, shape, frames):
    write_fits(tmp_path / "some.fits", np.zeros(shape, np.float32))
    assert count_frames(tmp_path / "some.fits") == frames


def test_a_fits_of_one_frame_is_counted_by_its_layout_alone(tmp_path, monkeypatch):
    write_fits(tmp_path / "one.fits", np.zeros((6, 5), np.float32))
    monkeypatch.setattr("jitterkit.frames.fitsimage.resolve", None)
    assert count_frames(tmp_path / "one.fits") == 1


def test_a_file_that_cannot_be_opened_counts_as_one_frame(tmp_path):
    (tmp_path / "text.fits").write_text("no frame")
    write_fits(tmp_path / "some.fits", np.zeros((7, 6, 5), np.float32))
    assert count_frames(tmp_path / "text.fits") == 1
    assert count_frames(tmp_path / "gone.fits") == 1
    assert count_frames(tmp_path) == 1
    assert count_frames(tmp_path / "some.fits", hdu=9) == 1


def test_a_file_that_holds_nothing_counts_as_one_frame_so_that_it_has_a_row(monkeypatch):
    monkeypatch.setattr(plan, "frame_count", lambda path, hdu: 0)
    assert count_frames(A) == 1


@pytest.mark.parametrize("first", [None, 2])
def test_a_file_that_could_not_be_read_or_has_grown_is_opened_again_for_the_next_frames(tmp_path, first):
    path = tmp_path / "a.fits"
    path.write_bytes(b"") if first is None else write_fits(path, np.zeros((first, 6, 5), np.float32))
    with FrameReader() as reader:
        before = [raw for *_, raw in reader.read([(path, 0), (path, 2)])]
        write_fits(path, np.ones((3, 6, 5), np.float32), overwrite=True)
        ((_, _, raw),) = reader.read([(path, 2)])
    assert [isinstance(one, FrameError) for one in before] == [first is None, True]
    assert first is None or before[1].code is ErrorCode.CHANGED
    assert raw.index == 2
    assert (raw.data == 1).all()
