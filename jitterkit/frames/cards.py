"""Looking a number up in a header: its keywords, its unit, and whether to believe it.

:class:`Cards` asks a header, and the primary one behind it, and collects what was odd as warnings; the rules
that need more than one keyword are in :mod:`jitterkit.frames.header`.
"""

from __future__ import annotations

import copy
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from jitterkit.frames.dialects import ALIASES, DIALECTS, Dialect, Keyword
from jitterkit.frames.metadata import QUANTITIES, Sourced
from jitterkit.frames.units import factor, other_number, stated_unit

_DEFAULTS: Mapping[str, str] = {"read_noise": "electron", "saturation": "adu", "bias": "adu"}
"""What is counted, and the unit that is meant where none is stated."""

_NO_DIALECT = Dialect("", "", "", {})

_AGREEMENT: Mapping[str, float] = {"exposure": 0.1, "plate_scale": 0.01}
"""Relative difference up to which two keywords agree; XPOSURE excludes the time that a shutter takes."""

_TIMES = ("exposure", "line_time")
"""Quantities that may be written as a fraction: 1/200 s."""

_KINDS = ("IMAGETYP", "OBSTYPE", "FRAME", "FRAMETYP", "OBJECT", "ESO DPR TYPE", "EXPTYPE")
_WITHOUT_LIGHT = re.compile(r"bias|zero|offset", re.I)
"""Keywords that say what was exposed, and their words for an exposure that ends when it begins."""

_BARE_WELL = re.compile(r"full.?well|capacity", re.I)
"""Comment of a saturation that is usually in electrons, and does not say so."""

_NUMBER = re.compile(
    r"(?P<sign>[-+]?)(?:(?P<over>[0-9]+\.?[0-9]*)\s?/\s?(?P<under>[0-9]+\.?[0-9]*)"
    r"|(?P<comma>0,[0-9]+|[0-9]+,(?:[0-9]{1,2}|[0-9]{4,})|[0-9]{4,},[0-9]+)"
    r"|(?P<plain>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eEdD][-+]?[0-9]+)?))"
    r"(?:\s*(?P<unit>[^\s0-9.,;:/+-][^0-9]*))?"
)
_PERHAPS_A_LIST = re.compile(r"\s*[-+]?[1-9][0-9]?,[0-9]{1,2}(?![0-9])")
_IDENTIFIER = re.compile(r"[-+]?0[0-9]+")


@dataclass(frozen=True)
class Number:
    """A number of a header.

    Parameters
    ----------
    value : float
        As written, or in the unit of its quantity.
    unit : str
        What stands behind the number in the same value.
    comment : str
    source : str
    key : str
    counted : str
        ``"adu"`` or ``"electron"`` or a rate of them, where a quantity may be in either; empty where the
        header does not say it.
    """

    value: float
    unit: str
    comment: str
    source: str
    key: str
    counted: str = ""

    @property
    def words(self) -> str:
        """Return what stands behind the number, and the comment."""
        return f"{self.unit} {self.comment}".strip()

    @property
    def said(self) -> str:
        """Return ``"EXPTIME = 30"``."""
        return f"{self.key} = {self.value:g}"

    @property
    def positive(self) -> bool:
        """Return whether it is positive and finite."""
        return 0 < self.value < math.inf


