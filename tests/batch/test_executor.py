"""Batches worked through by threads, against frames processed one by one."""

import threading
import time

import numpy as np
import pytest
from records import process_batches

from jitterkit.batch import FrameProcessor, ProcessedFrame, plan
from jitterkit.batch.executor import execute
from jitterkit.batch.plan import Batch, plan_batches
from jitterkit.frames import open_frames, write_fits, write_tiff
from jitterkit.optics import OpticalSystem
from jitterkit.refit import FitResult, Status

SIZE = 8


@pytest.fixture(scope="module")
def night(telescope, drawn_by, tmp_path_factory):
    """Seventeen frames: the wavefront steps by 8 nm in the middle; one is damaged, one shows nothing."""
    directory, rng = tmp_path_factory.mktemp("night"), np.random.default_rng(7)
    for number in range(2 * SIZE + 1):
        step = 8.0 * (number >= SIZE)
        image = drawn_by(telescope, rng, aberrations=[15.0 + step, -6.0]).raw.data
        image = rng.normal(telescope.detector.bias, 1, image.shape) if number == 4 else image
        path = write_fits(directory / f"{number:02d}.fits", image.astype(np.float32))
        if number == 5:
            path.write_bytes(path.read_bytes()[:-3000])
    return sorted(directory.iterdir())


@pytest.fixture(scope="module")
def processor(telescope):
    return FrameProcessor(telescope, locus="mvn")


def done(paths, processor, **options):
    """All rows."""
    batches = plan_batches(paths, [1] * len(paths), SIZE)
    return [row for part in process_batches(batches, processor, **options) for row in part.rows]


def exactly(rows):
    """Every number to the last bit, NaN too, but for the time that a frame took."""
    return [repr({**row, "seconds": 0.0}) for row in rows]


@pytest.fixture(scope="module")
def rows(night, processor):
    return done(night, processor, threads=2)


def test_every_frame_has_a_row_in_order(night, rows):
    assert [row["path"] for row in rows] == [str(path) for path in night]
    statuses = [row["status"] for row in rows]
    assert [statuses[4], statuses[5]] == ["no_star", "unreadable"]
    assert [rows[4]["reason"], rows[5]["reason"]] == ["no_star", "truncated"]
    assert statuses.count("ok") == 2 * SIZE - 1


def test_frames_done_together_give_what_each_gives_alone(night, rows, processor):
    """In either way the optics may be off by 0.1 sigma of the whole image, of which a number sees a part."""
    for path, row in zip(night, rows, strict=True):
        if row["status"] != "ok":
            continue
        with open_frames(path) as file:
            alone = processor.process(file[0]).result
        for name in ("separation", "theta", "x", "flux", "contrast"):
            off = (row[name] - alone.of_scene(name)) / alone.error(name)
            assert abs(off) < 0.05
            # a fit takes its errors from where it began if a step shows that they change by less than 1 %
            assert row[f"{name}_err"] == pytest.approx(alone.error(name), rel=0.01)


@pytest.mark.slow
def test_the_anchor_is_used(night, processor, monkeypatch):
    """Without it each of these eight frames would expand the optics twice, for its start and for its fit."""
    expanded = []
    exact = OpticalSystem.otf

    def counted(*args, derivatives=True):
        expanded.extend(args[1:] if derivatives else ())  # a tenth of the work without
        return exact(*args, derivatives=derivatives)

    monkeypatch.setattr(OpticalSystem, "otf", counted)
    done(night[:4] + night[6:10], processor)
    assert len(expanded) <= 7  # the first look at the lead, and both frames behind the step


@pytest.mark.parametrize("threads", [pytest.param(1, marks=pytest.mark.slow), 3])
def test_rows_are_the_same_to_the_last_digit_whoever_works(night, rows, processor, threads):
    assert exactly(done(night, processor, threads=threads)) == exactly(rows)


@pytest.mark.slow
def test_rows_are_the_same_whatever_was_done_before(night, rows, processor):
    batches = list(plan_batches(night, [1] * len(night), SIZE))
    (last,) = process_batches([batches[1]], processor)
    assert exactly(last.rows) == exactly(rows[SIZE : 2 * SIZE])


def test_a_file_that_has_lost_frames_since_they_were_counted_says_so(night, processor):
    batch = Batch(0, tuple((night[0], index) for index in range(3)))
    (part,) = process_batches([batch], processor)
    assert [row["status"] for row in part.rows] == ["ok", "unreadable", "unreadable"]
    assert [row["reason"] for row in part.rows] == ["", "changed", "changed"]
    assert str(night[0]) in part.rows[2]["message"]
    assert " 1 " in part.rows[2]["message"]


def test_a_bad_toml_beside_an_image_is_a_row_like_any_other_fault(night, processor, tmp_path):
    with open_frames(night[0]) as file:
        write_tiff(tmp_path / "a.tif", file[0].data)
    (tmp_path / "a.toml").write_text("gain = 'much'\n")
    batch = Batch(0, ((tmp_path / "a.tif", 0), (night[0], 0)))
    (part,) = process_batches([batch], processor)
    assert [row["status"] for row in part.rows] == ["unreadable", "ok"]
    assert part.rows[0]["reason"] == "wrong_type"
    assert all(value in part.rows[0]["message"] for value in ("a.toml", "gain", "'much'"))


