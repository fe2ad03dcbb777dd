"""Files that come into a directory: when they are told, how often, and what is told of the rest."""

import numpy as np
import pytest
from astropy.io import fits

from jitterkit.batch.directory_watcher import _RETIRED_AFTER, DirectoryWatcher
from jitterkit.frames import write_fits, write_tiff


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """A file that is soon read."""
    return write_fits(
        tmp_path_factory.mktemp("small") / "small.fits", np.ones((8, 8), np.float32)
    ).read_bytes()


def scanned(watcher):
    return [(path.name, index) for path, index in watcher.scan()]


def test_a_file_that_grows_to_the_end_is_reported(small, tmp_path):
    watcher = DirectoryWatcher(tmp_path)
    for size in (100, 200, 300):
        (tmp_path / "a.fits").write_bytes(small[:size])
        assert scanned(watcher) == []
    assert list(watcher.unfinished()) == [(tmp_path / "a.fits", 0)]


def test_a_file_is_taken_when_it_is_whole_and_rests(small, tmp_path):
    watcher, path = DirectoryWatcher(tmp_path), tmp_path / "a.fits"
    for size in (0, 100, 2000, 2900):
        path.write_bytes(small[:size])
        assert scanned(watcher) == []
        assert watcher.changed
    path.write_bytes(small)
    assert scanned(watcher) == []
    assert scanned(watcher) == [("a.fits", 0)]
    assert not watcher.changed
    assert scanned(watcher) == []
    assert list(watcher.unfinished()) == []


@pytest.mark.parametrize("dtype", [np.uint16, np.int16, np.float32])
def test_a_file_is_taken_when_its_zeros_have_been_written_over(dtype, tmp_path):
    """cfitsio writes the header and as many zeros as it says, and the pixels later."""
    watcher, path = DirectoryWatcher(tmp_path), tmp_path / "a.fits"
    pixels = np.arange(64, dtype=dtype).reshape(8, 8)
    written = write_fits(tmp_path / "whole.part", pixels).read_bytes()
    path.write_bytes(written[:2880] + bytes(len(written) - 2880))
    assert [scanned(watcher) for _ in range(5)] == [[]] * 5
    path.write_bytes(written)
    assert [scanned(watcher) for _ in range(2)] == [[], [("a.fits", 0)]]


def test_a_file_that_rests_unfinished_is_taken_when_it_is_finished_later(small, tmp_path):
    watcher, path = DirectoryWatcher(tmp_path), tmp_path / "a.fits"
    path.write_bytes(small[:2900])
    assert [scanned(watcher) for _ in range(20)] == [[]] * 20
    assert list(watcher.unfinished()) == [(path, 0)]
    path.write_bytes(small)
    assert [scanned(watcher) for _ in range(2)] == [[], [("a.fits", 0)]]


def test_frames_that_are_added_to_a_file_are_taken_and_none_twice(tmp_path):
    watcher, path = DirectoryWatcher(tmp_path, done={("a.tif", 1): ""}), tmp_path / "a.tif"
    for pages, expected in ((1, [("a.tif", 0)]), (3, [("a.tif", 2)]), (4, [("a.tif", 3)])):
        write_tiff(path, np.ones((pages, 8, 8), np.uint16), overwrite=True)
        assert [scanned(watcher) for _ in range(3)] == [[], expected, []]


def test_what_has_rested_for_long_is_not_looked_at_again(small, tmp_path, monkeypatch):
    (tmp_path / "a.fits").write_bytes(small)
    watcher = DirectoryWatcher(tmp_path)
    for _ in range(_RETIRED_AFTER + 2):
        scanned(watcher)
    monkeypatch.setattr("pathlib.Path.stat", None)  # whoever asks is told
    assert scanned(watcher) == []


