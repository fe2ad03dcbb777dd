"""Numbers of headers that another card, or a comment of one word, proves to be in another unit."""

import numpy as np
import pytest
from astropy.io import fits
from headers import assert_number, header

from jitterkit.frames import read_frames

SIDES = {"NAXIS": 2, "NAXIS1": 128, "NAXIS2": 128}
TAN = {
    "CTYPE1": "RA---TAN", "CTYPE2": "DEC--TAN", "CRVAL1": 10.0, "CRVAL2": 20.0,
    "CRPIX1": 64.0, "CRPIX2": 64.0, "CD1_1": -0.375 / 3600, "CD1_2": 0.0, "CD2_1": 0.0, "CD2_2": 0.375 / 3600,
}  # fmt: skip
OPTICS = {"FOCALLEN": 2063.0, "XPIXSZ": 3.75}


@pytest.mark.parametrize(
    ("cards", "value", "named"),
    [
        ({"PIXSCALE": 375.0}, 375.0, "unusual"),
        ({"PIXSCALE": 90.0, "NAXIS1": 9000}, 90.0, "225 degrees"),
        ({"PIXSCALE": 25.0, "APTDIA": 5080.0, "XPIXSZ": 18.0}, 25.0, "5080 mm"),
        ({"PIXSCALE": 40.0, "APTDIA": 8200.0}, 40.0, "8200 mm"),
        ({"PIXSCALE": 375.0, **OPTICS}, 375.0, "XPIXSZ/FOCALLEN"),
        ({"PIXSCALE": 375.0, "FOCALLEN": 2063.0, "PIXSIZE1": 3.75}, 375.0, "PIXSIZE1*XBINNING/FOCALLEN"),
        ({"PIXSCALE": 0.375, **OPTICS, "APTDIA": 200.0}, 0.375, ""),
        ({"PIXSCALE": 52.0, "APTDIA": 17.0, "XPIXSZ": 6.0}, 52.0, ""),  # a lens of 24 mm
        ({"PIXSCALE": 21.0, "APTDIA": 105.0, "XPIXSZ": 15.0}, 21.0, ""),  # TESS
        ({"PIXSCALE": 0.025, "APTDIA": 5080.0, "XPIXSZ": 18.0}, 0.025, ""),
    ],
)
def test_a_scale_in_another_unit_is_doubted(cards, value, named):
    assert_number({**SIDES, **cards}, "plate_scale", value, named)


def test_the_sky_contradicts_a_scale_in_mas(tmp_path):
    cards = header({**TAN, "PIXSCALE": 375.0})
    fits.PrimaryHDU(np.ones((128, 128)), cards).writeto(tmp_path / "a.fits")
    (frame,) = read_frames(tmp_path / "a.fits")
    assert frame.metadata.value("plate_scale") == pytest.approx(0.375, rel=1e-6)
    assert any("PIXSCALE" in text and "375" in text for text in frame.metadata.warnings)


@pytest.mark.parametrize("key", ["FPS", "FRAMERAT", "FRAMERATE", "FRMRATE"])
@pytest.mark.parametrize(("rate", "comment", "doubted"), [
    (2.0, "", True), (2.0, "[Hz] frames per second", True), (0.002, "", False), (0.0019, "Hz", False),
    (2.0, "[kHz]", False), (0.0, "", False), (2.0, "frames per minute", False),
])  # fmt: skip
def test_a_frame_rate_shows_an_exposure_in_milliseconds(key, rate, comment, doubted):
    keyword = f"HIERARCH {key}" if len(key) > 8 else key
    cards = {"EXPTIME": 500.0, keyword: (rate, comment)}
    assert_number(cards, "exposure", 500.0, key if doubted else "")


@pytest.mark.parametrize("key", ["KCT", "FRAMTIME", "FRMTIME"])
def test_a_cycle_is_longer_than_its_exposure(key):
    assert_number({"EXPTIME": 500.0, key: 0.51}, "exposure", 500.0, key)
    assert_number({"EXPTIME": 0.5, key: 0.51}, "exposure", 0.5, "")


@pytest.mark.parametrize(
    ("key", "name", "comments"),
    [
        ("EXPTIME", "exposure", ("in weeks", "months", "years", "in pixels", "frames", "keV")),
        ("RDNOISE", "read_noise", ("eV rms", "eV (rms)", "[keV]", "in pixels", "rows", "lux")),
        ("SATURATE", "saturation", ("eV", "pixels", "in frames")),
        ("BIASLVL", "bias", ("eV", "columns")),
        ("LINETIME", "line_time", ("pixels", "in rows", "weeks")),
        ("PIXSCALE", "plate_scale", ("weeks", "eV")),
    ],
)
def test_a_comment_of_one_word_that_is_another_unit_counts(key, name, comments):
    for comment in comments:
        assert_number({key: (2.0, comment)}, name, None, key)


@pytest.mark.parametrize(
    ("key", "name", "comments"),
    [
        ("EXPTIME", "exposure", ("exposure of all pixels", "for these frames", "3 weeks after launch")),
        ("RDNOISE", "read_noise", ("electrons rms", "noise of masked pixels", "from the last two years")),
        ("PIXSCALE", "plate_scale", ("scale of pixels", "pixel scale")),
    ],
)
def test_a_sentence_with_such_a_word_says_nothing(key, name, comments):
    for comment in comments:
        assert_number({key: (2.0, comment)}, name, 2.0, "")
