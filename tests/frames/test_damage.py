"""Damage of any kind ends in a frame or a sentence, and soon."""

import gzip
import re
import time

import numpy as np
import pytest
import tifffile
from astropy.io import fits
from fuzz_reading import REFUSALS
from refusals import refused

from jitterkit.errors import ErrorCode, FrameError
from jitterkit.frames import open_frames, read_frames, write_fits, write_tiff

STACK = np.random.default_rng(0).integers(0, 4000, (3, 20, 30)).astype(np.uint16)


def imagej(path, stack):
    options = {"imagej": True, "truncate": True, "metadata": {"axes": "TYX"}}
    tifffile.imwrite(path, stack, **options)
    return path


MAKERS = {
    "a.fits": lambda path: write_fits(path, STACK, header={"EXPTIME": 1.0, "EGAIN": 2.0}),
    "a.fits.fz": lambda path: write_fits(path, STACK.astype(np.float32)),
    "a.fits.gz": lambda path: write_fits(path, STACK),
    "a.tif": lambda path: write_tiff(path, STACK),
    "imagej.tif": lambda path: imagej(path, STACK),
}


def damaged(rng, content):
    """Change a few bytes, most of them near the beginning, and cut one file in ten short."""
    content = bytearray(content)
    reach = min(len(content), 6000) if rng.random() < 0.7 else len(content)
    for _ in range(rng.integers(1, 8)):
        character = ord(rng.choice(list("0123456789 TF'/=")))
        content[rng.integers(reach)] = rng.integers(256) if rng.random() < 0.5 else character
    return bytes(content[: rng.integers(1, len(content))] if rng.random() < 0.1 else content)


def outcome(path):
    """Read everything; return None where it is finite, and the error where it is refused."""
    try:
        assert all(np.isfinite(frame.data).all() for frame in read_frames(path))
    except FrameError as error:
        return error
    return None


@pytest.mark.parametrize("name", MAKERS)
def test_a_damaged_file_gives_finite_frames_or_one_sentence(tmp_path, name):
    rng = np.random.default_rng(len(name))
    whole = MAKERS[name](tmp_path / name).read_bytes()
    rounds = 60 if name.endswith(".fz") else 150  # decompressing is slow
    path = tmp_path / f"damaged{name}"
    slowest = 0.0
    for _ in range(rounds):
        path.write_bytes(damaged(rng, whole))
        start = time.perf_counter()
        error = outcome(path)
        slowest = max(slowest, time.perf_counter() - start)
        if error is not None:
            assert error.code in REFUSALS
            assert re.fullmatch(rf".*{re.escape(path.name)}: .+; .+\.", str(error))
    assert slowest < 5  # a hang would take minutes; the machine may be busy


@pytest.mark.parametrize("pack", [bytes, gzip.compress])
def test_a_damaged_primary_header_is_no_endless_file(tmp_path, pack):
    # of this header astropy makes HDU after HDU
    content = write_fits(tmp_path / "a.fits", STACK).read_bytes()
    content = content.replace(b"SIMPLE  =                    T", b"SIMPLE  =           =        T")
    (tmp_path / "b.fits").write_bytes(pack(content))
    with refused(ErrorCode.DAMAGED, tmp_path / "b.fits", "SIMPLE", error=FrameError):
        open_frames(tmp_path / "b.fits")


@pytest.mark.parametrize("name", MAKERS)
def test_a_file_cut_anywhere_is_called_truncated(tmp_path, name):
    whole = MAKERS[name](tmp_path / name).read_bytes()
    path = tmp_path / f"cut{name}"
    for keep in np.linspace(8, len(whole) - 1, 80).astype(int):  # of fewer bytes nobody sees what they were
        path.write_bytes(whole[:keep])
        error = outcome(path)
        if error is None:  # only what nobody needs is missing
            assert keep > 0.5 * len(whole)
        else:
            assert error.code is ErrorCode.TRUNCATED, f"{keep} of {len(whole)} bytes: {error}"


def test_an_image_that_was_to_follow_a_table_is_truncated_and_not_forgotten(tmp_path):
    table = fits.BinTableHDU.from_columns([fits.Column("x", "E", array=np.ones(3000))])
    fits.HDUList([fits.PrimaryHDU(), table, fits.ImageHDU(STACK)]).writeto(tmp_path / "a.fits")
    whole = (tmp_path / "a.fits").read_bytes()
    image = whole.index(b"XTENSION= 'IMAGE")
    for keep in (2000, 2881, 4000, 2 * 2880 + 5000, image + 80, image + 2880 + 100):
        (tmp_path / "a.fits").write_bytes(whole[:keep])
        with refused(ErrorCode.TRUNCATED, tmp_path / "a.fits", error=FrameError):
            open_frames(tmp_path / "a.fits")
        if keep < image:
            with refused(ErrorCode.TRUNCATED, "HDU 2", error=FrameError):
                open_frames(tmp_path / "a.fits", hdu=2)
    for follows in (b"", b"junk" * 2000):
        (tmp_path / "a.fits").write_bytes(whole[:image] + follows)
        with refused(ErrorCode.NO_IMAGE, "HDU 0", "HDU 1", error=FrameError):
            open_frames(tmp_path / "a.fits")
