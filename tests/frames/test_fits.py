"""What only FITS files do."""

import gzip
import tracemalloc

import numpy as np
import pytest
from astropy.io import fits
from refusals import refused

import jitterkit.frames.fits  # noqa: F401  not to be loaded while time or memory is measured
from jitterkit.errors import ErrorCode, FrameError
from jitterkit.frames import open_frames, read_frames, write_fits
from jitterkit.frames.fits import read_image, read_images

IMAGE = np.arange(20).reshape(4, 5)


def only(path, **options):
    (frame,) = read_frames(path, **options)
    return frame


def raw_fits(path, cards, data=b""):
    """Write a FITS file that astropy would refuse to write."""
    text = "".join(f"{key:8}= {value:>20}".ljust(80) for key, value in cards.items()) + "END".ljust(80)
    path.write_bytes(text.encode().ljust(-(-len(text) // 2880) * 2880) + data)
    return path


HEADER = {"SIMPLE": "T", "BITPIX": 16, "NAXIS": 2, "NAXIS1": 5, "NAXIS2": 4}


def test_blank_is_masked_and_zero(tmp_path):
    path = raw_fits(
        tmp_path / "a.fits", {**HEADER, "BLANK": 7}, IMAGE.astype(">i2").tobytes().ljust(2880, b"\0")
    )
    frame = only(path)
    assert frame.mask.sum() == 1
    assert frame.mask[1, 2]
    assert frame.data[1, 2] == 0
    assert frame.data[1, 3] == 8


def test_blank_is_the_stored_number_not_the_scaled_one(tmp_path):
    cards = {**HEADER, "BLANK": 7, "BSCALE": 2.0, "BZERO": 100.0}
    frame = only(raw_fits(tmp_path / "a.fits", cards, IMAGE.astype(">i2").tobytes().ljust(2880, b"\0")))
    np.testing.assert_array_equal(frame.data, np.where(IMAGE == 7, 0, 2 * IMAGE + 100))
    assert np.argwhere(frame.mask).tolist() == [[1, 2]]


def test_nan_and_infinity_are_masked_and_zero(tmp_path):
    image = IMAGE.astype(np.float32)
    image[0, 1], image[3, 4] = np.nan, np.inf
    frame = only(write_fits(tmp_path / "a.fits", image))
    assert np.argwhere(frame.mask).tolist() == [[0, 1], [3, 4]]
    assert frame.data[0, 1] == frame.data[3, 4] == 0


def test_an_all_nan_frame_is_read_and_wholly_masked(tmp_path):
    assert only(write_fits(tmp_path / "a.fits", np.full((4, 5), np.nan))).mask.all()


def test_a_nan_in_a_compressed_image_is_masked(tmp_path):
    image = IMAGE.astype(np.float64)
    image[2, 2] = np.nan
    frame = only(write_fits(tmp_path / "a.fits.fz", image))
    assert np.argwhere(frame.mask).tolist() == [[2, 2]]


def test_the_type_is_the_stored_one(tmp_path):
    for dtype in (np.uint8, np.int16, np.uint16, np.int32, np.uint32, np.float32, np.float64):
        with open_frames(write_fits(tmp_path / f"{dtype.__name__}.fits", IMAGE.astype(dtype))) as file:
            assert file.dtype == dtype


def test_an_hdu_may_be_chosen(tmp_path):
    path = tmp_path / "a.fits"
    fits.HDUList([fits.PrimaryHDU(IMAGE), fits.ImageHDU(IMAGE + 1), fits.ImageHDU(IMAGE[0])]).writeto(path)
    assert only(path).data[0, 0] == 0
    assert only(path, hdu=1).data[0, 0] == 1
    assert only(path, hdu=1).hdu == 1
    with refused(ErrorCode.NO_IMAGE, path, "HDU 7", "0 to 2", error=FrameError):
        open_frames(path, hdu=7)
    with refused(ErrorCode.NO_IMAGE, path, "HDU 2", "an array of 5", error=FrameError):
        open_frames(path, hdu=2)


def test_an_empty_primary_and_a_table_are_passed_over(tmp_path):
    path = tmp_path / "a.fits"
    table = fits.BinTableHDU.from_columns([fits.Column("x", "E", array=np.ones(3))])
    header = fits.Header({"EXPTIME": 4.0})
    fits.HDUList([fits.PrimaryHDU(header=header), table, fits.ImageHDU(IMAGE)]).writeto(path)
    frame = only(path)
    assert frame.hdu == 2
    assert frame.metadata.exposure.source == "header EXPTIME (HDU 0)"


def test_a_file_without_an_image_says_what_it_holds(tmp_path):
    table = fits.BinTableHDU.from_columns([fits.Column("x", "E", array=np.ones(3))])
    fits.HDUList([fits.PrimaryHDU(), table]).writeto(tmp_path / "a.fits")
    contents = "HDU 0: empty, HDU 1: a table"
    with refused(ErrorCode.NO_IMAGE, tmp_path / "a.fits", contents, error=FrameError):
        open_frames(tmp_path / "a.fits")


def test_a_data_set_with_two_stacking_axes_is_no_frame(tmp_path):
    fits.writeto(tmp_path / "a.fits", np.zeros((2, 3, 4, 5)))
    with refused(ErrorCode.NO_IMAGE, tmp_path / "a.fits", "HDU 0", "5 x 4 x 3 x 2", error=FrameError):
        open_frames(tmp_path / "a.fits")


@pytest.mark.parametrize("ending", [".fits", ".fits.gz", ".fits.fz"])
@pytest.mark.parametrize("keep", [0.98, 0.5])
def test_a_truncated_file_is_refused(tmp_path, ending, keep):
    noise = np.random.default_rng(3).integers(0, 60000, (300, 300)).astype(np.uint16)
    path = write_fits(tmp_path / f"a{ending}", noise)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(keep * len(whole))])
    with refused(ErrorCode.TRUNCATED, path, error=FrameError):
        list(read_frames(path))


def test_missing_padding_after_the_data_is_forgiven(tmp_path):
    path = write_fits(tmp_path / "a.fits", IMAGE.astype(np.int16))
    path.write_bytes(path.read_bytes()[: 2880 + 40])
    np.testing.assert_array_equal(only(path).data, IMAGE)


@pytest.mark.parametrize("ending", [".fits", ".fits.gz"])
def test_a_header_that_declares_more_than_there_is_allocates_nothing(tmp_path, ending):
    path = raw_fits(tmp_path / "a.fits", {**HEADER, "NAXIS1": 2000000, "NAXIS2": 2000000}, bytes(2880))
    if ending == ".fits.gz":
        path.with_suffix(ending).write_bytes(gzip.compress(path.read_bytes()))
        path = path.with_suffix(ending)
    tracemalloc.start()
    with refused(ErrorCode.TRUNCATED, path, "HDU 0", 8000000000000, path.stat().st_size, error=FrameError):
        open_frames(path)
    assert tracemalloc.get_traced_memory()[1] < 10e6
    tracemalloc.stop()


def test_a_header_without_end_is_refused_without_reading_on(tmp_path):
    path = tmp_path / "a.fits"
    with path.open("wb") as handle:
        handle.write(b"SIMPLE  =                    T".ljust(80))
        handle.truncate(1 << 33)  # a sparse file of 8 GiB
    with refused(ErrorCode.DAMAGED, path, "END", error=FrameError):
        open_frames(path)


def test_junk_after_simple_is_refused(tmp_path):
    path = tmp_path / "a.fits"
    path.write_bytes(b"SIMPLE" + np.random.default_rng(1).bytes(9000))
    with refused(ErrorCode.DAMAGED, path, "END", error=FrameError):
        open_frames(path)


def test_a_header_that_contradicts_itself_is_refused(tmp_path):
    path = raw_fits(
        tmp_path / "a.fits", {"SIMPLE": "T", "BITPIX": 17, "NAXIS": 2, "NAXIS1": 5, "NAXIS2": 4}, bytes(2880)
    )
    with refused(ErrorCode.DAMAGED, path, "BITPIX = 17", error=FrameError):
        list(read_frames(path))


def test_a_card_that_cannot_be_read_is_a_warning(tmp_path):
    path = write_fits(tmp_path / "a.fits", IMAGE, header={"EXPTIME": 2.0, "EGAIN": 1.5})
    path.write_bytes(
        path.read_bytes().replace(b"EGAIN   =                  1.5", b"EGAIN   =    'unclosed  1.5  x")
    )
    metadata = only(path).metadata
    assert metadata.exposure.value == 2.0
    assert metadata.gain is None
    assert any("'unclosed" in text for text in metadata.warnings)


def test_lossy_compression_is_a_warning_and_lossless_is_not(tmp_path):
    noise = np.random.default_rng(1).normal(size=(64, 64)).astype(np.float32)
    fits.CompImageHDU(noise, compression_type="RICE_1", quantize_level=16).writeto(tmp_path / "a.fits.fz")
    assert any("ZQUANTIZ = NO_DITHER" in text for text in only(tmp_path / "a.fits.fz").metadata.warnings)
    write_fits(tmp_path / "b.fits.fz", noise)
    frame = only(tmp_path / "b.fits.fz")
    assert frame.metadata.warnings == ()
    assert frame.hdu == 1
    np.testing.assert_array_equal(frame.data, noise)


@pytest.mark.parametrize("ending", [".fits", ".fits.fz"])
def test_a_cube_is_read_one_plane_at_a_time(tmp_path, ending):
    noise = np.random.default_rng(1).integers(0, 999, (40, 100, 100)).astype(np.float64)
    path = write_fits(tmp_path / f"a{ending}", noise)
    with open_frames(path) as file:
        file[0]
        tracemalloc.start()
        for frame in file:
            assert frame.data.shape == (100, 100)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    # a few copies of a plane of 80 kB, and never the cube of 3.2 MB
    assert peak < 12 * noise[0].nbytes


def test_large_unsigned_integers_keep_their_last_digits(tmp_path):
    image = np.arange(64, dtype=np.uint64).reshape(8, 8) + 777
    fits.PrimaryHDU(image).writeto(tmp_path / "a.fits")
    with open_frames(tmp_path / "a.fits") as file:
        assert np.array_equal(file[0].data, image.astype(float))


def test_what_is_no_fits_is_said_to_be_of_another_format(tmp_path):
    (tmp_path / "a.fits").write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(3000))
    for read in (read_image, read_images):
        with refused(ErrorCode.UNKNOWN_FORMAT, tmp_path / "a.fits", error=FrameError):
            read(tmp_path / "a.fits")


