"""Real frames of other projects: each is read right, or refused with a sentence."""

import time
from pathlib import Path

import numpy as np
import pytest
import tifffile
from astropy.io import fits
from refusals import refused

from jitterkit.errors import ErrorCode, FrameError
from jitterkit.frames import open_frames, read_frames

REAL = Path(__file__).parents[2].parent / "shared" / "real"
pytestmark = pytest.mark.skipif(not REAL.is_dir(), reason="the real frames are not beside the project")

FITS_IMAGES = {  # file: (frames, (ny, nx), stored type, hdu)
    "fits/arange.fits": (7, (10, 11), "int32", 0),
    "fits/checksum.fits": (1, (40, 30), "int16", 0),
    "fits/comp.fits": (1, (300, 440), "int16", 1),
    "fits/compressed_image.fits": (1, (10, 10), "int16", 1),
    "fits/compressed_with_nan.fits": (1, (12, 12), "float64", 1),
    "fits/double_ext.fits": (1, (5, 5), "uint16", 1),
    "fits/fixed-1890.fits": (1, (100, 100), "uint16", 0),
    "fits/scale.fits": (1, (21, 20), "int16", 0),
    "fits/test0.fits": (4, (40, 40), "int16", 1),
    "malformed/checksum_false.fits": (1, (40, 30), "int16", 0),
    "stars/SPHERE_satspots_centered.fits": (1, (151, 151), "float32", 0),
    "stars/a8280271.fits": (1, (520, 536), "uint16", 0),
    "stars/image.fits": (1, (256, 256), "int16", 0),
    "stars/long.fits": (1, (512, 512), "int16", 0),
    "stars/noheader.fits": (1, (200, 200), "uint16", 0),
    "stars/pole.fits": (1, (200, 200), "uint16", 0),
    "stars/tiny.fits": (1, (200, 200), "uint16", 0),
}
CHIPS = {"fits/test0.fits": (1, 2, 3, 4)}
TIFF_IMAGES = {
    "10ct_32bit_128.tiff": "float32", "12bit.cropped.tif": "uint16", "12in16bit.tif": "uint16",
    "16bit.MM.cropped.tif": "uint16", "16bit.cropped.tif": "uint16", "16bit.s.tif": "int16",
    "chessboard_GRAY_U16.tif": "uint16", "chessboard_GRAY_U16B.tif": "uint16", "uint16_1_4660.tif": "uint16",
}  # fmt: skip
REFUSED = {  # file: (code, what the sentence names)
    "fits/compressed_float_bzero.fits": (ErrorCode.NO_IMAGE, "(HDU 0: empty, HDU 1: an array of 3)"),
    "fits/group.fits": (ErrorCode.NO_IMAGE, "(HDU 0: random groups)"),
    "fits/random_groups.fits": (ErrorCode.NO_IMAGE, "HDU 0: random groups"),
    "fits/history_header.fits": (ErrorCode.NO_IMAGE, "(HDU 0: empty)"),
    "fits/stddata.fits": (ErrorCode.NO_IMAGE, "HDU 1: a table, HDU 2: a table"),
    "malformed/group_invalid.fits": (ErrorCode.NO_IMAGE, "HDU 0: random groups"),
    "malformed/hopper_naxis_zero.fits": (ErrorCode.NO_IMAGE, "(HDU 0: empty)"),
    "malformed/theap-gap.fits": (ErrorCode.NO_IMAGE, "HDU 1: a table"),
    "malformed/verify.fits": (ErrorCode.NO_IMAGE, "HDU 0"),
    "malformed/multipage_multiple_frame_loop.tiff": (ErrorCode.DAMAGED, "page 2"),
    "malformed/multipage_out_of_order.tiff": (ErrorCode.COLOUR, "palette"),
    "malformed/tiff_wrong_bits_per_sample.tiff": (ErrorCode.COLOUR, "4 channels (red, green, blue, alpha)"),
    "malformed/tiff_wrong_bits_per_sample_2.tiff": (ErrorCode.COLOUR, "3 channels (red, green, blue)"),
    "tiff/hopper_bigtiff.tif": (ErrorCode.COLOUR, "3 channels (red, green, blue)"),
    "tiff/hopper_lzma.tif": (ErrorCode.COLOUR, "3 channels"),
    "tiff/hopper_lzw.tif": (ErrorCode.COLOUR, "3 channels"),
    "tiff/multipage-mmap.tiff": (ErrorCode.COLOUR, "palette"),
    "tiff/multipage.tiff": (ErrorCode.COLOUR, "palette"),
    "tiff/multipage_rgb.tif": (ErrorCode.COLOUR, "3 channels"),
    "tiff/tiff_16bit_RGB.tiff": (ErrorCode.COLOUR, "3 channels"),
    "tiff/tiff_16bit_RGBa.tiff": (ErrorCode.COLOUR, "4 channels"),
    "tiff/tiff_strip_planar_16bit_RGB.tiff": (ErrorCode.COLOUR, "3 channels"),
}


