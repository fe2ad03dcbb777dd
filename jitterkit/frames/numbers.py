"""Numbers as headers write them, some of them as text."""

from __future__ import annotations

import math
import re

__all__ = ["parse_number"]

_NUMBER = re.compile(
    r"(?P<sign>[-+]?)(?:(?P<over>[0-9]+\.?[0-9]*)\s?/\s?(?P<under>[0-9]+\.?[0-9]*)"
    r"|(?P<comma>0,[0-9]+|[0-9]+,(?:[0-9]{1,2}|[0-9]{4,})|[0-9]{4,},[0-9]+)"
    r"|(?P<plain>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eEdD][-+]?[0-9]+)?))"
    r"(?:\s*(?P<unit>[^\s0-9.,;:/+-][^0-9]*))?"
)
_IDENTIFIER = re.compile(r"[-+]?0[0-9]+")


def parse_number(value: object) -> tuple[float, str] | None:
    """Read a value as a number with an optional unit.

    Parameters
    ----------
    value : object
        Of a header's card.

    Returns
    -------
    number, unit : (float, str) or None
        None unless the whole of the value is a number: neither ``"00:02:30"`` nor ``"2 x 30 s"`` is one.
        ``"1/200"`` is a fraction.  A comma is read where it can only be a decimal one: in ``"3,7"`` and
        ``"0,375"``, not in ``"65,535"``.  Digits that begin with a zero, as in ``"00006"``, are a name.
    """
    if isinstance(value, bool):
        return None
    if isinstance(value, int | float):
        try:
            return float(value), ""
        except OverflowError:  # an integer of more than 308 digits
            return math.inf, ""
    text = str(value).strip()
    match = _NUMBER.fullmatch(text)
    if match is None or _IDENTIFIER.fullmatch(text.split()[0]):
        return None
    if match["under"]:
        if float(match["under"]) == 0:
            return None
        size = float(match["over"]) / float(match["under"])
    elif match["comma"]:
        size = float(match["comma"].replace(",", "."))
    else:
        size = float(match["plain"].upper().replace("D", "E"))
    return -size if match["sign"] == "-" else size, (match["unit"] or "").strip()
