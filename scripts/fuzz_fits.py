"""Damage that aims at the cards of a FITS header: values no writer gives, cards lost, doubled or scrambled.

Reach for :data:`AIMED_AT_FITS`, functions of the bytes and a generator.
"""

from __future__ import annotations

import numpy as np
from fuzz_blind import any_of

__all__ = ["AIMED_AT_FITS", "BLOCK", "CARD"]

BLOCK, CARD = 2880, 80

STRUCTURE = (
    "SIMPLE", "XTENSION", "BITPIX", "NAXIS", "NAXIS1", "NAXIS2", "NAXIS3", "NAXIS4", "NAXIS999", "PCOUNT",
    "GCOUNT", "GROUPS", "EXTEND", "TFIELDS", "THEAP", "TFORM1", "TFORM2", "TFORM3", "TTYPE1", "TTYPE2",
    "TTYPE3", "ZIMAGE", "ZCMPTYPE", "ZBITPIX", "ZNAXIS", "ZNAXIS1", "ZNAXIS2", "ZNAXIS3", "ZTILE1", "ZTILE2",
    "ZTILE3", "ZNAME1", "ZVAL1", "ZNAME2", "ZVAL2", "ZQUANTIZ", "ZDITHER0", "ZBLANK", "ZSCALE", "ZZERO",
    "ZSIMPLE", "ZEXTEND", "BSCALE", "BZERO", "BLANK", "EXTNAME", "EXTVER", "INHERIT", "END", "CONTINUE",
    "CHECKSUM", "DATASUM",
)  # fmt: skip
MEANING = (
    "EXPTIME", "EXPOSURE", "GAIN", "EGAIN", "EPERADU", "RDNOISE", "SATURATE", "DATAMAX", "BIASLVL",
    "PIXSCALE", "SECPIX", "FOCALLEN", "XPIXSZ", "PIXSIZE1", "XBINNING", "SWCREATE", "ORIGIN", "BUNIT",
    "TIMESYS", "DATE-OBS", "TIME-OBS", "UT", "MJD-OBS", "DATE-AVG", "WCSAXES", "CTYPE1", "CTYPE2", "CTYPE3",
    "CRPIX1", "CRVAL1", "CDELT1", "CDELT2", "CUNIT1", "CD1_1", "CD2_2", "PC1_1", "CROTA2", "LONPOLE", "PV2_1",
    "PV1_5", "A_ORDER", "A_2_0", "B_ORDER", "CPDIS1", "DP1", "D2IMDIS1", "D2IM1", "WAT1_001", "RADESYS",
    "EQUINOX", "CNAME1", "PS1_0", "COMMENT", "HISTORY", "HIERARCH",
)  # fmt: skip
VALUES = (
    b"0", b"-1", b"1", b"2", b"3", b"4", b"7", b"8", b"16", b"-32", b"-64", b"17", b"64", b"999", b"1000",
    b"65536", b"2147483647", b"2147483648", b"4294967295", b"4294967296", b"9223372036854775807",
    b"9223372036854775808", b"-2147483648", b"99999999999999999999999", b"1e30", b"1E400", b"-1D5", b"1.5",
    b"nan", b"NaN", b"inf", b"-INF", b"1e-320", b"T", b"F", b"(1,2)", b"0x10", b"1_000", b"''", b"'abc'",
    b"'unclosed", b"'it''s'", b"'RICE_1'", b"'GZIP_1'", b"'GZIP_2'", b"'PLIO_1'", b"'HCOMPRESS_1'",
    b"'NOCOMPRESS'", b"'1PB(99)'", b"'1QD'", b"'0A'", b"'999999999E'", b"'1PB(-3)'", b"'IMAGE'",
    b"'BINTABLE'",
    b"'TABLE'", b"'RA---TAN'", b"'DEC--SIP'", b"'RA---ZPN'", b"'electron'", b"'e/ADU'", b"'../../etc/passwd'",
    b"'$(id)'", b"'<script>'", b"'2027-13-45T99:99:99'", b"'31/12/99'", b"'0001-01-01T00:00:00-23:59'",
    b"'SCALE'", b"'BYTEPIX'", b"'TPD'", b"'LOOKUP'", b"'SUBTRACTIVE_DITHER_1'", b"", b"     ",
    b"\xff\xfe\xfd", "'größe'".encode(), b"\0\0\0", b"\t5", b"'a&'", b"1 2 3 / two words", b"= 5",
)  # fmt: skip


def _cards(data: bytearray, rng: np.random.Generator) -> list[int]:
    """Where the cards of one of the headers begin, without its END; empty where there is no header."""
    headers = [at for at in range(0, len(data), BLOCK) if data[at : at + 8] in (b"SIMPLE  ", b"XTENSION")]
    if not headers:
        return []
    start = headers[int(rng.integers(len(headers)))]
    cards = []
    for at in range(start, min(len(data), start + 40 * BLOCK), CARD):
        if data[at : at + 8] == b"END     ":
            break
        cards.append(at)
    return cards


def _value(rng: np.random.Generator) -> bytes:
    return any_of(rng, VALUES)


def _card(keyword: str, value: bytes) -> bytes:
    start = b"HIERARCH LONG KEY = " if keyword == "HIERARCH" else f"{keyword:8}= ".encode()
    return (start + value.rjust(20))[:CARD].ljust(CARD)


def _named(data: bytearray, cards: list[int], rng: np.random.Generator) -> int:
    """One of the structural cards that are there, or any card."""
    structural = [at for at in cards if data[at : at + 8].decode("latin-1").strip() in STRUCTURE]
    return any_of(rng, structural if structural and rng.random() < 0.7 else cards)


def _set_card(data: bytearray, rng: np.random.Generator) -> None:
    if cards := _cards(data, rng):
        at = _named(data, cards, rng)
        data[at + 10 : at + CARD] = _card("", _value(rng))[10:]


def _put_card(data: bytearray, rng: np.random.Generator) -> None:
    if cards := _cards(data, rng):
        at = any_of(rng, cards[3:] or cards)
        data[at : at + CARD] = _card(any_of(rng, STRUCTURE if rng.random() < 0.6 else MEANING), _value(rng))


def _copy_card(data: bytearray, rng: np.random.Generator) -> None:
    if cards := _cards(data, rng):
        source, target = any_of(rng, cards), any_of(rng, cards)
        data[target : target + CARD] = data[source : source + CARD]


def _drop_card(data: bytearray, rng: np.random.Generator) -> None:
    if cards := _cards(data, rng):
        at = any_of(rng, cards)
        data[at : at + CARD] = b"COMMENT ".ljust(CARD)


def _continue_card(data: bytearray, rng: np.random.Generator) -> None:
    if len(cards := _cards(data, rng)) > 2:
        at = cards[int(rng.integers(len(cards) - 1))]
        data[at + 10 : at + CARD] = b"'long&'".ljust(70)
        data[at + CARD : at + 2 * CARD] = b"CONTINUE  'er&'".ljust(CARD)


def _scramble_card(data: bytearray, rng: np.random.Generator) -> None:
    if cards := _cards(data, rng):
        at = min(_named(data, cards, rng) + int(rng.integers(30)), len(data) - 1)  # it may be cut short
        data[at] = (
            int(rng.integers(256)) if rng.random() < 0.5 else ord(any_of(rng, "0123456789 TF'/=-+.eE&"))
        )


AIMED_AT_FITS = (
    _set_card,
    _set_card,
    _put_card,
    _put_card,
    _copy_card,
    _drop_card,
    _continue_card,
    _scramble_card,
)
