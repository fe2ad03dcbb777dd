"""Which files are frames, and what the others are called."""

import errno
import gzip
import os
import subprocess
import sys

import numpy as np
import pytest
from refusals import refused

from jitterkit.errors import ErrorCode, FrameError
from jitterkit.frames import find_files, open_frames, write_fits, write_tiff
from jitterkit.frames.files import damage_code

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
    with refused(ErrorCode.NOT_FOUND, tmp_path / "no.fits", error=FrameError):
        find_files([tmp_path / "no.fits"])
    with refused(ErrorCode.NOT_FOUND, tmp_path / "no.fits", error=FrameError):
        open_frames(tmp_path / "no.fits")


def test_a_directory_without_frames_is_said_to_be_so(tmp_path):
    with refused(ErrorCode.NO_IMAGE, tmp_path, error=FrameError):
        find_files([tmp_path])
    with refused(ErrorCode.NOT_READABLE, tmp_path, error=FrameError):
        open_frames(tmp_path)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no pipes with a name")
def test_a_pipe_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "a.fits")
    with refused(ErrorCode.NOT_READABLE, tmp_path / "a.fits", error=FrameError):
        open_frames(tmp_path / "a.fits")


def test_content_decides_and_not_the_name(tmp_path):
    write_fits(tmp_path / "a.fits", IMAGE).rename(tmp_path / "a.tif")
    write_tiff(tmp_path / "b.tif", IMAGE).rename(tmp_path / "b.fits")
    with open_frames(tmp_path / "a.tif") as first, open_frames(tmp_path / "b.fits") as second:
        assert (first.kind, second.kind) == ("FITS", "TIFF")


@pytest.mark.parametrize(
    ("content", "code", "value"),
    [
        (b"", ErrorCode.TRUNCATED, "0 bytes"),
        (b"exposure = 3\n" * 50, ErrorCode.UNKNOWN_FORMAT, "'exposure = 3'"),
        ("größe".encode() * 60, ErrorCode.UNKNOWN_FORMAT, f"'{8 * 'größe'}'"),
        (b"\x89PNG\r\n\x1a\n" + bytes(300), ErrorCode.UNKNOWN_FORMAT, "PNG"),
        (b"\xff\xd8\xff\xe0" + bytes(300), ErrorCode.UNKNOWN_FORMAT, "JPEG"),
        (b"\x89HDF\r\n" + bytes(300), ErrorCode.UNKNOWN_FORMAT, "HDF5"),
        (b"<!DOCTYPE html><html>", ErrorCode.UNKNOWN_FORMAT, "web page"),
        (b"BZh91AY&SY", ErrorCode.UNKNOWN_FORMAT, "bzip2"),
        (bytes(4096), ErrorCode.UNKNOWN_FORMAT, "00 00 00 00 00 00 00 00"),
        # no time: its bytes name the test
        (gzip.compress(b"hello there", mtime=0), ErrorCode.UNKNOWN_FORMAT, "'hello there'"),
        (b"\x1f\x8b\x08\x00\x00", ErrorCode.TRUNCATED, "end-of-stream marker"),
        (b"\x1f\x8b\x08\x00" + bytes(60), ErrorCode.DAMAGED, "Error -3"),
    ],
)
def test_a_file_that_is_no_frame_is_called_by_its_name(tmp_path, content, code, value):
    path = tmp_path / "frame.fits"
    path.write_bytes(content)
    with refused(code, path, value, error=FrameError):
        open_frames(path)


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (FileNotFoundError(errno.ENOENT, "No such file or directory"), ErrorCode.NOT_FOUND),
        (NotADirectoryError(errno.ENOTDIR, "Not a directory"), ErrorCode.NOT_FOUND),
        (PermissionError(errno.EACCES, "Permission denied"), ErrorCode.NOT_READABLE),
        (OSError(errno.EIO, "Input/output error"), ErrorCode.NOT_READABLE),
        (OSError(errno.EINVAL, "Invalid argument"), ErrorCode.DAMAGED),  # a place before the file's beginning
        (OSError("No SIMPLE card found"), ErrorCode.DAMAGED),  # astropy's
        (gzip.BadGzipFile("CRC check failed"), ErrorCode.DAMAGED),
        (EOFError("ended before the end-of-stream marker"), ErrorCode.DAMAGED),
        (NotImplementedError("of float24"), ErrorCode.UNSUPPORTED_ENCODING),
        (KeyError("a tag"), ErrorCode.DAMAGED),
    ],
    ids=lambda value: type(value).__name__,
)
def test_an_exception_of_a_library_has_the_damage_code_its_cause(tmp_path, error, code):
    path = write_fits(tmp_path / "a.fits", IMAGE)
    assert damage_code(error, path) is code


def test_a_stream_that_ends_is_the_end_of_a_gzipped_file_and_of_no_other(tmp_path):
    error = EOFError("ended before the end-of-stream marker")
    assert damage_code(error, write_fits(tmp_path / "a.fits.gz", IMAGE)) is ErrorCode.TRUNCATED
    assert damage_code(error, write_fits(tmp_path / "a.fits.fz", IMAGE)) is ErrorCode.DAMAGED
    assert damage_code(error, tmp_path / "gone.fits.gz") is ErrorCode.DAMAGED


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="the superuser may read everything")
def test_a_file_that_may_not_be_read_is_said_to_be_so(tmp_path):
    path = write_fits(tmp_path / "a.fits", IMAGE)
    path.chmod(0)
    with refused(ErrorCode.NOT_READABLE, path, error=FrameError):
        open_frames(path)


def test_a_file_whose_disk_fails_is_said_to_be_unreadable(tmp_path, monkeypatch):
    path = write_fits(tmp_path / "a.fits", IMAGE)

    def fail(*_, **__):
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr(type(path), "open", fail)
    with refused(ErrorCode.NOT_READABLE, path, "Input/output error", error=FrameError):
        open_frames(path)


def test_importing_the_package_loads_no_format_library():
    code = "import jitterkit.frames, sys; print([m for m in sys.modules if m in "
    code += "('astropy', 'tifffile', 'cv2', 'jax', 'scipy')])"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "[]"
