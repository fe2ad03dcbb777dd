"""Files that change while they are read, and whether a file is whole."""

import gzip
import os
import threading
import warnings

import numpy as np
import pytest
import tifffile
from refusals import refused

from jitterkit.errors import ErrorCode, FrameError
from jitterkit.frames import is_whole, open_frames, read_frames, write_fits, write_tiff

NOISE = np.random.default_rng(5).integers(0, 60000, (3, 30, 40)).astype(np.uint16)
WRITERS = {"a.fits": write_fits, "a.fits.gz": write_fits, "a.fits.fz": write_fits, "a.tif": write_tiff}


def later(path):
    """Move the time of change on, as the clock of a file system would between two writes."""
    told = path.stat()
    os.utime(path, ns=(told.st_atime_ns, told.st_mtime_ns + 10_000_000))


def grow(path):
    with path.open("ab") as handle:
        handle.write(bytes(2880))


def shrink(path):
    with path.open("r+b") as handle:
        handle.truncate(path.stat().st_size - 1000)


def overwrite(path):
    content = path.read_bytes()
    path.write_bytes(content[:-1] + bytes([content[-1] ^ 1]))
    later(path)


def replace(path):
    other = path.with_name("other")
    other.write_bytes(path.read_bytes())
    other.rename(path)


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.parametrize(
    "change", [grow, shrink, overwrite, replace, os.unlink], ids=lambda change: change.__name__
)
def test_a_file_that_changes_while_it_is_read_gives_no_more_frames(tmp_path, name, change):
    path = WRITERS[name](tmp_path / name, NOISE)
    with open_frames(path) as file:
        np.testing.assert_array_equal(file[0].data, NOISE[0])
        change(path)
        code = ErrorCode.NOT_FOUND if change is os.unlink else ErrorCode.CHANGED
        with refused(code, path, error=FrameError):
            file[1]


def test_the_change_is_given_in_bytes(tmp_path):
    path = write_fits(tmp_path / "a.fits", NOISE)
    with open_frames(path) as file:
        grow(path)
        with refused(ErrorCode.CHANGED, path, 11520, 14400, error=FrameError):
            file[0]
    with open_frames(path) as file:
        overwrite(path)
        with refused(ErrorCode.CHANGED, path, 14400, error=FrameError):
            file[0]


@pytest.mark.parametrize("name", WRITERS)
def test_a_file_is_whole_with_its_last_byte_and_not_before(tmp_path, name):
    content = WRITERS[name](tmp_path / name, NOISE).read_bytes()
    path = tmp_path / f"growing-{name}"
    # a FITS may lack its padding, and a TIFF may end with numbers that nobody needs
    padding = 2880 if name in ("a.fits", "a.fits.fz") else 0
    for keep in np.linspace(0, len(content) - padding - 1, 30).astype(int):
        path.write_bytes(content[:keep])
        assert not is_whole(path) or name == "a.tif", keep
    path.write_bytes(content)
    assert is_whole(path)


def test_a_tiff_cut_in_its_pixels_is_not_whole(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", NOISE[0], metadata=None)
    content = (tmp_path / "a.tif").read_bytes()
    assert is_whole(tmp_path / "a.tif")
    for keep in (0, 4, 8, 100, len(content) // 2, len(content) - 1):
        (tmp_path / "a.tif").write_bytes(content[:keep])
        assert not is_whole(tmp_path / "a.tif"), keep


def test_a_zip_without_its_checksum_is_not_whole(tmp_path):
    path = write_fits(tmp_path / "a.fits.gz", NOISE[0])
    content = path.read_bytes()
    path.write_bytes(content[:-8])
    assert not is_whole(path)  # though the pixels are there
    path.write_bytes(content[:-8] + bytes(8))
    assert not is_whole(path)
    path.write_bytes(gzip.compress(gzip.decompress(content)))
    assert is_whole(path)


def test_a_damaged_plane_in_the_middle_is_found(tmp_path):
    path = tmp_path / "a.tif"
    tifffile.imwrite(path, NOISE, compression="zlib", metadata=None, photometric="minisblack")
    content = bytearray(path.read_bytes())
    with tifffile.TiffFile(path) as tiff:
        start, length = tiff.pages[1].dataoffsets[0], tiff.pages[1].databytecounts[0]
    content[start : start + length] = bytes(length)
    path.write_bytes(content)
    assert not is_whole(path)


def test_what_is_no_frame_file_is_not_whole(tmp_path):
    assert not is_whole(tmp_path / "missing.fits")
    assert not is_whole(tmp_path)
    (tmp_path / "a.txt").write_text("hello")
    assert not is_whole(str(tmp_path / "a.txt"))


def test_a_tiff_whose_toml_is_half_written_is_not_whole(tmp_path):
    write_tiff(tmp_path / "a.tif", NOISE, metadata={"gain": 2.0})
    assert is_whole(tmp_path / "a.tif")
    (tmp_path / "a.toml").write_text("gain = ")
    assert not is_whole(tmp_path / "a.tif")


def test_threads_that_read_leave_the_warnings_as_they_were(tmp_path):
    path = write_fits(tmp_path / "a.fits", NOISE[0])
    before = list(warnings.filters), warnings.showwarning

    def read():
        for _ in range(40):
            list(read_frames(path))

    threads = [threading.Thread(target=read) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert (list(warnings.filters), warnings.showwarning) == before


def test_what_another_thread_warns_of_is_no_remark_on_a_file(tmp_path):
    path = write_fits(tmp_path / "a.fits", np.ones((8, 8), np.uint16))
    busy = threading.Event()

    def warn() -> None:
        while not busy.is_set():
            warnings.warn("of something else", RuntimeWarning, stacklevel=1)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        thread = threading.Thread(target=warn)
        thread.start()
        try:
            for _ in range(50):
                with open_frames(path) as file:
                    assert file[0].metadata.warnings == ()
        finally:
            busy.set()
            thread.join()