class Cards:
    """A header, and the primary one behind it, that note what was odd.

    Parameters
    ----------
    header : mapping
    hdu : int
        The number of its HDU.
    inherit : mapping, optional
        The primary header, which answers where the other is silent.

    Attributes
    ----------
    names : dict of str to None
        All keywords, each once, in the order of the headers.
    warnings : list of str
    """

    def __init__(
        self, header: Mapping[str, Any], hdu: int = 0, inherit: Mapping[str, Any] | None = None
    ) -> None:
        self.layers = [(header, hdu), *([] if inherit is None else [(inherit, 0)])]
        listed = (getattr(header, "names", header) for header, _ in self.layers)
        self.names = dict.fromkeys(key for names in listed for key in names)
        self.warnings: list[str] = []

    @cached_property
    def aside(self) -> Cards:
        """The same cards for numbers that are only compared and not used: nobody reads their warnings."""
        other = copy.copy(self)
        other.warnings = []
        return other

    @property
    def _behind(self) -> list[Cards]:
        """The primary header alone, where there is one behind this."""
        return [Cards(header, hdu) for header, hdu in self.layers[1:]]

    def warn(self, text: str) -> None:
        """Add a warning, each once."""
        self.warnings += [text] * (text not in self.warnings)

    def find(self, key: str) -> tuple[Any, str, str] | None:
        """Return ``(value, comment, source)`` of a keyword, or None."""
        for header, hdu in self.layers:
            value = header.get(key)
            if value is not None and type(value).__name__ != "Undefined":
                comments = getattr(header, "comments", None)
                return value, "" if comments is None else str(comments[key]), f"header {key} (HDU {hdu})"
        return None

    def text(self, key: str) -> str:
        """Return the value as text without outer blanks, empty where there is none."""
        card = self.find(key)
        return "" if card is None else str(card[0]).strip()

    @cached_property
    def dialect(self) -> Dialect:
        """The observatory whose keywords these are; one without a name where it has none of its own."""
        return next((d for d in DIALECTS if re.search(d.pattern, self.text(d.key), re.I)), _NO_DIALECT)

    def keywords(self, name: str) -> list[Keyword]:
        """Return the keywords of a quantity, the first believed first."""
        dialect = self.dialect
        own = dialect.keywords.get(name, ())
        if name in dialect.of_cubes:
            depths = filter(None, map(self.number, ("NAXIS3", "ZNAXIS3")))
            own = dialect.of_cubes[name] + own if any(depth.value > 1 for depth in depths) else own
        return [*own, *(key for key in ALIASES[name] if key not in dialect.others and key not in own)]

    def number(self, key: str) -> Number | None:
        """Return a number as it is written, or None with a warning if it is none."""
        card = self.find(key)
        if card is None:
            return None
        value, comment, source = card
        number = parse_number(value)
        if number is None:
            self.warn(f"{key} = {value!r} is not a number and is ignored")
            return None
        if isinstance(value, str) and _PERHAPS_A_LIST.match(value):
            self.warn(f"{key} = {value!r} is read as {number[0]:g}: if it is a list, give its number")
        return Number(*number, comment, source, key)

    def quantity(self, name: str, key: str) -> Number | None:
        """Return a number in the unit of a quantity, or None with a warning if its unit is not read."""
        number = self.number(key)
        if number is None:
            return None
        if not number.unit:  # EXPUNIT is that of EXPTIME
            beside = [f"{key[:3]}UNIT", f"{key[:3]}_UNIT", f"{key[:4]}UNIT", f"{key[:7]}U", f"{key[:3]}UNITS"]
            number = replace(number, unit=next(filter(None, map(self.text, beside)), ""))
        if name not in _TIMES and re.match(r"[-+\d. ]+/\s*\d", self.text(key)):
            self.warn(f"{key} = {self.text(key)!r} is not a number and is ignored")
            return None
        other = other_number(name, number.words)
        again = None if other is None else parse_number(other)  # 0.01667 is 1/60
        if other is not None and not (again and math.isclose(again[0], number.value, rel_tol=0.01)):
            self.warn(f"{number.said} means something else ({other!r} in {number.words!r}) and is ignored")
            return None
        meaning: float | str | None = ""
        if name != "gain":  # which has rules of its own
            unit = number.unit or stated_unit(name, number.comment, _DEFAULTS.get(name, 1.0))
            times = self.text("TIMEUNIT") if unit is None and name == "exposure" else ""
            meaning = factor(name, unit or times) if unit or times else ""
            # TIMEUNIT is of the times that FITS 4.0 defines, and may be meant of others
            if (times and key != "XPOSURE" and meaning != 1) or (
                unit is None and name == "saturation" and _BARE_WELL.search(number.comment)
            ):
                meaning = None
            if not (unit or times) and key == "SCALE":
                self.warn(f"{number.said} has no unit and is taken as arcsec/pixel")
        if meaning is None:
            words = number.words or f"TIMEUNIT = {self.text('TIMEUNIT')!r}"
            self.warn(f"{number.said} has a unit that is not read ({words}) and is ignored")
            return None
        if isinstance(meaning, str):
            return replace(number, counted=meaning)
        return replace(number, value=number.value * meaning)

    def believable(self, name: str, key: Keyword) -> Number | None:
        """Return :meth:`quantity`, or None with a warning if its value is absurd."""
        number = self.quantity(name, key) if isinstance(key, str) else self._mean(name, key)
        problem = None if number is None else QUANTITIES[name].problem(number.value)
        if number is None or problem is None:
            return number
        if (key, number.value) != ("EGAIN", 0):  # so programs write that they do not know it
            self.warn(f"{key} = {number.value:g} {problem} and is ignored")
        return None

    def believed(self, name: str) -> Iterator[Number]:
        """Yield the believable numbers of a quantity, the most authoritative first."""
        return filter(None, (self.believable(name, key) for key in self.keywords(name)))

    def _mean(self, name: str, keys: tuple[str, ...]) -> Number | None:
        """Mean over the amplifiers that read the image."""
        used = self.text("CCDAMP").upper()
        keys = tuple(key for key in keys if key[-1] in used) or keys
        numbers = [number for key in keys if (number := self.believable(name, key)) is not None]
        if not numbers:
            return None
        values = [number.value for number in numbers]
        mean = math.fsum(values) / len(values)
        if max(values) - min(values) > 0.01 * abs(mean):
            shown = f"{numbers[0].key} to {numbers[-1].key} = {min(values):g} to {max(values):g}"
            self.warn(f"the amplifiers differ ({shown}); their mean is taken")
        first = numbers[0]
        return replace(
            first,
            value=mean,
            source=first.source.replace(first.key, " and ".join(number.key for number in numbers)),
        )

    def first(self, name: str) -> Sourced | None:
        """Return the first believable number of a quantity, with a warning if another keyword contradicts."""
        number = next(self.believed(name), None)
        if number is None:
            return None
        others = [other for cards in (self.aside, *self._behind) for other in cards.believed(name)]
        if name == "exposure" and not number.value:  # of a bias, or of a program that does not know it
            number = next((other for other in others if other.value), number)
            if not number.value and not _WITHOUT_LIGHT.search(" ".join(map(self.text, _KINDS))):
                self.warn(f"{number.said} s: if there was light, give --exposure")
        if name in _AGREEMENT and number.key not in self.dialect.keywords.get(name, ()):
            for other in others:
                if abs(other.value - number.value) > _AGREEMENT[name] * max(other.value, number.value):
                    found = f"{other.said} {QUANTITIES[name].unit}"
                    found += f" ({other.source})" * (other.key == number.key)
                    self.warn(f"{number.said} is used, and {found} contradicts it")
        return Sourced(number.value, QUANTITIES[name].unit, number.source)


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
