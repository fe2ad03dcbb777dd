"""Checksums as astropy and gzip write them: what was changed afterwards is told."""

import gzip

import numpy as np
import pytest
from astropy.io import fits
from refusals import refused

from jitterkit.errors import ErrorCode, FrameError
from jitterkit.frames import is_whole, read_frames, write_fits

IMAGE = np.random.default_rng(1).integers(0, 4000, (31, 47)).astype(np.int16)


def warnings_of(path):
    return [text for frame in read_frames(path) for text in frame.metadata.warnings]


def written(path, compressed=False):
    image = fits.CompImageHDU(IMAGE) if compressed else fits.ImageHDU(IMAGE)
    image.header["OBJECT"] = "alpha Cen"
    fits.HDUList([fits.PrimaryHDU(), image]).writeto(path, checksum=True)
    return path


@pytest.mark.parametrize("compressed", [False, True])
def test_a_file_that_was_not_changed_is_not_warned_of(tmp_path, compressed):
    assert warnings_of(written(tmp_path / "a.fits", compressed)) == []


def test_changed_pixels_do_not_have_their_checksum(tmp_path):
    path = written(tmp_path / "a.fits")
    content = bytearray(path.read_bytes())
    content[-2880] ^= 1  # of a pixel: the image takes 34 bytes of its second block
    path.write_bytes(bytes(content))
    (warning,) = warnings_of(path)
    assert "DATASUM" in warning


def test_a_changed_header_does_not_have_its_checksum(tmp_path):
    path = written(tmp_path / "a.fits")
    path.write_bytes(path.read_bytes().replace(b"alpha Cen", b"beta Cent"))
    (warning,) = warnings_of(path)
    assert "CHECKSUM" in warning


def test_a_gzip_with_a_wrong_crc_is_refused(tmp_path):
    path = write_fits(tmp_path / "a.fits", IMAGE)
    content = bytearray(gzip.compress(path.read_bytes()))
    content[-6] ^= 1
    zipped = tmp_path / "b.fits.gz"
    zipped.write_bytes(bytes(content))
    with refused(ErrorCode.DAMAGED, zipped, error=FrameError):
        list(read_frames(zipped))
    assert not is_whole(zipped)