def test_a_keyword_in_small_letters_is_read(tmp_path):
    path = write_fits(tmp_path / "a.fits", np.ones((8, 8), np.uint16), header={"EXPTIME": (7.0, "s")})
    path.write_bytes(path.read_bytes().replace(b"EXPTIME =", b"exptime ="))
    with open_frames(path) as file:
        assert file[0].metadata.value("exposure") == 7.0


COUNTS = np.random.default_rng(0).poisson(40, (20, 20))


@pytest.mark.parametrize("key", ["EGAIN", "CVF"])
@pytest.mark.parametrize(
    ("pixels", "gain"),
    [
        (COUNTS * 16, "--gain 0.015625"),
        (COUNTS * 4, "--gain 0.0625"),
        (COUNTS * 16 + 8, "--gain 0.015625"),
        (COUNTS * 16.0, "--gain 0.015625"),
        (COUNTS * 2, ""),
        (COUNTS * 16 + (np.arange(400).reshape(20, 20) == 7), "--gain 0.015625"),
        (COUNTS * 16 + (np.arange(400).reshape(20, 20) % 20 == 7), ""),
        (COUNTS / 16, ""),
        (COUNTS * 0 + 16, ""),
    ],
)
def test_a_gain_beside_scaled_up_pixels_may_be_that_of_the_converter(tmp_path, key, pixels, gain):
    dtype = np.float32 if pixels.dtype.kind == "f" else np.uint16
    fits.PrimaryHDU(pixels.astype(dtype), fits.Header({key: 0.25})).writeto(tmp_path / "a.fits")
    (frame,) = read_frames(tmp_path / "a.fits")
    said = [text for text in frame.metadata.warnings if "multiples of" in text]
    assert frame.metadata.gain.value == 0.25
    assert [gain in text for text in said] == [True] * bool(gain)