def test_only_frames_of_the_directory_itself_count(small, tmp_path):
    for name in ("a.fits", ".hidden.fits", "results.ecsv", "out/b.fits"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(small)
    watcher = DirectoryWatcher(tmp_path)
    assert [scanned(watcher) for _ in range(2)] == [[], [("a.fits", 0)]]


def test_a_directory_that_is_lost_for_a_while_is_waited_for(small, tmp_path, caplog):
    where = tmp_path / "camera"
    where.mkdir()
    (where / "a.fits").write_bytes(small)
    watcher = DirectoryWatcher(where)
    assert [scanned(watcher) for _ in range(2)] == [[], [("a.fits", 0)]]
    where.rename(tmp_path / "elsewhere")
    assert [scanned(watcher) for _ in range(2)] == [[], []]
    assert [record.args[0] for record in caplog.records] == [where]
    (tmp_path / "elsewhere").rename(where)
    assert [scanned(watcher) for _ in range(3)] == [[], [], []]


@pytest.fixture
def taken(small, tmp_path):
    """What watches a directory, and a file in it that was told."""
    path = tmp_path / "a.fits"
    path.write_bytes(small)
    watcher = DirectoryWatcher(tmp_path)
    assert [scanned(watcher) for _ in range(2)] == [[], [("a.fits", 0)]]
    return watcher, path


def test_a_frame_that_was_rewritten_counts_once(taken, small, caplog):
    watcher, path = taken
    path.write_bytes(small + bytes(2880))
    assert [scanned(watcher) for _ in range(5)] == [[]] * 5
    (message,) = caplog.messages
    assert str(path) in message
    assert list(watcher.unfinished()) == []


def test_a_file_rewritten_page_by_page_has_each_frame_once(tmp_path):
    watcher, path = DirectoryWatcher(tmp_path), tmp_path / "a.tif"
    for pages, expected in ((2, [("a.tif", 0), ("a.tif", 1)]), (1, []), (3, [("a.tif", 2)])):
        write_tiff(path, np.ones((pages, 8, 8), np.uint16), overwrite=True)
        assert [scanned(watcher) for _ in range(3)] == [[], expected, []]


def test_a_frame_that_could_not_be_read_is_yielded_again_when_its_file_has_changed(taken, small, caplog):
    watcher, path = taken
    path.write_bytes(small[:2900])
    watcher.retry(path, 0)
    assert [record.args for record in caplog.records] == [(str(path),)]
    assert [scanned(watcher) for _ in range(9)] == [[]] * 9
    assert list(watcher.unfinished()) == [(path, 0)]
    path.write_bytes(small)
    assert [scanned(watcher) for _ in range(3)] == [[], [("a.fits", 0)], []]
    assert list(watcher.unfinished()) == []


def test_a_frame_that_could_not_be_read_though_nothing_changed_is_yielded_again_now_and_then(taken):
    watcher, path = taken
    found = []
    for scan in range(2, 17):
        watcher.retry(path, 0)
        found += [scan] * len(scanned(watcher))
    assert found == [2, 4, 8, 16]


def test_only_the_frames_that_could_not_be_read_are_yielded_again(tmp_path):
    """Two of three; the file has one page for a while then."""
    watcher, path = DirectoryWatcher(tmp_path), tmp_path / "a.tif"
    write_tiff(path, np.ones((3, 8, 8), np.uint16))
    assert [len(scanned(watcher)) for _ in range(2)] == [0, 3]
    for index in (0, 2):
        watcher.retry(path, index)
    for pages, expected in ((1, [("a.tif", 0)]), (4, [("a.tif", 2), ("a.tif", 3)])):
        write_tiff(path, np.ones((pages, 8, 8), np.uint16), overwrite=True)
        assert [scanned(watcher) for _ in range(3)] == [[], expected, []]


def test_a_file_of_which_nothing_was_read_and_that_is_gone_is_forgotten(taken, small):
    """It may have been given another name: it is told under that one."""
    watcher, path = taken
    watcher.retry(path, 0)
    path.rename(path.with_name("b.fits"))
    assert [scanned(watcher) for _ in range(3)] == [[], [("b.fits", 0)], []]
    assert list(watcher.unfinished()) == []


def test_a_frame_that_is_taken_back_late_is_yielded_again(taken, small):
    watcher, path = taken
    for _ in range(_RETIRED_AFTER + 2):
        scanned(watcher)
    watcher.retry(path, 0)
    path.write_bytes(small + bytes(2880))
    assert [scanned(watcher) for _ in range(3)] == [[], [("a.fits", 0)], []]


def test_a_file_is_whole_with_the_hdu_that_was_asked_for_and_not_before(tmp_path):
    path, image = tmp_path / "a.fits", np.ones((8, 8), np.float32)
    fits.HDUList([fits.PrimaryHDU(image), fits.ImageHDU(image)]).writeto(path)
    content = path.read_bytes()
    first, second = DirectoryWatcher(tmp_path), DirectoryWatcher(tmp_path, hdu=1)
    path.write_bytes(content[:5760])
    assert [scanned(first) for _ in range(3)] == [[], [("a.fits", 0)], []]
    assert [scanned(second) for _ in range(3)] == [[]] * 3
    assert list(second.unfinished()) == [(path, 0)]
    path.write_bytes(content)
    assert [scanned(second) for _ in range(3)] == [[], [("a.fits", 0)], []]
    assert [scanned(first) for _ in range(3)] == [[]] * 3


def test_frames_that_nobody_asked_for_are_counted(small, tmp_path):
    write_tiff(tmp_path / "a.tif", np.ones((3, 8, 8), np.uint16))
    watcher = DirectoryWatcher(tmp_path, done={("c.fits", 0): ""})
    scanned(watcher)
    for name in ("b.fits", "c.fits", "d.fits"):
        (tmp_path / name).write_bytes(small)
    scan = watcher.scan()
    assert watcher.pending() == "1 file"
    next(scan)
    assert watcher.pending() == "2 frames of a.tif"
    for _ in scan:
        pass
    assert watcher.pending() == "2 files"
    scanned(watcher)
    assert watcher.pending() == ""
