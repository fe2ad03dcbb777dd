"""Damage to FITS and TIFF files, from a seed: the food of ``scripts/fuzz_frames`` and of the readers' tests.

Reach for :func:`mutated`.  Some of the damage is blind (bytes changed, cut out, doubled, cut off), some knows
the format and aims: a card of a FITS header or an entry of a TIFF directory gets a value no writer gives.
"""

from __future__ import annotations

import gzip
import struct
import zlib
from collections.abc import Sequence
from typing import Any

import numpy as np

__all__ = ["bomb", "mutated"]

BLOCK, CARD = 2880, 80
GZIP = b"\x1f\x8b"

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
NUMBERS = (
    0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 12, 16, 17, 24, 32, 64, 255, 256, 6000, 32773, 32946, 33003, 34712, 34887,
    34892, 34925, 50000, 50001, 50002, 52546, 65000, 65535, 1 << 20, 1 << 28, (1 << 31) - 1, 1 << 31,
    (1 << 32) - 1, 1 << 40, (1 << 63) - 1, (1 << 64) - 1,
)  # fmt: skip
TAGS = (
    254, 255, 256, 257, 258, 259, 262, 266, 270, 273, 274, 277, 278, 279, 280, 284, 290, 292, 305, 306, 317,
    320, 322, 323, 324, 325, 330, 338, 339, 347, 400, 530, 700, 32997, 32998, 33432, 33550, 33628, 33629,
    34118, 34361, 34377, 34665, 34853, 37724, 42112, 50838, 50839, 51023, 65420, 65426,
)  # fmt: skip
TEXTS = (
    (b"images=", b"images=9"), (b"slices=", b"frames="), (b'"shape": [', b'"shape": [99, '),
    (b'SizeT="', b'SizeT="9'), (b"hyperstack=true", b"hyperstack=nope"), (b"ImageJ=", b"ImageK="),
    (b'ExposureTime="', b'ExposureTime="1e999'),
)  # fmt: skip


def mutated(content: bytes, rng: np.random.Generator) -> bytes:
    """Damage a file.

    Parameters
    ----------
    content : bytes
        Of a FITS (plain, gzipped or tile-compressed) or a TIFF.
    rng : numpy.random.Generator
        From which everything is drawn.

    Returns
    -------
    damaged : bytes
        One to four injuries later.
    """
    if content.startswith(GZIP) and rng.random() < 0.7:
        try:
            return gzip.compress(mutated(gzip.decompress(content), rng), 1, mtime=0)
        except (OSError, EOFError, zlib.error):  # damaged before
            pass
    aimed = _AIMED_AT_TIFF if content[:2] in (b"II", b"MM") else _AIMED_AT_FITS
    data = bytearray(content)
    for _ in range(min(int(rng.geometric(0.6)), 4)):
        kinds = aimed if rng.random() < 0.6 else _BLIND
        kinds[rng.integers(len(kinds))](data, rng)
    return bytes(data)