def only(name):
    (frame,) = read_frames(REAL / name)
    return frame


@pytest.mark.filterwarnings("ignore::astropy.io.fits.verify.VerifyWarning")
@pytest.mark.filterwarnings("ignore::astropy.utils.exceptions.AstropyUserWarning")
@pytest.mark.parametrize("name", FITS_IMAGES)
def test_fits_frames_have_the_numbers_astropy_reads(name):
    count, shape, dtype, hdu = FITS_IMAGES[name]
    hdus = CHIPS.get(name, (hdu,))
    stored = np.concatenate([np.atleast_3d(fits.getdata(REAL / name, n).T).T for n in hdus])
    expected = stored.astype(np.float64).reshape(count, *shape)
    with open_frames(REAL / name) as file:
        assert (len(file), file.shape, str(file.dtype), file.hdu) == (count, shape, dtype, hdu)
        data = np.stack([frame.data for frame in file])
    # astropy applies BSCALE to 16-bit integers in float32
    np.testing.assert_allclose(data, np.nan_to_num(expected), rtol=2**-22, atol=0)


@pytest.mark.parametrize("name", TIFF_IMAGES)
def test_tiff_frames_have_the_numbers_tifffile_reads_bottom_row_first(name):
    expected = tifffile.imread(REAL / "tiff" / name)
    with open_frames(REAL / "tiff" / name) as file:
        assert str(file.dtype) == TIFF_IMAGES[name]
        assert len(file) == 1
        np.testing.assert_array_equal(file[0].data, expected[::-1])


@pytest.mark.parametrize("pair", ["16bit{}.cropped.tif", "chessboard_GRAY_U16{}.tif"])
def test_both_byte_orders_give_the_same_frame(pair):
    little = only("tiff/" + pair.format(""))
    big = only("tiff/" + pair.format(".MM" if "16bit" in pair else "B"))
    np.testing.assert_array_equal(little.data, big.data)


def test_packed_and_unpacked_twelve_bits_give_the_same_frame():
    np.testing.assert_array_equal(only("tiff/12bit.cropped.tif").data, only("tiff/12in16bit.tif").data)


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_frame_is_refused_with_a_sentence_and_at_once(name):
    start = time.perf_counter()
    code, value = REFUSED[name]
    with refused(code, REAL / name, value, error=FrameError):
        list(read_frames(REAL / name))
    assert time.perf_counter() - start < 5


def test_every_real_file_has_an_expected_outcome():
    expected = {*FITS_IMAGES, *REFUSED, *(f"tiff/{name}" for name in TIFF_IMAGES), "fits/blank.fits"}
    assert {str(path.relative_to(REAL)) for path in REAL.glob("*/*")} == expected


def test_negative_integers_and_a_malformed_date_are_read_with_a_warning():
    frame = only("stars/long.fits")
    assert (frame.data.min(), frame.data.max()) == (-401, 4954)
    assert frame.metadata.exposure.value == 60
    assert frame.metadata.time.value == "2002-07-26T19:36:36.576"  # of JD, "end of obs"
    assert any("JD is not the beginning" in text for text in frame.metadata.warnings)
    assert any("DATE-OBS = '26/07/102'" in text for text in frame.metadata.warnings)


def test_an_observatorys_header_is_understood():
    known = only("stars/a8280271.fits").metadata.known()
    assert {name: value.value for name, value in known.items()} == {
        "exposure": 150.04, "gain": 1.9, "read_noise": 5.0, "time": "2013-07-13T00:57:33"
    }  # fmt: skip


def test_an_old_header_with_odd_cards_is_understood():
    metadata = only("stars/image.fits").metadata
    assert (metadata.time.value, metadata.unit.value, metadata.exposure.value) == (
        "1992-10-26T15:04:07.968",
        "adu",
        1200,
    )
    assert metadata.saturation is None
    assert any("DATAMAX" in text for text in metadata.warnings)


def test_a_primary_header_speaks_for_its_extensions():
    metadata = next(read_frames(REAL / "fits/test0.fits")).metadata
    assert (metadata.exposure.value, metadata.exposure.source) == (0.23, "header EXPTIME (HDU 0)")
    assert metadata.time.value == "1994-05-19T15:41:16"


def test_a_header_with_nothing_in_it_says_nothing():
    assert only("stars/noheader.fits").metadata.known() == {}


def test_a_blank_pixel_is_masked():
    frame = only("fits/blank.fits")
    assert frame.shape == (1, 1)
    assert frame.mask.all()
    assert frame.data[0, 0] == 0


def test_a_nan_in_a_lossily_compressed_image_is_masked_with_a_warning():
    frame = only("fits/compressed_with_nan.fits")
    assert frame.mask.sum() == 1
    assert "ZQUANTIZ" in frame.metadata.warnings[0]
