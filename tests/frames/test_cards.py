"""Cards that stand twice, that have no value, and those of the primary header; astropy says what is right."""

import gc
import weakref

import numpy as np
import pytest
from astropy.io import fits
from astropy.wcs import WCS

from jitterkit.frames import read_frames, write_fits
from jitterkit.frames.cards import Cards
from jitterkit.frames.dialects import ALIASES, SOFTWARE_KEYS
from jitterkit.frames.fitsio import PlainHeader
from jitterkit.frames.times import TIME_KEYS

IMAGE = np.arange(20, dtype=np.uint16).reshape(4, 5)

OPTICS = {"FOCALLEN": 1000, "XPIXSZ": 4.8, "PIXSIZE1": 2.4, "XBINNING": 2}
ALIAS_KEYS = [key for keys in ALIASES.values() for key in keys]
NUMBERS = [*np.hstack(ALIAS_KEYS).tolist(), *OPTICS, "MJD-OBS"]  # those of several amplifiers one by one
TEXTS = ["BUNIT", "DATE-OBS", "DATE-AVG", "TIMESYS", "EXTNAME", *TIME_KEYS, *SOFTWARE_KEYS]
SKY = {
    "CTYPE1": "'RA---TAN'", "CTYPE2": "'DEC--TAN'", "CRPIX1": 2.0, "CRPIX2": 3.0,
    "CRVAL1": 10.0, "CRVAL2": 20.0, "CDELT1": -1e-3, "CDELT2": 1e-3,
}  # fmt: skip


def card(key, value):
    return (f"{key:8}= {value:>20}" if len(key) <= 8 else f"HIERARCH {key} = {value}").ljust(80)


def with_cards(path, *cards):
    """Add cards to the last header of a file."""
    content = path.read_bytes()
    end = content.rindex(b"END".ljust(80))
    header = content[:end] + "".join(cards).encode() + b"END".ljust(80)
    path.write_bytes(header + b" " * (-len(header) % 2880) + content[end - end % 2880 + 2880 :])
    return path


def only(path):
    (frame,) = read_frames(path)
    return frame


@pytest.mark.parametrize("name", ["a.fits", "a.fits.fz"])
def test_of_two_cards_pixels_and_exposure_depend_on_the_first(tmp_path, name):
    """The file has a BZERO of 32768 already; of pixels that are not compressed astropy obeys the last."""
    path = write_fits(tmp_path / name, IMAGE, header={"EXPTIME": 2.0, "EGAIN": 1.5})
    cards = {"BZERO": 7.0, "BSCALE": 3.0, "EXPTIME": 9.0, "EGAIN": "1.5 / again", "BLANK": -32765}
    frame = only(with_cards(path, *(card(*item) for item in cards.items()), card("BLANK", -32760)))
    packed = int(name.endswith("fz"))
    header = fits.getheader(path, packed)
    stored = fits.getdata(path, packed, do_not_scale_image_data=True)
    values = header["BZERO"] + header["BSCALE"] * stored.astype(float)
    np.testing.assert_array_equal(frame.data, np.where(stored == header["BLANK"], 0, values))
    np.testing.assert_array_equal(frame.mask, stored == header["BLANK"])
    assert frame.metadata.value("exposure") == header["EXPTIME"]
    assert frame.data[0, 1] == 1
    doubled = ("BLANK", "BSCALE", "BZERO", "EXPTIME")
    assert len(frame.metadata.warnings) == len(doubled)
    for key, text in zip(doubled, sorted(frame.metadata.warnings), strict=True):
        assert key in text


def test_of_two_cards_of_coordinates_the_one_counts_that_counts_with_astropy(tmp_path):
    """wcslib takes the last, as who solves a field anew and adds what it finds would have it."""
    doubled = "".join(card(*item) for item in [*SKY.items(), ("CRVAL1", 50.0), ("CDELT1", -2e-3)])
    path = with_cards(
        write_fits(tmp_path / "a.fits", IMAGE), *SKY_CARDS, card("CRVAL1", 50.0), card("CDELT1", -2e-3)
    )
    mine, theirs = only(path).metadata.wcs, WCS(fits.Header.fromstring(doubled))
    assert mine.pixel_to_world_values(1.0, 3.0) == theirs.pixel_to_world_values(1.0, 3.0)


SKY_CARDS = [card(*item) for item in SKY.items()]