def test_what_is_not_worth_a_picture_is_not_drawn(night, processor):
    batch = Batch(7, tuple((path, 0) for path in night[3:6]))
    (part,) = process_batches([batch], processor)
    assert sorted(part.pictures) == [0, 1]  # of the damaged file there is nothing to draw
    worse = [(usable, -1e9, 0, position) for usable in (True, False) for position in range(24)]
    (again,) = process_batches([batch], processor, ranks=worse)
    assert again.pictures == {}


def test_many_more_frames_are_not_held_than_are_worked_on(night, processor, monkeypatch):
    """Memory stays flat: what is read ahead is bounded."""
    ahead, most = 0, 0
    calibrate = FrameProcessor.calibrate

    def counted(self, raw):
        nonlocal ahead, most
        ahead += 1
        most = max(most, ahead)
        return calibrate(self, raw)

    def finished(self, frame):
        nonlocal ahead
        time.sleep(0.02)  # reading takes less
        ahead -= 1
        return ProcessedFrame(frame, FitResult(Status.NO_STAR, "nothing is fitted here"))

    monkeypatch.setattr(FrameProcessor, "calibrate", counted)
    monkeypatch.setattr(FrameProcessor, "complete", finished)
    batch = Batch(0, tuple((night[0], 0) for _ in range(30)))
    list(process_batches([batch], processor, threads=2))
    assert most <= 2 * 4 + 2


def test_while_one_frame_takes_long_no_more_than_the_next_batch_is_read(night, monkeypatch):
    """The others' images wait for it to come out in order."""
    monkeypatch.setattr("jitterkit.batch.executor._ALONE", 0.1)
    task = Numbers()
    batches = [Batch(number, ((night[0], 0),)) for number in range(20)]
    assert list(execute(batches, task, results, threads=2)) == [(0, [number]) for number in range(20)]
    assert set(task.early) == {0, 1, None}


def test_the_first_frame_of_a_process_is_alone_until_it_is_done(night, tmp_path, monkeypatch):
    """Others beside it would compile the same programs again; later commands do not wait."""
    monkeypatch.setattr("jitterkit.batch.executor._begun", threading.Event())
    damaged = tmp_path / "damaged.fits"
    damaged.write_bytes(b"SIMPLE")
    for alone in (True, False):
        task = Numbers()
        items = ((damaged, 0), (night[0], 0))  # one that cannot be read compiles nothing
        list(execute([Batch(0, items), *(Batch(n, items[1:]) for n in (1, 2))], task, results, threads=4))
        assert (1 not in task.early) == alone


class Numbers:
    """Takes half a second for the first frame; a frame's result is the number of its batch."""

    plate_scale = None

    def __init__(self, number=0, early=None, slow=(0,)):
        self.number, self.early, self.slow = number, [] if early is None else early, slow

    def for_batch(self, batch, hdu):
        return Numbers(batch.number, self.early, self.slow)

    def calibrate(self, raw):
        self.early.extend([self.number] * (None not in self.early))
        return self.number

    def complete(self, number):
        if number in self.slow:
            time.sleep(0.5)
            self.early.append(None)  # it is late from now on
        return number


def results(batch, outcomes):
    return batch.start, [one.result for one in outcomes]


def test_what_is_finished_of_a_batch_that_takes_long_is_handed_out(night, monkeypatch):
    """A frame takes half a second, and after a fifth of one what is finished is due."""
    monkeypatch.setattr("jitterkit.batch.executor._KEEP", 0.2)
    batches = [Batch(3, tuple((path, 0) for path in night[:4]), start=10)]
    parts = list(execute(batches, Numbers(slow=(3,)), results, threads=1))
    assert len(parts) > 1
    assert [start + n for start, found in parts for n in range(len(found))] == [10, 11, 12, 13]


def test_a_file_of_several_frames_is_opened_once(night, tmp_path, monkeypatch):
    with open_frames(night[0]) as file:
        path = write_fits(tmp_path / "cube.fits", np.stack([file[0].data] * 6))
    opened = []
    monkeypatch.setattr(plan, "open_frames", lambda *a, **k: opened.append(a) or open_frames(*a, **k))
    batches = plan_batches([path], [6], 2)
    assert [found for _, found in execute(batches, Numbers(slow=()), results)] == [[n, n] for n in range(3)]
    assert len(opened) == 1


@pytest.mark.slow
def test_a_frame_in_the_lead_whose_scale_no_pupil_carries_is_a_row(night, processor, tmp_path):
    absurd = tmp_path / "absurd.fits"
    with open_frames(night[0]) as file:
        write_fits(absurd, file[0].data, header={"PIXSCALE": 100.0})
    files = [absurd, *[night[0]] * 7]
    (batch,) = plan_batches(files, [1] * 8, 8)
    assert batch.references
    (done,) = process_batches([batch], processor)
    assert [row["status"] for row in done.rows] == ["mismatch"] + ["ok"] * 7
    assert done.rows[0]["reason"] == "sampling"
