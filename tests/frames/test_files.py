"""Which files are frames, and what the others are called."""

import gzip
import os
import subprocess
import sys

import numpy as np
import pytest

from jitterkit.errors import FrameError
from jitterkit.frames import find_files, open_frames, write_fits, write_tiff

IMAGE = np.ones((4, 5), np.uint16)


def test_a_directory_stands_for_its_frames_in_order(tmp_path):
    names = ["b.FITS", "a.tif", "c.fits.gz", "d.fits.fz", "e.TIFF", "f.fit", "g.fts"]
    for name in [*names, "notes.txt", ".hidden.fits", "frames.toml"]:
        (tmp_path / name).touch()
    (tmp_path / "inner.fits").mkdir()
    assert [path.name for path in find_files([tmp_path])] == sorted(names)


def test_a_named_file_is_taken_whatever_its_name_and_once(tmp_path):
    odd, other = tmp_path / "frame.dat", tmp_path / "a.fits"
    odd.touch()
    other.touch()
    assert find_files([str(odd), tmp_path, odd]) == [odd, other]


def test_what_does_not_exist_is_said_to_be_missing(tmp_path):
    with pytest.raises(FrameError, match=r"no.fits: does not exist; check the name"):
        find_files([tmp_path / "no.fits"])
    with pytest.raises(FrameError, match=r"no.fits: does not exist"):
        open_frames(tmp_path / "no.fits")


def test_a_directory_without_frames_is_said_to_be_so(tmp_path):
    with pytest.raises(FrameError, match="is a directory without FITS or TIFF files"):
        find_files([tmp_path])
    with pytest.raises(FrameError, match="is a directory; name a file in it"):
        open_frames(tmp_path)


def test_content_decides_and_not_the_name(tmp_path):
    write_fits(tmp_path / "a.fits", IMAGE).rename(tmp_path / "a.tif")
    write_tiff(tmp_path / "b.tif", IMAGE).rename(tmp_path / "b.fits")
    with open_frames(tmp_path / "a.tif") as first, open_frames(tmp_path / "b.fits") as second:
        assert (first.kind, second.kind) == ("FITS", "TIFF")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", r"is empty \(0 bytes\); copy it again"),
        (b"exposure = 3\n" * 50, r"is a text file \(it begins 'exposure = 3'\), not a FITS or TIFF file"),
        ("größe".encode() * 60, "is a text file"),
        (b"\x89PNG\r\n\x1a\n" + bytes(300), "is a PNG image"),
        (b"\xff\xd8\xff\xe0" + bytes(300), "is a JPEG image"),
        (b"\x89HDF\r\n" + bytes(300), "is an HDF5 file"),
        (b"<!DOCTYPE html><html>", "is a web page"),
        (b"BZh91AY&SY", "is a bzip2 archive"),
        (bytes(4096), "is of unknown kind"),
        (gzip.compress(b"hello there", mtime=0), "is a text file"),  # no time: its bytes name the test
        (b"\x1f\x8b\x08\x00\x00", "cannot be read"),
    ],
)
def test_a_file_that_is_no_frame_is_called_by_its_name(tmp_path, content, words):
    path = tmp_path / "frame.fits"
    path.write_bytes(content)
    with pytest.raises(FrameError, match=words):
        open_frames(path)


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="the superuser may read everything")
def test_a_file_that_may_not_be_read_is_said_to_be_so(tmp_path):
    path = write_fits(tmp_path / "a.fits", IMAGE)
    path.chmod(0)
    with pytest.raises(FrameError, match=r"cannot be read .Permission denied."):
        open_frames(path)


def test_importing_the_package_loads_no_format_library():
    code = "import jitterkit.frames, sys; print([m for m in sys.modules if m in "
    code += "('astropy', 'tifffile', 'cv2', 'jax', 'scipy')])"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "[]"