def told(path):
    """All that the metadata of a file says, and where its centre lies."""
    metadata = only(path).metadata
    centre = None if metadata.wcs is None else np.array(metadata.wcs.pixel_to_world_values(1.0, 3.0)).tolist()
    return metadata.rows(), metadata.warnings, centre


@pytest.mark.parametrize(
    "key", [*NUMBERS, *TEXTS, "BLANK", "INHERIT", "LONPOLE", "EQUINOX", "A_ORDER", "CD1_1"]
)
@pytest.mark.parametrize("value", ["", "/ [s] not known"])
def test_a_card_without_a_value_is_as_good_as_none(tmp_path, key, value):
    without = told(with_cards(write_fits(tmp_path / "a.fits", IMAGE), *SKY_CARDS))
    path = with_cards(write_fits(tmp_path / "b.fits", IMAGE), *SKY_CARDS, card(key, value))
    assert told(path) == without
    assert not only(path).mask.any()


@pytest.mark.parametrize("key", SKY)
def test_coordinates_without_a_value_are_as_good_as_none(tmp_path, key):
    """wcslib would forget those of the other axis too."""
    rest = [text for text in SKY_CARDS if not text.startswith(key)]
    without = told(with_cards(write_fits(tmp_path / "a.fits", IMAGE), *rest))
    assert told(with_cards(write_fits(tmp_path / "b.fits", IMAGE), *rest, card(key, ""))) == without


@pytest.mark.parametrize("key", OPTICS)
def test_a_scale_is_made_of_what_has_a_value(tmp_path, key):
    rest = [card(*item) for item in OPTICS.items() if item[0] != key]
    without = told(with_cards(write_fits(tmp_path / "a.fits", IMAGE), *rest))
    assert told(with_cards(write_fits(tmp_path / "b.fits", IMAGE), *rest, card(key, ""))) == without


@pytest.mark.parametrize("name", ["a.fits", "a.fits.fz"])
def test_a_blank_without_a_value_masks_nothing(tmp_path, name):
    frame = only(with_cards(write_fits(tmp_path / name, IMAGE), card("BLANK", "")))
    np.testing.assert_array_equal(frame.data, IMAGE)
    assert not frame.mask.any()


def test_remarks_stay_where_one_of_them_looks_empty():
    text = "HISTORY = ".ljust(80) + "HISTORY it was dark".ljust(80)
    assert "it was dark" in PlainHeader(text.encode())["HISTORY"]


@pytest.mark.parametrize(("inherit", "exposure"), [("", 4.0), ("T", 4.0), ("F", None)])
@pytest.mark.parametrize("compressed", [False, True])
def test_an_extension_inherits_from_the_primary_header_unless_it_says_no(
    tmp_path, inherit, exposure, compressed
):
    image = (fits.CompImageHDU if compressed else fits.ImageHDU)(IMAGE, fits.Header({"EGAIN": 2.0}))
    fits.HDUList([fits.PrimaryHDU(header=fits.Header({"EXPTIME": 4.0})), image]).writeto(tmp_path / "a.fits")
    metadata = only(with_cards(tmp_path / "a.fits", card("INHERIT", inherit))).metadata
    assert metadata.value("exposure") == exposure
    assert metadata.value("gain") == 2.0


def test_a_card_without_a_value_lets_the_primary_header_answer(tmp_path):
    primary = fits.PrimaryHDU(header=fits.Header({"EXPTIME": 4.0}))
    fits.HDUList([primary, fits.ImageHDU(IMAGE)]).writeto(tmp_path / "a.fits")
    assert only(with_cards(tmp_path / "a.fits", card("EXPTIME", ""))).metadata.value("exposure") == 4.0


def test_cards_let_their_header_go_at_once():
    """No cycle keeps it until the collector runs: of 4000 HDUs that would be all headers at once."""
    header = PlainHeader(card("EXPTIME", 2.0).encode() + b"END".ljust(80))
    cards, gone = Cards(header), weakref.ref(header)
    assert cards.aside.number("EXPTIME").value == 2.0
    gc.disable()
    try:
        del cards, header
        assert gone() is None
    finally:
        gc.enable()


def test_a_warning_of_what_is_only_compared_is_not_one_of_the_header():
    cards = Cards({"EXPTIME": "long", "EXPOSURE": 2.0})
    assert cards.aside.number("EXPTIME") is None
    assert not cards.warnings
    assert cards.number("EXPTIME") is None
    assert cards.number("EXPTIME") is None
    assert len(cards.warnings) == 1
