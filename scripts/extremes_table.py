"""The rows of ``scripts/extremes``, in the order of their writing, and what most of them look at."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from extremes_checks import STATE, Check, binary, image_of, telescope

from jitterkit.loci import Stable

__all__ = ["OTF", "ROUNDING", "ROWS", "STILL", "TELESCOPE", "UNRESOLVED", "Row", "row"]

ROUNDING = 1e-12
TELESCOPE = telescope()
OTF = TELESCOPE.optics(STATE)
STILL = image_of(binary(), Stable.of(), OTF)
UNRESOLVED = ("NO_PAIR", "NOT_CONVERGED", "POOR_FIT", "NO_STAR")
"""Ends of a frame that shows no pair."""


class Row(NamedTuple):
    """An extreme, what must come out of it, what makes it come out, and whether in a process of its own."""

    extreme: str
    must: str
    checks: Callable[[], list[Check]]
    alone: bool


ROWS: list[Row] = []


def row(extreme: str, must: str, *, alone: bool = False):
    """Enter a function into the table; ``alone`` in a process of its own."""

    def enter(checks: Callable[[], list[Check]]):
        ROWS.append(Row(extreme, must, checks, alone))
        return checks

    return enter
