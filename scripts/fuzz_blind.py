"""Damage that knows no format: bytes changed, cut out, doubled, cut off.

Reach for :data:`BLIND`, functions of the bytes and a generator.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

__all__ = ["BLIND", "any_of"]


def any_of(rng: np.random.Generator, choices: Sequence[Any]) -> Any:
    """One of a few, whatever they are."""
    return choices[int(rng.integers(len(choices)))]


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


BLIND = (_flip, _overwrite, _insert, _delete, _double, _truncate, _blank, _append)
