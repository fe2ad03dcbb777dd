"""Frames that arrive while they are watched for, against those that were there; the test is the camera."""

from dataclasses import replace

import numpy as np
import pytest
from refusals import refused

from jitterkit.batch import FrameProcessor
from jitterkit.errors import ErrorCode, FrameError
from jitterkit.frames import is_whole, read_frames, write_fits
from jitterkit.run import process_files
from jitterkit.run.watch import WATCH, watch_directory

pytestmark = pytest.mark.usefixtures("few_pictures")

COUNT = 20


@pytest.fixture(scope="module")
def processor(telescope):
    return FrameProcessor(telescope, locus="mvn")


@pytest.fixture(scope="module")
def night(telescope, drawn_by, tmp_path_factory):
    directory, rng = tmp_path_factory.mktemp("night"), np.random.default_rng(12)
    for number in range(COUNT):
        image = drawn_by(telescope, rng, aberrations=[15.0, -6.0]).raw.data
        write_fits(directory / f"{number:02d}.fits", image.astype(np.float32))
    return sorted(directory.iterdir())


class Camera:
    """Does one thing whenever the watch sleeps: a function of nothing at a time, then nothing more."""

    def __init__(self, *deeds):
        self.deeds = list(deeds)

    def __call__(self, seconds):
        if self.deeds:
            self.deeds.pop(0)()


def copies(paths, directory):
    return [lambda path=path: (directory / path.name).write_bytes(path.read_bytes()) for path in paths]


def names(run):
    return list(run.table["file"])


@pytest.fixture(scope="module")
def watched(night, processor, tmp_path_factory):
    """Twelve frames that were there, seven that came two at a time and one that stays half-written."""
    where = tmp_path_factory.mktemp("camera")
    for copy in copies(night[:12], where):
        copy()
    half = night[-1].read_bytes()[:6000]
    deeds = [*copies(night[12:19], where), lambda: (where / night[-1].name).write_bytes(half)]
    pairs = [lambda k=k: [deed() for deed in deeds[k : k + 2]] for k in range(0, 8, 2)]
    rows = []
    run = watch_directory(
        where, where, processor, idle=3, poll=1, watch=rows.append, sleep=Camera(*pairs), threads=2
    )
    return run, rows, where


def test_frames_are_processed_as_they_come(watched, night):
    run, rows, _ = watched
    assert names(run) == [path.name for path in night]
    assert [row["file"] for row in rows] == names(run)
    assert list(run.table["status"]) == ["ok"] * 19 + ["unreadable"]
    assert run.failures == 1


@pytest.mark.slow
def test_numbers_agree_with_those_of_a_run_of_the_same_files(watched, night, processor, tmp_path):
    """A fit ends within 1e-4 standard errors; optics about other frames move it by a thousandth."""
    table = process_files(night[:8], tmp_path / "out", processor).table
    for name in ("separation", "theta", "x"):
        off = (watched[0].table[name][:8] - table[name]) / table[f"{name}_err"]
        assert np.abs(off).max() < 2e-3


def test_a_file_that_is_never_finished_is_reported_at_the_end_with_the_reason(watched):
    run, rows, _ = watched
    assert (rows[-1]["status"], rows[-1]["reason"]) == ("unreadable", "truncated")
    assert run.summary["status"] == {"ok": 19, "unreadable": 1}
    assert run.summary["fit"]["stack_frames"] == 19


def test_a_watch_that_is_resumed_does_what_is_left_and_nothing_twice(watched, night, processor):
    """The half-written file has been finished meanwhile; outputs lie among the frames."""
    run, _, where = watched
    (where / night[-1].name).write_bytes(night[-1].read_bytes())
    now, before = [], []
    callback = {"watch": now.append, "before": before.append}
    table = watch_directory(where, where, processor, idle=2, resume=True, sleep=Camera(), **callback).table
    assert [len(before), len(now)] == [19, 1]
    assert list(table["file"]) == [path.name for path in night]
    assert set(table["status"]) == {"ok"}
    assert list(table["seconds"][:-1]) == list(run.table["seconds"][:-1])  # not fitted again


def test_a_watch_that_is_asked_to_stop_ends_with_what_it_has_started(
    night, processor, tmp_path, monkeypatch, caplog
):
    """It is told while it reads the second of many files."""
    read = []

    def noted(path, hdu):
        read.append(path)
        return True

    monkeypatch.setattr("jitterkit.batch.directory_watcher.is_whole", noted)
    monkeypatch.setattr("jitterkit.run.watch.WATCH", replace(WATCH, batch=2))
    run = watch_directory(
        night[0].parent, tmp_path / "out", processor, stop=lambda: len(read) >= 2, sleep=Camera()
    )
    assert names(run) == [path.name for path in night[:2]]
    assert (tmp_path / "out" / "report.html").exists()
    assert [record.args for record in caplog.records] == [(str(night[0].parent), "18 files")]


