"""Units of the columns of a table of motion, as its header writes them.

Reach for :func:`unit_factor`.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from math import pi

from astropy.units import Unit, UnitBase

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.loci.csv_table import heading


def assumed_units(header: Sequence[str], units: Sequence[str]) -> list[str]:
    """Return a sentence on the units that columns without one were taken to have; none if all have one.

    >>> assumed_units(["t", "x [mas]"], ["s", "arcsec"])
    ['The header gives no unit for t: read as s.']
    """
    taken = [
        (name, unit) for (name, stated), unit in zip(map(heading, header), units, strict=True) if not stated
    ]
    if not taken:
        return []
    names, read = (", ".join(words) for words in zip(*taken, strict=True))
    return [f"The header gives no unit for {names}: read as {read}."]


def refuse_half_stated(names: Sequence[str], units: Sequence[str]) -> None:
    """Raise ConfigurationError where some columns of one quantity have a unit and others none."""
    if any(units) and not all(units):
        problem = f"of the columns {', '.join(names)} only some have a unit"
        raise ConfigurationError(ErrorCode.CONFLICT, f"{problem}; write it behind each of them.")


_STANDARD = {
    r"\^": "**",
    r"[·⋅]": ".",
    r"\((\w+)\)(?=\*\*|\d)": r"\1",
    r"\b(h|H)[zZ]\b": "Hz",
    r"[ .*]?Hz(\*\*)?\(?-(0?\.5|1/2)\)?": "/sqrt(Hz)",
    r"Hz(\*\*)?\(?(0?\.5|1/2)\)?|(√|\b(sqrt|root|rt) ?)\(?Hz\)?": "sqrt(Hz)",
    r"(?<=[a-z]{3})s\b": "",
    r"(?<![a-zA-Z])([mµμun]?)sec\b": r"\1s",
    r"(?<![a-zA-Z])(as|asec)\b|''|\"": "arcsec",
    r"\bdps\b": "deg/s",
    r"\b[rc]pm\b": "1/min",
    r"\(?\bcycle ?/ ?s\b\)?": "Hz",
}
"""Patterns of what people write, and what astropy reads."""

_RAISED = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-")

_PER_RADIAN = re.compile(r" ?/ ?\(rad( ?/ ?s|[ .]s(\*\*)?-1)\)|[ .*]?\bs( ?/ ?rad|[ .]rad(\*\*)?-1)$")
"""Per unit of the angular frequency, at the end of a density."""


def _standard(unit: str) -> str:
    text = unit.translate(_RAISED)
    for pattern, standard in _STANDARD.items():
        text = re.sub(pattern, standard, text)
    return text


def is_per_frequency(unit: str) -> bool:
    """Return whether the unit of a density says of which frequency: per Hz, or per rad/s."""
    text = _standard(unit)
    return "Hz" in text or _PER_RADIAN.search(text) is not None


def unit_factor(column: str, unit: str, *wanted: str) -> tuple[float, str]:
    """Find what a unit is, and the factor to it.

    Parameters
    ----------
    column : str
        Name, for a complaint.
    unit : str
        As written; ``²`` and ``√Hz`` too.  An angular frequency in rad/s is 2π times one in Hz, and a
        density per rad/s is 2π times smaller than one per Hz.
    *wanted : str
        Units of different dimensions.

    Returns
    -------
    factor : float
    wanted : str
        The one of its dimension.

    Raises
    ------
    ConfigurationError
        If it is no unit, is that of a logarithm, or has none of the dimensions.
    """
    text = _standard(unit)
    units = {one: (one, 1.0) for one in wanted}
    if "Hz" in wanted and "rad" in text:
        units["Hz"] = ("rad/s", 0.5 / pi)
    if "arcsec2/Hz" in wanted and _PER_RADIAN.search(text):
        text, units["arcsec2/Hz"] = _PER_RADIAN.sub("/Hz", text), ("arcsec2/Hz", 2 * pi)
    for one, (like, turns) in units.items():
        try:
            found = Unit(text)
            if isinstance(found, UnitBase):  # no factor leads from a logarithm
                return turns * float(found.to(like)), one
        except (ValueError, TypeError):  # a wrong dimension is a TypeError too
            continue
    problem = f"The unit {unit!r} of the column {column} is not one of {', '.join(wanted)}"
    raise ConfigurationError(ErrorCode.UNKNOWN_UNIT, f"{problem}; give one that can be converted to it.")
