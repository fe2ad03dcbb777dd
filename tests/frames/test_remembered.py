"""Headers that are resolved by what the one before said: never told from those that are read alone."""

import numpy as np
import pytest
from astropy.io import fits

from jitterkit.frames import read_frames, resolve_header
from jitterkit.frames.header import Remembered
from jitterkit.frames.plainheader import PlainHeader

WHAT_CARDS_MAY_SAY = {
    "EXPTIME": ("2.0", "'250 ms  '", "-1", "'long    '"),
    "EXPOSURE": ("3.5", "40 / in milliseconds"),
    "EGAIN": ("3.7", "0", "0.25"),
    "GAIN": ("1.9", "120", "1.9 / ADU per electron"),
    "RDNOISE": ("2.4", "2.0 / [ADU] rms", "1e9"),
    "SATURATE": ("4095.0", "1e300"),
    "DATAMAX": ("60000.0", "60000.5"),
    "BIASLVL": ("30.0", "'dark    '"),
    "PIXSCALE": ("0.375", "375.0 / [mas/pixel]", "0"),
    "FOCALLEN": ("1320.0", "0"),
    "XPIXSZ": ("2.4", "4.8"),
    "XBINNING": ("1", "2"),
    "BUNIT": ("'adu     '", "'electron'", "'MJy/sr  '"),
    "SWCREATE": ("'SharpCap'", "'ours    '"),
    "TIMESYS": ("'UTC     '", "'TAI     '"),
    "DATE-OBS": ("'2026-11-25T01:02:03'", "'2026-11-25'", "'yesterday'"),
    "TIME-OBS": ("'04:05:06'", "'dusk    '"),
    "AIRTEMP": ("11.5", "11.6"),
}


def plain(cards):
    lines = [f"{key:8s}= {value:>20s}".ljust(80) for key, values in cards.items() for value in values]
    return PlainHeader("".join(lines).encode(), fits.Card.fromstring)


@pytest.mark.parametrize("seed", range(4))
def test_a_header_says_the_same_whatever_came_before_it(seed):
    rng, remembered, cards = np.random.default_rng(seed), Remembered(), {}
    kept = 0
    for _ in range(400):
        key = str(rng.choice(list(WHAT_CARDS_MAY_SAY)))
        values = WHAT_CARDS_MAY_SAY[key]
        cards[key] = tuple(map(str, rng.choice(values, rng.choice(3, p=[0.3, 0.65, 0.05]))))
        before = remembered._last
        header, alone = plain(cards), plain(cards)
        assert remembered.resolve(header) == resolve_header(alone)
        assert header.warnings == alone.warnings
        kept += before is not None and remembered._last is before
    assert 20 < kept < 380  # some changes are of nothing that was asked for, and some are not


def test_a_header_in_another_hdu_names_it():
    remembered = Remembered()
    for hdu in (0, 2, 2, 1):
        told = remembered.resolve(plain({"EGAIN": ("3.7",)}), hdu=hdu)
        assert told.gain.source == f"header EGAIN (HDU {hdu})"


@pytest.mark.parametrize("card", ["EGAIN   3.7", "EGAIN   =3.7", "SATURATE: 65535", "EGAIN   = 3.7.1"])
def test_a_file_like_the_one_before_is_warned_of_as_that_was(card, tmp_path):
    made = fits.PrimaryHDU(np.ones((4, 4), np.int16)).header.tostring(endcard=False, padding=False)
    header = "".join(line.ljust(80) for line in (made, card, "RDNOISE = 2.4", "END"))
    content = header.encode().ljust(2880) + bytes(2880)
    for name in ("one.fits", "two.fits"):
        (tmp_path / name).write_bytes(content)
    one, two = (next(read_frames(tmp_path / name)).metadata for name in ("one.fits", "two.fits"))
    assert one.warnings
    assert one == two


def test_a_card_without_a_value_is_no_reason_to_forget():
    remembered = Remembered()
    cards = {"BUNIT": (" / unknown",), "EGAIN": ("3.7",)}
    first = remembered.resolve(plain(cards))
    kept = remembered._last
    assert remembered.resolve(plain(cards)) == first
    assert remembered._last is kept is not None


def test_a_card_that_cannot_be_read_is_warned_of_every_time():
    cards = {"EGAIN": ("3.7.1",), "EXPTIME": ("1.0",)}
    remembered = Remembered()
    for _ in range(2):
        header = plain(cards)
        assert remembered.resolve(header).gain is None
        assert "cannot be read" in header.warnings[0]
