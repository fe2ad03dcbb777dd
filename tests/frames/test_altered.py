"""Pixels of 8 to 14 bits that a program has scaled to 16, and good pixels that are not taken for them."""

import numpy as np
import pytest
import tifffile
from astropy.io import fits

from jitterkit.frames import read_frames

BITS = (8, 10, 12, 14)
Y, X = np.mgrid[:60, :70]


def codes(bits, sigma=0.004, seed=2):
    """Readings of a star on a sky, of a converter with few bits."""
    full = (1 << bits) - 1
    star = 0.7 * np.exp(-((X - 30) ** 2 + (Y - 31) ** 2) / 50)
    noise = np.random.default_rng(seed).normal(0.06, max(sigma, 0.6 / full), Y.shape)
    return np.clip(np.rint(full * (star + noise)), 0, full).astype(np.int64)


def shifted(values, bits):
    return values << (16 - bits)


def repeated(values, bits):
    """The upper bits again in the lower ones, as image libraries expand."""
    whole = values << (16 - bits)
    return whole | (whole >> bits) if bits > 8 else values * 257


def stretched(values, bits):
    return np.rint(values * (65535 / ((1 << bits) - 1))).astype(np.int64)


def warned(path):
    (frame,) = read_frames(path)
    return [text for text in frame.metadata.warnings if text.startswith("pixels are")]


def as_fits(tmp_path, data, **cards):
    fits.PrimaryHDU(data, fits.Header(cards)).writeto(tmp_path / "a.fits")
    return warned(tmp_path / "a.fits")


def as_tiff(tmp_path, data, toml=""):
    tifffile.imwrite(tmp_path / "a.tif", data)
    (tmp_path / "a.toml").write_text(toml)
    return warned(tmp_path / "a.tif")


@pytest.mark.parametrize("bits", BITS)
@pytest.mark.parametrize("scale", [shifted, repeated, stretched])
@pytest.mark.parametrize("dtype", [np.uint16, np.float32])
def test_pixels_of_few_bits_are_recognised_with_and_without_a_gain(tmp_path, bits, scale, dtype):
    data = scale(codes(bits), bits).astype(dtype)
    (found,) = as_fits(tmp_path, data, EGAIN=4.0)
    assert f"{bits} bits" in found
    factor = 1 << (16 - bits) if scale is shifted else 65535 / ((1 << bits) - 1)
    assert float(found.rsplit(" ", 1)[1]) == pytest.approx(4 / factor, rel=5e-3)
    (found,) = as_tiff(tmp_path, data, "gain = 4.0")
    assert f"{bits} bits" in found
    assert "a.toml" in found
    (found,) = as_tiff(tmp_path, data)
    assert f"{bits} bits" in found


@pytest.mark.parametrize("scale", [shifted, stretched])
def test_a_stamp_in_the_first_row_or_an_offset_hides_nothing(tmp_path, scale):
    data = scale(codes(12), 12)
    data[0, :20] += np.arange(20)
    assert "12 bits" in as_fits(tmp_path, data.astype(np.int32), EGAIN=4.0)[0]


def test_an_offset_that_was_subtracted_hides_no_shift(tmp_path):
    data = shifted(codes(12), 12) - 1003
    assert "12 bits" in as_fits(tmp_path, data.astype(np.int32), EGAIN=4.0)[0]


@pytest.mark.parametrize("factor", [3, 10, 100])
def test_pixels_that_were_multiplied_are_recognised(tmp_path, factor):
    (found,) = as_fits(tmp_path, (codes(12) * factor).astype(np.int32), EGAIN=4.0)
    assert f"multiples of {factor}:" in found
    assert f"--gain {4 / factor:g}" in found


PLAIN = codes(16)
GOOD = {
    "all 16 bits": PLAIN.astype(np.uint16),
    "12 bits as they are": codes(12).astype(np.uint16),
    "the mean of 4 frames of 12 bits": np.mean([codes(12, seed=n) for n in range(4)], axis=0),
    "the sum of 4 frames of 12 bits": np.sum([codes(12, seed=n) for n in range(4)], axis=0).astype(np.int32),
    "the median of 3 frames of 14 bits": np.median([codes(14, seed=n) for n in range(3)], axis=0),
    "the mean of 3 frames of 12 bits, shifted": np.mean([codes(12, seed=n) * 16 for n in range(3)], axis=0),
    "numbers that are twice others": (codes(12) * 2).astype(np.uint16),
    "a flat division": (codes(12) * 16 / 1.01).astype(np.float32),
    "one value": np.full(Y.shape, 4096, np.uint16),
    "few values": (4096 * (X > 30)).astype(np.uint16),
    "a dark sky with few counts": (16 * ((X == 30) & (Y > 50)) * Y).astype(np.uint16),
}


@pytest.mark.parametrize("name", GOOD)
def test_good_pixels_are_not_warned_of(tmp_path, name):
    assert not as_fits(tmp_path, GOOD[name], EGAIN=4.0)


def test_the_step_of_a_scale_that_the_file_states_is_none(tmp_path):
    hdu = fits.PrimaryHDU(codes(12).astype(np.int16), fits.Header({"EGAIN": 4.0}))
    hdu.header["BSCALE"] = 16.0
    hdu.header["BZERO"] = 100.0
    hdu.writeto(tmp_path / "b.fits")
    with fits.open(tmp_path / "b.fits") as file:
        assert np.unique(np.diff(np.unique(file[0].data))).min() == 16
    assert not warned(tmp_path / "b.fits")


def test_electrons_have_no_gain(tmp_path):
    assert not as_fits(tmp_path, shifted(codes(12), 12).astype(np.uint16), BUNIT="electron", EGAIN=4.0)
