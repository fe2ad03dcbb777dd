"""Damage that aims at the directories of a TIFF: tags, types, counts, values and links no writer gives.

Reach for :data:`AIMED_AT_TIFF`, functions of the bytes and a generator.
"""

from __future__ import annotations

import struct

import numpy as np
from fuzz_blind import any_of

__all__ = ["AIMED_AT_TIFF"]

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
    return int(any_of(rng, near)) if rng.random() < 0.2 else int(any_of(rng, NUMBERS))


def _store(data: bytearray, at: int, code: str, value: int) -> None:
    size = struct.calcsize(code)
    if at + size <= len(data):
        struct.pack_into(code, data, at, value & ((1 << 8 * size) - 1))


def _set_entry(data: bytearray, rng: np.random.Generator) -> None:
    order, big, entries, _ = _entries(data)
    if entries:
        _store(
            data,
            any_of(rng, entries) + (12 if big else 8),
            order + any_of(rng, "HIQ" if big else "HI"),
            _number(data, rng),
        )


def _set_count(data: bytearray, rng: np.random.Generator) -> None:
    order, big, entries, _ = _entries(data)
    if entries:
        _store(data, any_of(rng, entries) + 4, order + ("Q" if big else "I"), _number(data, rng))


def _set_type(data: bytearray, rng: np.random.Generator) -> None:
    order, _, entries, _ = _entries(data)
    if entries:
        _store(data, any_of(rng, entries) + 2, order + "H", int(rng.integers(20)))


def _set_tag(data: bytearray, rng: np.random.Generator) -> None:
    order, _, entries, _ = _entries(data)
    if entries:
        _store(data, any_of(rng, entries), order + "H", int(any_of(rng, TAGS)))


def _set_link(data: bytearray, rng: np.random.Generator) -> None:
    order, big, _, links = _entries(data)
    offsets = [
        struct.unpack_from(order + ("Q" if big else "I"), data, at)[0] for at in links if at + 8 <= len(data)
    ]
    value = any_of(rng, offsets) if offsets and rng.random() < 0.4 else _number(data, rng)
    _store(data, any_of(rng, links), order + ("Q" if big else "I"), value)


def _copy_entry(data: bytearray, rng: np.random.Generator) -> None:
    _, big, entries, _ = _entries(data)
    if entries:
        source, target, size = any_of(rng, entries), any_of(rng, entries), 20 if big else 12
        data[target : target + size] = data[source : source + size]


def _change_text(data: bytearray, rng: np.random.Generator) -> None:
    old, new = any_of(rng, TEXTS)
    at = data.find(old)
    if at >= 0:
        data[at : at + len(new)] = new


AIMED_AT_TIFF = (
    _set_entry, _set_entry, _set_entry, _set_count, _set_type, _set_tag, _set_link, _copy_entry, _change_text,
)  # fmt: skip
