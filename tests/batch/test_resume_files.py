"""A run goes on with the files that it knows, or not at all; the answers are what was done to the files."""

import os

import pytest
from refusals import refused

from jitterkit.batch.resume import Counted, counted, recounted
from jitterkit.errors import ErrorCode

SECOND = 1_000_000_000
WRITTEN = 1_900_000_000 * SECOND + 123_456_789


def frames_in(path):
    """A letter is a frame."""
    return len(path.read_text())


@pytest.fixture
def files(tmp_path):
    """Twelve files of one frame, all written at one time."""
    paths = [tmp_path / f"{number:02d}.fits" for number in range(12)]
    for path in paths:
        write(path, "a")
    return paths


@pytest.fixture
def known(files):
    return [counted(path, frames_in) for path in files]


def write(path, text, time=WRITTEN):
    path.write_text(text)
    os.utime(path, ns=(time, time))


def forbidden(path):
    raise AssertionError(f"{path} is counted again")


def test_files_that_are_as_they_were_are_not_counted_again(files, known):
    assert known == [Counted(1, (1, WRITTEN))] * 12
    assert recounted(files, known, forbidden, 2, range(6)) == {}
    assert recounted(files, [], forbidden, 2, ()) == {}


@pytest.mark.parametrize(
    "time",
    [
        WRITTEN // SECOND * SECOND,
        (WRITTEN // SECOND + 1) * SECOND,
        WRITTEN // 1000 * 1000,
        WRITTEN // 100 * 100,
    ],
    ids=["whole seconds", "the next second", "microseconds", "tenths of them"],
)
def test_a_time_that_a_file_system_has_rounded_is_the_same_time(files, known, time):
    write(files[3], "a", time)
    assert recounted(files, known, forbidden, 2, range(6)) == {}
    rounded = [Counted(1, (1, time))] * 12
    for path in files:
        write(path, "a")
    assert recounted(files, rounded, forbidden, 2, range(6)) == {}


@pytest.mark.parametrize(
    ("then", "now"),
    [
        (WRITTEN, WRITTEN + 1),
        (WRITTEN, WRITTEN - 100),
        (WRITTEN, WRITTEN + SECOND // 10),
        (WRITTEN, WRITTEN + 3600 * SECOND),
        (WRITTEN, (WRITTEN // SECOND + 2) * SECOND),
        (WRITTEN // SECOND * SECOND, (WRITTEN // SECOND + 1) * SECOND),
        (WRITTEN // 1000 * 1000, WRITTEN // 1000 * 1000 + 1000),
    ],
    ids=["ns", "grain", "next frame of a camera", "hour", "two seconds", "second by second", "us by us"],
)
def test_another_time_is_reported(files, then, now):
    for path in files:
        write(path, "a", then)
    known = [counted(path, frames_in) for path in files]
    write(files[3], "b", now)
    with refused(ErrorCode.CHANGED, files[3]) as caught:
        recounted(files, known, forbidden, 2, {1})
    assert "bytes" not in str(caught.value)


def test_another_size_is_reported_and_others_are_counted_with_the_remedy(files, known):
    write(files[1], "bbb")
    write(files[3], "bb")
    for done, values in [
        ({0, 1}, [files[1], "1 more", "1 bytes", "3 now"]),
        ({0, 2}, [files[1], "1 bytes", "3 now"]),
        ({1}, [files[3], "1 bytes", "2 now", "--overwrite", "--resume"]),
    ]:
        with refused(ErrorCode.CHANGED, *values) as caught:
            recounted(files, known, forbidden, 2, done)
        assert (" more" in str(caught.value)) == ("1 more" in values)


@pytest.mark.parametrize("name", ["a.toml", "frames.toml"])
@pytest.mark.parametrize("before", ["", "gain=2"])
def test_another_text_beside_a_tiff_is_reported(tmp_path, name, before):
    """It may hold the gain, and the rows that are done another one."""
    path, text = tmp_path / "a.tif", tmp_path / name
    write(path, "a")
    if before:
        write(text, before)
    known = [counted(path, frames_in)]
    write(text, "gain=3", WRITTEN + 5 * SECOND)
    with refused(ErrorCode.CHANGED, path):
        recounted([path], known, forbidden, 2, {0})


def test_a_file_of_which_nothing_was_done_is_counted_again(files, known):
    write(files[3], "b", WRITTEN + 5 * SECOND)
    write(files[11], "bbb")
    expected = {3: Counted(1, (1, WRITTEN + 5 * SECOND)), 11: Counted(3, (3, WRITTEN))}
    assert recounted(files, known, frames_in, 2, {0, 2, 3, 4}) == expected


def test_another_number_of_frames_before_what_is_done_is_refused(files, known):
    write(files[3], "bb")
    assert recounted(files, known, frames_in, 2, {0}) == {3: Counted(2, (2, WRITTEN))}
    with refused(ErrorCode.CHANGED, files[3], "was 1", "is 2"):
        recounted(files, known, frames_in, 2, {0, 5})


def test_numbers_of_frames_that_make_up_for_each_other_do_no_harm(files):
    """Two files swapped, of which no frame was done: the frames behind them are where they were."""
    write(files[4], "bb")
    known = [counted(path, frames_in) for path in files]
    write(files[4], "a")
    write(files[5], "bb")
    assert set(recounted(files, known, frames_in, 7, {1})) == {4, 5}
    write(files[5], "bbb")
    with refused(ErrorCode.CHANGED, files[4], "was 2", "is 1"):
        recounted(files, known, frames_in, 7, {1})


def test_a_file_that_showed_the_optics_to_frames_that_are_done_was_looked_at(files, known):
    """Of batches of eight the first four frames are the lead of the first four batches."""
    for path, done in [(files[3], True), (files[4], False)]:
        write(path, "b", WRITTEN + 1)
        if done:
            with refused(ErrorCode.CHANGED, path):
                recounted(files, known, frames_in, 8, {1})
            write(path, "a")
        else:
            assert set(recounted(files, known, frames_in, 8, {1})) == {4}


def test_a_file_that_is_gone_or_was_not_to_be_had_is_taken_as_it_was_counted(files, known):
    files[0].unlink()
    unasked = [*known[:5], Counted(1), *known[6:]]
    write(files[5], "bbb")
    assert recounted(files, unasked, forbidden, 2, range(6)) == {}
    assert counted(files[0], lambda path: 1) == Counted(1)


def test_what_is_written_while_it_is_counted_counts_as_changed(files):
    def slowly(path):
        write(path, "bb", WRITTEN + 1)
        return 1

    known = [counted(files[0], slowly)]
    with refused(ErrorCode.CHANGED, files[0]):
        recounted(files, known, frames_in, 1, {0})