def test_a_watch_without_a_frame_says_so(processor, tmp_path):
    with refused(ErrorCode.NO_IMAGE, tmp_path, error=FrameError):
        watch_directory(tmp_path, tmp_path / "out", processor, idle=1, sleep=Camera())


def test_what_is_no_directory_is_reported(night, processor, tmp_path):
    with refused(ErrorCode.NOT_READABLE, night[0], error=FrameError):
        watch_directory(night[0], tmp_path / "out", processor)


def test_a_run_of_process_is_not_gone_on_with_by_watch(night, processor, tmp_path):
    process_files(night[:1], tmp_path / "out", processor)
    with refused(ErrorCode.CONFLICT, tmp_path / "out"):
        watch_directory(night[0].parent, tmp_path / "out", processor, resume=True)


@pytest.fixture
def spoilt(night, tmp_path, monkeypatch):
    """A directory with two files, the second of which is written anew just after it was found to be whole."""
    where = tmp_path / "camera"
    where.mkdir()
    for copy in copies(night[:2], where):
        copy()
    late = where / night[1].name
    contents = [late.read_bytes()[:9000]]

    def spoil(path, hdu):
        whole = is_whole(path, hdu=hdu)
        if path == late and contents:
            path.write_bytes(contents.pop())
        return whole

    monkeypatch.setattr("jitterkit.batch.directory_watcher.is_whole", spoil)
    return where


def test_a_frame_that_became_unreadable_after_its_file_was_whole_is_tried_again(night, processor, spoilt):
    """Rows come after some looks without a frame; then the writer comes to its end."""
    rows = []
    written = (lambda: None,) * 6 + (lambda: copies(night[1:2], spoilt)[0](),)
    run = watch_directory(
        spoilt, spoilt, processor, idle=12, watch=rows.append, sleep=Camera(*written), threads=2
    )
    assert names(run) == [row["file"] for row in rows] == [path.name for path in night[:2]]
    assert list(run.table["status"]) == ["ok", "ok"]


def test_a_frame_that_stays_unreadable_is_reported_at_the_end_and_done_by_a_resumed_watch(
    night, processor, spoilt
):
    run = watch_directory(spoilt, spoilt, processor, idle=5, sleep=Camera())
    assert list(run.table["status"]) == ["ok", "unreadable"]
    copies(night[1:2], spoilt)[0]()
    run = watch_directory(spoilt, spoilt, processor, idle=5, resume=True, sleep=Camera())
    assert list(run.table["status"]) == ["ok", "ok"]


@pytest.fixture
def cube(night, tmp_path):
    """A directory with three frames in one file."""
    frames = [frame.data for path in night[:3] for frame in read_frames(path)]
    (tmp_path / "camera").mkdir()
    return write_fits(tmp_path / "camera" / "cube.fits", np.array(frames, np.float32))


def test_a_file_of_many_frames_that_is_cut_is_reported_and_resumed(cube, processor, monkeypatch, caplog):
    """Two frames are asked for before the stop is heard; then the directory is named otherwise."""
    asked, out = [], cube.parent.parent / "out"
    monkeypatch.setattr("jitterkit.run.watch.WATCH", replace(WATCH, batch=2))
    monkeypatch.setattr(
        "jitterkit.batch.directory_watcher.is_whole", lambda path, hdu: not asked.append(path)
    )
    run = watch_directory(cube.parent, out, processor, stop=lambda: bool(asked), sleep=Camera())
    assert list(run.table["frame"]) == [0, 1]
    assert [record.args for record in caplog.records] == [(str(cube.parent), "1 frame of cube.fits")]
    monkeypatch.chdir(cube.parent.parent)
    table = watch_directory("camera", out, processor, idle=3, resume=True, sleep=Camera()).table
    assert list(table["frame"]) == [0, 1, 2]
    assert set(table["status"]) == {"ok"}


def test_a_file_that_was_replaced_between_sessions_is_warned_of(cube, processor, night, tmp_path, caplog):
    """Frames that were added are processed; what has another time or packing alone is the same file."""
    out, alone = tmp_path / "out", cube.parent / night[0].name
    copies(night[:1], cube.parent)[0]()
    watch_directory(cube.parent, out, processor, idle=3, sleep=Camera())
    frames = [frame.data for frame in read_frames(cube)]
    write_fits(alone, next(iter(read_frames(alone))).data.astype(np.float64), overwrite=True)
    for last, warned in ((frames[2], []), (frames[2] + 1, [(str(cube),)])):
        caplog.clear()
        write_fits(cube, np.array([*frames[:2], last, frames[0]], np.float32), overwrite=True)
        table = watch_directory(cube.parent, out, processor, idle=3, resume=True, sleep=Camera()).table
        assert [record.args for record in caplog.records] == warned
        assert list(table["file"]) == [alone.name, *[cube.name] * 4]