def bomb(kind: str, rng: np.random.Generator) -> bytes:
    """Make a small file that unpacks to, or declares, far more than it is.

    Parameters
    ----------
    kind : {"fits", "tiff"}
    rng : numpy.random.Generator

    Returns
    -------
    content : bytes
        A gzipped FITS of zeros, or a TIFF whose one strip is deflated zeros.
    """
    unpacked = 1 << int(rng.integers(16, 27))
    declared = 1 << int(rng.integers(16, 44))
    rows = 1 << int(rng.integers(0, 20))
    if kind == "tiff":
        return _tiff_bomb(declared // rows, rows, zlib.compress(bytes(unpacked), 1))
    cards = {"SIMPLE": "T", "BITPIX": 8, "NAXIS": 3, "NAXIS1": declared // rows, "NAXIS2": rows, "NAXIS3": 1}
    if rng.random() < 0.5:
        cards |= {"NAXIS1": 1, "NAXIS2": 1, "NAXIS3": declared}
    text = "".join(f"{key:8}= {value!s:>20}".ljust(CARD) for key, value in cards.items()) + "END".ljust(CARD)
    return gzip.compress(text.ljust(BLOCK).encode() + bytes(unpacked), 1, mtime=0)


def _tiff_bomb(width: int, height: int, strip: bytes) -> bytes:
    entries = {
        256: width,
        257: height,
        258: 8,
        259: 8,
        262: 1,
        273: 200,
        277: 1,
        278: height,
        279: len(strip),
    }
    directory = b"".join(struct.pack("<HHII", tag, 4, 1, v & 0xFFFFFFFF) for tag, v in entries.items())
    head = b"II*\0" + struct.pack("<IH", 8, len(entries)) + directory + bytes(4)
    return head.ljust(200, b"\0") + strip


# Blind damage


def _place(data: bytearray, rng: np.random.Generator) -> int:
    """A place in the file, mostly near its beginning, where its structure is."""
    reach = min(len(data), 6000) if rng.random() < 0.6 else len(data)
    return int(rng.integers(max(reach, 1)))


def _flip(data: bytearray, rng: np.random.Generator) -> None:
    for _ in range(int(rng.integers(1, 9))):
        if data:
            data[_place(data, rng)] ^= 1 << int(rng.integers(8))


def _overwrite(data: bytearray, rng: np.random.Generator) -> None:
    at, new = _place(data, rng), rng.bytes(int(rng.integers(1, 9)))
    data[at : at + len(new)] = bytes(len(new)) if rng.random() < 0.3 else new


def _insert(data: bytearray, rng: np.random.Generator) -> None:
    at = _place(data, rng)
    data[at:at] = rng.bytes(int(rng.choice([1, 2, 80, 2880])))


def _delete(data: bytearray, rng: np.random.Generator) -> None:
    at = _place(data, rng)
    del data[at : at + int(rng.choice([1, 2, 80, 2880]))]


def _double(data: bytearray, rng: np.random.Generator) -> None:
    at = _place(data, rng)
    data[at:at] = data[at : at + int(rng.choice([80, 512, 2880, 5760]))]


def _truncate(data: bytearray, rng: np.random.Generator) -> None:
    del data[_place(data, rng) :]


def _blank(data: bytearray, rng: np.random.Generator) -> None:
    at, length = _place(data, rng), int(rng.choice([16, 80, 512, 2880]))
    data[at : at + length] = bytes([int(rng.choice([0, 32, 255]))]) * len(data[at : at + length])


def _append(data: bytearray, rng: np.random.Generator) -> None:
    data += rng.bytes(int(rng.integers(1, 6000)))


_BLIND = (_flip, _overwrite, _insert, _delete, _double, _truncate, _blank, _append)


# FITS


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


def _any_of(rng: np.random.Generator, choices: Sequence[Any]) -> Any:
    return choices[int(rng.integers(len(choices)))]


def _value(rng: np.random.Generator) -> bytes:
    return _any_of(rng, VALUES)


def _card(keyword: str, value: bytes) -> bytes:
    start = b"HIERARCH LONG KEY = " if keyword == "HIERARCH" else f"{keyword:8}= ".encode()
    return (start + value.rjust(20))[:CARD].ljust(CARD)


def _named(data: bytearray, cards: list[int], rng: np.random.Generator) -> int:
    """One of the structural cards that are there, or any card."""
    structural = [at for at in cards if data[at : at + 8].decode("latin-1").strip() in STRUCTURE]
    return _any_of(rng, structural if structural and rng.random() < 0.7 else cards)


def _set_card(data: bytearray, rng: np.random.Generator) -> None:
    if cards := _cards(data, rng):
        at = _named(data, cards, rng)
        data[at + 10 : at + CARD] = _card("", _value(rng))[10:]


def _put_card(data: bytearray, rng: np.random.Generator) -> None:
    if cards := _cards(data, rng):
        at = _any_of(rng, cards[3:] or cards)
        data[at : at + CARD] = _card(_any_of(rng, STRUCTURE if rng.random() < 0.6 else MEANING), _value(rng))


def _copy_card(data: bytearray, rng: np.random.Generator) -> None:
    if cards := _cards(data, rng):
        source, target = _any_of(rng, cards), _any_of(rng, cards)
        data[target : target + CARD] = data[source : source + CARD]


def _drop_card(data: bytearray, rng: np.random.Generator) -> None:
    if cards := _cards(data, rng):
        at = _any_of(rng, cards)
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
            int(rng.integers(256)) if rng.random() < 0.5 else ord(_any_of(rng, "0123456789 TF'/=-+.eE&"))
        )


_AIMED_AT_FITS = (
    _set_card,
    _set_card,
    _put_card,
    _put_card,
    _copy_card,
    _drop_card,
    _continue_card,
    _scramble_card,
)


# TIFF


def _entries(data: bytearray) -> tuple[str, bool, list[int], list[int]]:
    """Byte order, whether BigTIFF, where the entries of the directories begin, and where the links stand."""
    order, big = ("<" if data[:2] == b"II" else ">"), data[2:4] in (b"+\0", b"\0+")
    entry, width, code = (20, 8, "Q") if big else (12, 4, "I")
    links, entries = [8 if big else 4], []
    for _ in range(12):
        try:
            offset = struct.unpack_from(order + code, data, links[-1])[0]
            count = struct.unpack_from(order + ("Q" if big else "H"), data, offset)[0] if offset else 0
        except (struct.error, OverflowError):  # beyond the file, or beyond all files
            break
        first = offset + (8 if big else 2)
        if not 0 < count < 500 or first + count * entry + width > len(data):
            break
        entries += [first + n * entry for n in range(count)]
        links.append(first + count * entry)
    return order, big, entries, links


def _number(data: bytearray, rng: np.random.Generator) -> int:
    near = (len(data), len(data) - 1, 8, 16)
    return int(_any_of(rng, near)) if rng.random() < 0.2 else int(_any_of(rng, NUMBERS))


def _store(data: bytearray, at: int, code: str, value: int) -> None:
    size = struct.calcsize(code)
    if at + size <= len(data):
        struct.pack_into(code, data, at, value & ((1 << 8 * size) - 1))


def _set_entry(data: bytearray, rng: np.random.Generator) -> None:
    order, big, entries, _ = _entries(data)
    if entries:
        _store(
            data,
            _any_of(rng, entries) + (12 if big else 8),
            order + _any_of(rng, "HIQ" if big else "HI"),
            _number(data, rng),
        )


def _set_count(data: bytearray, rng: np.random.Generator) -> None:
    order, big, entries, _ = _entries(data)
    if entries:
        _store(data, _any_of(rng, entries) + 4, order + ("Q" if big else "I"), _number(data, rng))


def _set_type(data: bytearray, rng: np.random.Generator) -> None:
    order, _, entries, _ = _entries(data)
    if entries:
        _store(data, _any_of(rng, entries) + 2, order + "H", int(rng.integers(20)))


def _set_tag(data: bytearray, rng: np.random.Generator) -> None:
    order, _, entries, _ = _entries(data)
    if entries:
        _store(data, _any_of(rng, entries), order + "H", int(_any_of(rng, TAGS)))


def _set_link(data: bytearray, rng: np.random.Generator) -> None:
    order, big, _, links = _entries(data)
    offsets = [
        struct.unpack_from(order + ("Q" if big else "I"), data, at)[0] for at in links if at + 8 <= len(data)
    ]
    value = _any_of(rng, offsets) if offsets and rng.random() < 0.4 else _number(data, rng)
    _store(data, _any_of(rng, links), order + ("Q" if big else "I"), value)


def _copy_entry(data: bytearray, rng: np.random.Generator) -> None:
    _, big, entries, _ = _entries(data)
    if entries:
        source, target, size = _any_of(rng, entries), _any_of(rng, entries), 20 if big else 12
        data[target : target + size] = data[source : source + size]


def _change_text(data: bytearray, rng: np.random.Generator) -> None:
    old, new = _any_of(rng, TEXTS)
    at = data.find(old)
    if at >= 0:
        data[at : at + len(new)] = new


_AIMED_AT_TIFF = (
    _set_entry, _set_entry, _set_entry, _set_count, _set_type, _set_tag, _set_link, _copy_entry, _change_text,
)  # fmt: skip
