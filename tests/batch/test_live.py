"""Frames that arrive while they are watched for, against those that were there; the test is the camera."""

from dataclasses import replace

import numpy as np
import pytest

from jitterkit.batch import Processor, process_files
from jitterkit.batch.arrivals import _RESTING, Arrivals
from jitterkit.batch.live import watch_directory
from jitterkit.errors import ConfigurationError, FrameError
from jitterkit.frames import write_fits, write_tiff
from jitterkit.optics import obstructed_circle

COUNT = 20


@pytest.fixture(scope="module")
def bent(telescope):
    """A small telescope with an aberration, so that frames have an anchor."""
    return replace(telescope, pupil_from=obstructed_circle(0.09, 0.03, noll=(7,), samples=64), shape=(40, 40))


@pytest.fixture(scope="module")
def processor(bent):
    return Processor(bent, locus="mvn")


@pytest.fixture(scope="module")
def night(bent, drawn_by, tmp_path_factory):
    directory, rng = tmp_path_factory.mktemp("night"), np.random.default_rng(12)
    for number in range(COUNT):
        image = drawn_by(bent, rng, aberrations=[15.0]).raw.data
        write_fits(directory / f"{number:02d}.fits", image.astype(np.float32))
    return sorted(directory.iterdir())


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """A file that is soon read."""
    return write_fits(
        tmp_path_factory.mktemp("small") / "small.fits", np.ones((8, 8), np.float32)
    ).read_bytes()


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


def test_numbers_agree_with_those_of_a_run_of_the_same_files(watched, night, processor, tmp_path):
    """A fit ends within 1e-4 standard errors; optics about other frames move it by a thousandth."""
    table = process_files(night[:-1], tmp_path / "out", processor).table
    for name in ("separation", "theta", "x"):
        off = (watched[0].table[name][:-1] - table[name]) / table[f"{name}_err"]
        assert np.abs(off).max() < 2e-3


def test_a_file_that_is_never_finished_is_told_at_the_end_with_the_reason(watched):
    run, rows, _ = watched
    assert "truncated" in rows[-1]["message"]
    assert run.summary["status"] == {"ok": 19, "unreadable": 1}


def test_a_watch_that_is_resumed_does_what_is_left_and_nothing_twice(watched, night, processor):
    """The half-written file has been finished meanwhile; outputs lie among the frames."""
    run, _, where = watched
    (where / night[-1].name).write_bytes(night[-1].read_bytes())
    table = watch_directory(where, where, processor, idle=2, resume=True, sleep=Camera()).table
    assert list(table["file"]) == [path.name for path in night]
    assert set(table["status"]) == {"ok"}
    assert list(table["seconds"][:-1]) == list(run.table["seconds"][:-1])  # not fitted again


def test_a_watch_that_is_told_to_stop_ends_with_what_it_has_begun(night, processor, tmp_path, monkeypatch):
    """It is told while it reads the second of many files."""
    read = []

    def noted(path):
        read.append(path)
        return True

    monkeypatch.setattr("jitterkit.batch.arrivals.is_whole", noted)
    monkeypatch.setattr("jitterkit.batch.live._AT_ONCE", 2)
    run = watch_directory(
        night[0].parent, tmp_path / "out", processor, stop=lambda: len(read) >= 2, sleep=Camera()
    )
    assert names(run) == [path.name for path in night[:2]]
    assert (tmp_path / "out" / "report.html").exists()


def test_a_file_that_grows_to_the_end_is_told(small, tmp_path):
    arrivals = Arrivals(tmp_path)
    for size in (100, 200, 300):
        (tmp_path / "a.fits").write_bytes(small[:size])
        assert told(arrivals) == []
    assert arrivals.unfinished() == [(tmp_path / "a.fits", 0)]


def test_a_watch_without_a_frame_says_so(processor, tmp_path):
    with pytest.raises(FrameError, match="has shown no frame; see where the camera writes"):
        watch_directory(tmp_path, tmp_path / "out", processor, idle=1, sleep=Camera())


def test_what_is_no_directory_is_told(night, processor, tmp_path):
    with pytest.raises(FrameError, match="is not a directory; give the one into which the camera writes"):
        watch_directory(night[0], tmp_path / "out", processor)


def test_a_run_of_process_is_not_gone_on_with_by_watch(night, processor, tmp_path):
    process_files(night[:1], tmp_path / "out", processor)
    with pytest.raises(ConfigurationError, match="was begun"):
        watch_directory(night[0].parent, tmp_path / "out", processor, resume=True)


def told(arrivals):
    return [(path.name, index) for path, index in arrivals.look()]


def test_a_file_is_taken_when_it_is_whole_and_rests(small, tmp_path):
    arrivals, path = Arrivals(tmp_path), tmp_path / "a.fits"
    for size in (0, 100, 2000, 2900):
        path.write_bytes(small[:size])
        assert told(arrivals) == []
        assert arrivals.stirred
    path.write_bytes(small)
    assert told(arrivals) == []
    assert told(arrivals) == [("a.fits", 0)]
    assert not arrivals.stirred
    assert told(arrivals) == []
    assert arrivals.unfinished() == []


def test_a_file_that_rests_unfinished_is_taken_when_it_is_finished_later(small, tmp_path):
    arrivals, path = Arrivals(tmp_path), tmp_path / "a.fits"
    path.write_bytes(small[:2900])
    assert [told(arrivals) for _ in range(20)] == [[]] * 20
    assert arrivals.unfinished() == [(path, 0)]
    path.write_bytes(small)
    assert [told(arrivals) for _ in range(2)] == [[], [("a.fits", 0)]]


def test_frames_that_are_added_to_a_file_are_taken_and_none_twice(tmp_path):
    arrivals, path = Arrivals(tmp_path, done={(str(tmp_path / "a.tif"), 1)}), tmp_path / "a.tif"
    for pages, expected in ((1, [("a.tif", 0)]), (3, [("a.tif", 2)]), (4, [("a.tif", 3)])):
        write_tiff(path, np.ones((pages, 8, 8), np.uint16), overwrite=True)
        assert [told(arrivals) for _ in range(3)] == [[], expected, []]


def test_what_has_rested_for_long_is_not_looked_at_again(small, tmp_path, monkeypatch):
    (tmp_path / "a.fits").write_bytes(small)
    arrivals = Arrivals(tmp_path)
    for _ in range(_RESTING + 2):
        told(arrivals)
    monkeypatch.setattr("pathlib.Path.stat", None)  # whoever asks is told
    assert told(arrivals) == []


def test_only_frames_of_the_directory_itself_count(small, tmp_path):
    for name in ("a.fits", ".hidden.fits", "results.ecsv", "out/b.fits"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(small)
    arrivals = Arrivals(tmp_path)
    assert [told(arrivals) for _ in range(2)] == [[], [("a.fits", 0)]]


def test_a_directory_that_is_lost_for_a_while_is_waited_for(small, tmp_path, caplog):
    where = tmp_path / "camera"
    where.mkdir()
    (where / "a.fits").write_bytes(small)
    arrivals = Arrivals(where)
    assert [told(arrivals) for _ in range(2)] == [[], [("a.fits", 0)]]
    where.rename(tmp_path / "elsewhere")
    assert [told(arrivals) for _ in range(2)] == [[], []]
    assert [record.getMessage().split(" (")[0] for record in caplog.records] == [f"{where} cannot be listed"]
    (tmp_path / "elsewhere").rename(where)
    assert [told(arrivals) for _ in range(3)] == [[], [], []]
