"""Headers that declare what cannot be are refused by name, before anything is allocated or waited for.

Each of these, or its like, was found by ``scripts/fuzz_frames``.
"""

import gzip
import struct
import time
import tracemalloc
import zlib

import numpy as np
import pytest
from astropy.io import fits
from refusals import refused

# not to be loaded while time or memory is measured
import jitterkit.frames.fits
import jitterkit.frames.tiff  # noqa: F401
from jitterkit.errors import ErrorCode, FrameError
from jitterkit.frames import open_frames, read_frames, write_fits
from jitterkit.frames.fits import read_image, read_images

IMAGE = np.arange(48, dtype=np.int16).reshape(6, 8)
HEADER = {"SIMPLE": "T", "BITPIX": 16, "NAXIS": 2, "NAXIS1": 8, "NAXIS2": 6}
PIXELS = IMAGE.astype(">i2").tobytes()


def hdu(cards, data=b""):
    """The bytes of an HDU that astropy would refuse to write."""
    text = "".join(f"{key:8}= {value!s:>20}".ljust(80) for key, value in cards.items()) + "END".ljust(80)
    return text.encode("latin-1").ljust(-(-len(text) // 2880) * 2880) + data.ljust(
        -(-len(data) // 2880) * 2880, b"\0"
    )


def refused_at_once(path, content, code, *values, reader=lambda path: list(read_frames(path))):
    """Check that a file is refused by name, at once, and without much memory."""
    path.write_bytes(content)
    start = time.perf_counter()
    tracemalloc.start()
    try:
        with refused(code, path, *values, error=FrameError) as caught:
            reader(path)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 20e6
    assert time.perf_counter() - start < 5  # milliseconds; counting to 2^31 takes minutes
    return caught.value


@pytest.mark.parametrize(
    ("cards", "code", "values"),
    [
        ({"NAXIS": 2147483647}, ErrorCode.DAMAGED, ["HDU 0", "NAXIS = 2147483647"]),
        ({"NAXIS": -1}, ErrorCode.DAMAGED, ["HDU 0", "NAXIS = -1"]),
        ({"NAXIS": 3}, ErrorCode.DAMAGED, ["HDU 0", "NAXIS3"]),
        ({"NAXIS1": -8}, ErrorCode.DAMAGED, ["HDU 0", "-8 x 6"]),
        ({"NAXIS1": "8.5"}, ErrorCode.DAMAGED, ["HDU 0", "NAXIS1 = '8.5'"]),
        ({"NAXIS1": "nan"}, ErrorCode.DAMAGED, ["HDU 0", "NAXIS1 = 'nan'"]),
        ({"NAXIS1": "\xff\xfe"}, ErrorCode.DAMAGED, ["HDU 0", "NAXIS1 = '??'"]),
        ({"BITPIX": 17}, ErrorCode.DAMAGED, ["HDU 0", "BITPIX = 17"]),
        ({"BITPIX": ""}, ErrorCode.DAMAGED, ["HDU 0", "BITPIX = ''"]),
        ({"NAXIS1": 10**24, "NAXIS2": 10**24}, ErrorCode.TRUNCATED, ["HDU 0", "10^18", 5760]),
        ({"NAXIS": 3, "NAXIS3": 10**9}, ErrorCode.TRUNCATED, ["HDU 0", 96000000000, 5760]),
        ({"BSCALE": "'abc'"}, ErrorCode.DAMAGED, ["BSCALE", "'abc'"]),
        ({"BSCALE": "'unclosed"}, ErrorCode.DAMAGED, ["BSCALE"]),
        ({"BZERO": "(1, 2)"}, ErrorCode.DAMAGED, ["BZERO"]),
        ({"BSCALE": 0}, ErrorCode.DAMAGED, ["BSCALE = 0", "BZERO = 0"]),
        ({"BZERO": "T"}, ErrorCode.DAMAGED, ["BZERO", "'True'"]),
        ({"BZERO": ""}, ErrorCode.DAMAGED, ["BZERO"]),
        ({"BSCALE": "/ unknown"}, ErrorCode.DAMAGED, ["BSCALE"]),
        ({"BZERO": "1E400"}, ErrorCode.DAMAGED, ["BSCALE = 1", "BZERO = inf"]),
        ({"SIMPLE": "F"}, ErrorCode.DAMAGED, ["SIMPLE"]),
        ({"TFIELDS": 2147483647}, ErrorCode.DAMAGED, ["HDU 0", "TFIELDS = 2147483647"]),
    ],
    ids=lambda value: "-".join(value) if isinstance(value, dict) else "",
)
def test_an_absurd_card_is_refused_by_name(tmp_path, cards, code, values):
    refused_at_once(tmp_path / "a.fits", hdu(HEADER | cards, PIXELS), code, *values)


def test_a_keyword_that_says_two_things_is_not_believed(tmp_path):
    content = hdu(HEADER | {"NAXIS1 ": 8, "NAXIS2 ": 7}, PIXELS)  # NAXIS1 agrees with itself
    refused_at_once(tmp_path / "a.fits", content, ErrorCode.DAMAGED, "HDU 0", "NAXIS2", "'6'", "'7'")


def test_an_array_of_a_thousand_axes_is_described_in_few_words(tmp_path):
    sides = {f"NAXIS{n}": 1 for n in range(1, 1000)} | {"NAXIS998": 48, "NAXIS999": 60}
    content = hdu({"SIMPLE": "T", "BITPIX": 8, "NAXIS": 999} | sides, bytes(2880))
    error = refused_at_once(
        tmp_path / "a.fits", content, ErrorCode.NO_IMAGE, "HDU 0", "1 x 1 x 1 x 1 x 1 x ..."
    )
    assert len(error.problem) < 100


def test_a_damaged_table_before_the_image_is_refused_by_name(tmp_path):
    table = {
        "XTENSION": "'BINTABLE'",
        "BITPIX": 8,
        "NAXIS": 2147483647,
        "PCOUNT": 0,
        "GCOUNT": 1,
        "TFIELDS": 1,
    }
    content = hdu({"SIMPLE": "T", "BITPIX": 8, "NAXIS": 0}) + hdu(table) + hdu(HEADER, PIXELS)
    for reader in (open_frames, read_images):
        refused_at_once(
            tmp_path / "a.fits", content, ErrorCode.DAMAGED, "HDU 1", "NAXIS = 2147483647", reader=reader
        )


def packed(path, **cards):
    """A tile-compressed file with cards of its table changed."""
    content = write_fits(path, IMAGE, overwrite=True).read_bytes()
    for key, value in cards.items():
        at = content.index(f"{key:8}=".encode())
        content = content[:at] + f"{key:8}= {value!s:>20}".ljust(80).encode() + content[at + 80 :]
    return content


@pytest.mark.parametrize(
    ("cards", "code", "value"),
    [
        ({"TFIELDS": 2147483647}, ErrorCode.DAMAGED, "TFIELDS = 2147483647"),
        ({"ZNAXIS": 2147483647}, ErrorCode.DAMAGED, "ZNAXIS = 2147483647"),
        ({"ZNAXIS2": 10**12}, ErrorCode.DAMAGED, 16000000000000),
        ({"ZNAXIS2": 1000}, ErrorCode.DAMAGED, 16000),  # a tile to a row, and there are six
        ({"ZTILE1": 2147483647}, ErrorCode.DAMAGED, "2147483647 x 1"),
        ({"ZTILE1": 0}, ErrorCode.DAMAGED, "0 x 1"),
        (
            {"PCOUNT": 10**9},
            ErrorCode.TRUNCATED,
            96,
        ),  # as many bytes of pixels, packed in more than there are
        ({"ZCMPTYPE": "'JPEG2000'"}, ErrorCode.UNSUPPORTED_ENCODING, "'JPEG2000'"),
    ],
    ids=lambda value: "-".join(value) if isinstance(value, dict) else "",
)
def test_an_absurd_table_of_tiles_is_refused_by_name(tmp_path, cards, code, value):
    content = packed(tmp_path / "a.fits.fz", **cards)
    for reader in (open_frames, read_image):
        refused_at_once(tmp_path / "a.fits.fz", content, code, "HDU 1", value, reader=reader)


def test_a_million_frames_in_a_few_bytes_are_not_believed(tmp_path):
    cards = {"SIMPLE": "T", "BITPIX": 8, "NAXIS": 3, "NAXIS1": 1, "NAXIS2": 1, "NAXIS3": 1 << 20}
    content = gzip.compress(hdu(cards, bytes(1 << 20)))
    refused_at_once(tmp_path / "a.fits.gz", content, ErrorCode.TRUNCATED, "HDU 0", 1048576, len(content))


def test_a_zipped_cube_that_ends_early_is_refused_when_it_is_opened(tmp_path):
    noise = np.random.default_rng(0).bytes(48 * 30)
    cards = {"SIMPLE": "T", "BITPIX": 8, "NAXIS": 3, "NAXIS1": 8, "NAXIS2": 6, "NAXIS3": 100}
    content = gzip.compress(hdu(cards, noise))
    refused_at_once(tmp_path / "a.fits.gz", content, ErrorCode.TRUNCATED, "HDU 0", 4800, reader=open_frames)


def test_a_frame_larger_than_any_detectors_is_refused_by_its_size(tmp_path):
    path = tmp_path / "a.fits"
    path.write_bytes(hdu(HEADER | {"BITPIX": 8, "NAXIS1": 1 << 16, "NAXIS2": 1 << 16}))
    with path.open("r+b") as handle:
        handle.truncate(2880 + (1 << 32))  # sparse: all the pixels are there
    with refused(ErrorCode.TOO_LARGE, path, "HDU 0", "65536 x 65536", error=FrameError):
        open_frames(path)


def test_what_follows_the_last_hdu_is_of_no_matter(tmp_path):
    (tmp_path / "a.fits").write_bytes(hdu(HEADER, PIXELS) + b"junk" * 2000)
    (frame,) = read_frames(tmp_path / "a.fits")
    np.testing.assert_array_equal(frame.data, IMAGE)
    with refused(ErrorCode.NO_IMAGE, tmp_path / "a.fits", "HDU 1", "0 to 0", error=FrameError):
        open_frames(tmp_path / "a.fits", hdu=1)


def test_bytes_that_are_no_text_in_a_comment_are_a_warning(tmp_path):
    cards = HEADER | {"EXPTIME": "2.0 / 20 \xb0C", "OBJECT": "'\xe9toile'"}
    (tmp_path / "a.fits").write_bytes(hdu(cards, PIXELS))
    (frame,) = read_frames(tmp_path / "a.fits")
    assert frame.metadata.exposure.value == 2.0
    assert len(frame.metadata.warnings) == 1
    assert "'?'" in frame.metadata.warnings[0]


def test_a_tab_in_a_card_is_read_as_a_blank(tmp_path):
    (tmp_path / "a.fits").write_bytes(hdu(HEADER | {"NAXIS1": "\t8", "EXPTIME": "\t2.0"}, PIXELS))
    (frame,) = read_frames(tmp_path / "a.fits")
    np.testing.assert_array_equal(frame.data, IMAGE)
    assert frame.metadata.exposure.value == 2.0
    assert len(frame.metadata.warnings) == 1


def test_a_value_over_several_cards_is_read_whole(tmp_path):
    cards = HEADER | {"BUNIT": "'elec&'"}
    content = hdu(cards | {"@": ""}, PIXELS).replace(
        f"{'@':8}= {'':>20}".encode(), b"CONTINUE  'tron'".ljust(30)
    )
    (tmp_path / "a.fits").write_bytes(content)
    (frame,) = read_frames(tmp_path / "a.fits")
    assert frame.unit == "electron"


def test_distortions_that_astropy_tells_the_screen_become_a_warning(tmp_path, capfd):
    sip = {
        "CTYPE1": "'RA---TAN'",
        "CTYPE2": "'DEC--TAN'",
        "CRVAL1": 10,
        "CRVAL2": 10,
        "CRPIX1": 4,
        "CRPIX2": 3,
    }
    sip |= {"CD1_1": -1e-4, "CD2_2": 1e-4, "A_ORDER": 2, "A_2_0": 1e-6, "B_ORDER": 2, "B_0_2": 1e-6}
    (tmp_path / "a.fits").write_bytes(hdu(HEADER | sip, PIXELS))
    (frame,) = read_frames(tmp_path / "a.fits")
    assert any("SIP" in text for text in frame.metadata.warnings)
    assert capfd.readouterr() == ("", "")


def test_the_coordinates_are_those_of_the_whole_header(tmp_path):
    # the reader picks the cards that make a WCS; astropy's own reading of all of them is the measure
    header = fits.Header(
        {"CTYPE1": "RA---TAN-SIP", "CTYPE2": "DEC--TAN-SIP", "CRVAL1": 219.9, "CRVAL2": -60.8}
    )
    header.update({"CRPIX1": 4.5, "CRPIX2": 3.5, "CD1_1": -1e-4, "CD1_2": 2e-5, "CD2_1": 3e-5, "CD2_2": 1e-4})
    header.update({"A_ORDER": 2, "A_2_0": 1e-4, "B_ORDER": 2, "B_0_2": -2e-4, "RADESYS": "FK5"})
    header.update({"EQUINOX": 1950.0, "LONPOLE": 170.0, "DATE-OBS": "2027-03-01"})
    path = write_fits(tmp_path / "a.fits", IMAGE, header=dict(header))
    from astropy.wcs import WCS, FITSFixedWarning

    with pytest.warns(FITSFixedWarning):
        expected = WCS(fits.getheader(path)).all_pix2world([[0, 0], [7, 5]], 0)
    (frame,) = read_frames(path)
    np.testing.assert_array_equal(frame.metadata.wcs.all_pix2world([[0, 0], [7, 5]], 0), expected)


def test_two_frames_with_one_pointing_do_not_share_their_coordinates(tmp_path):
    cards = {
        "CTYPE1": "RA---TAN",
        "CTYPE2": "DEC--TAN",
        "CRVAL1": 10.0,
        "CRVAL2": 20.0,
        "CD1_1": 1e-4,
        "CD2_2": 1e-4,
    }
    path = write_fits(tmp_path / "a.fits", IMAGE, header=cards)
    (first,), (second,) = read_frames(path), read_frames(path)
    first.metadata.wcs.wcs.crval = [0.0, 0.0]
    assert list(second.metadata.wcs.wcs.crval) == [10.0, 20.0]


def tiff(entries, pixels=bytes(96), extra=b""):
    tags = {256: 8, 257: 6, 258: 16, 259: 1, 262: 1, 273: 400, 277: 1, 278: 6, 279: len(pixels)} | entries
    directory = b"".join(struct.pack("<HHII", tag, 4, 1, value) for tag, value in sorted(tags.items()))
    start = b"II*\0" + struct.pack("<IH", 8, len(tags)) + directory + bytes(4)
    return start.ljust(400, b"\0") + pixels + extra


@pytest.mark.parametrize(
    ("entries", "code", "values"),
    [
        ({256: 1 << 31}, ErrorCode.DAMAGED, [25769803776, 496]),
        ({259: 8, 256: 1 << 14, 257: 1 << 14, 258: 8}, ErrorCode.DAMAGED, [268435456, 496]),  # deflated
        ({259: 8, 322: 1 << 20, 323: 1 << 20, 324: 400, 325: 96}, ErrorCode.DAMAGED, ["1048576 x 1048576"]),
        ({279: 97}, ErrorCode.TRUNCATED, [96, 496]),
        ({279: 0}, ErrorCode.TRUNCATED, [96, 496]),  # nothing was written yet
    ],
    ids=["width", "packed", "tile", "beyond", "none"],
)
def test_an_absurd_tag_is_refused_by_name(tmp_path, entries, code, values):
    content = tiff(entries, zlib.compress(bytes(96)).ljust(96))
    refused_at_once(tmp_path / "a.tif", content, code, "page 0", *values)


def test_a_width_of_a_hundred_numbers_is_refused_in_few_words(tmp_path):
    content = bytearray(tiff({}, extra=struct.pack("<100I", *range(100))))
    content[14:18] = struct.pack("<I", 100)  # the count of the first tag, ImageWidth ...
    content[18:22] = struct.pack("<I", 400 + 96)  # ... and where its values stand
    error = refused_at_once(tmp_path / "a.tif", bytes(content), ErrorCode.DAMAGED, "imagewidth = (0, 1, 2, ")
    assert len(error.problem) < 100


def test_directories_that_overlap_are_refused_at_once(tmp_path):
    # every directory of 65,535 entries begins two bytes behind the one before: days of reading
    step, entries, size = 12, 65535, 65535 * 12 + 6 + 200 * 12
    content = bytearray(size)
    content[:8] = b"II*\0" + struct.pack("<I", 8)
    for page in range(200):
        at = 8 + page * step
        struct.pack_into("<H", content, at, entries)
        link = at + 2 + entries * 12
        if link + 4 <= size:
            struct.pack_into("<I", content, link, at + step)
    refused_at_once(tmp_path / "a.tif", bytes(content), ErrorCode.DAMAGED, "page 1")
