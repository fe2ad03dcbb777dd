"""Headers that are resolved by what the one before said: never told from those that are read alone."""

import numpy as np
import pytest
from astropy.io import fits

from jitterkit.frames import resolve_header
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
        assert remembered.resolve(plain(cards), hdu=0) == resolve_header(plain(cards))
        kept += before is not None and remembered._last is before
    assert 20 < kept < 380  # some changes are of nothing that was asked for, and some are not


def test_a_header_in_another_hdu_names_it():
    remembered = Remembered()
    for hdu in (0, 2, 2, 1):
        told = remembered.resolve(plain({"EGAIN": ("3.7",)}), hdu=hdu)
        assert told.gain.source == f"header EGAIN (HDU {hdu})"


def test_a_card_that_cannot_be_read_is_warned_of_every_time():
    cards = {"EGAIN": ("3.7.1",), "EXPTIME": ("1.0",)}
    remembered = Remembered()
    for _ in range(2):
        header = plain(cards)
        assert remembered.resolve(header).gain is None
        assert "cannot be read" in header.warnings[0]
