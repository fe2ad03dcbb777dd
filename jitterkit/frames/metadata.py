"""The metadata of a frame, each with its source.

Reach for :class:`Metadata`.  Every number in it is a :class:`Sourced`: the value, its unit, and its
source in words, so that ``jitterkit info`` can answer "where does this gain come from?".  Sources
may be applied in any order with :meth:`Metadata.apply`, which obeys :data:`PRECEDENCE`:

    command line > pixels > sidecar > instrument file > header > preset > assumed

Of the pixels only a level at which they are cut off is read.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from datetime import UTC, datetime
from typing import Any

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.frames.units import COUNTS, RATES, resolve_unit

#: The first words of a source, from the most to the least authoritative.
PRECEDENCE = (
    "command line",
    "argument",
    "pixels",
    "sidecar",
    "instrument file",
    "header",
    "preset",
    "assumed",
)


@dataclass(frozen=True)
class Quantity:
    """A number a frame may carry: its unit and the open or closed range that is believable."""

    unit: str
    low: float
    high: float
    zero_allowed: bool = True

    def problem(self, value: float) -> str | None:
        """Say what is wrong with a value, or None."""
        if not math.isfinite(value):
            return "is not a finite number"
        if value == 0 and not self.zero_allowed:
            return "is zero"
        if not self.low <= value <= self.high:
            return f"is outside {self.low:g} to {self.high:g} {self.unit}"
        return None


#: The numbers, with the widest range of each that any detector or telescope has.
QUANTITIES: Mapping[str, Quantity] = {
    "exposure": Quantity("s", 0.0, 1e7),
    "gain": Quantity("e-/ADU", 0.0, 1e5, zero_allowed=False),
    "read_noise": Quantity("e-", 0.0, 1e5),
    "saturation": Quantity("ADU", 0.0, 1e12, zero_allowed=False),
    "bias": Quantity("ADU", -1e9, 1e9),
    "plate_scale": Quantity("arcsec/pixel", 0.0, 1e5, zero_allowed=False),
    "plate_scale_err": Quantity("relative", 0.0, 0.1),
    "va_factor": Quantity("ratio", 0.999, 1.001),
    "orbit_change": Quantity("arcsec", -1e3, 1e3),
    "line_time": Quantity("s", -10.0, 10.0),
    "bad_bits": Quantity("sum of bits", 0, 2**32 - 1),
}


_REMARKS = 3
"""Warnings that a message repeats."""

_LONGEST = 320
"""Characters of a warning: a header may hold a text of thousands."""

#: The warning for a rolling shutter whose rows have become columns.
ROWS_ARE_COLUMNS = "the file's rows are columns here, so that its line_time is not used"


@dataclass(frozen=True)
class Sourced:
    """A value with its unit and its source in words, such as ``"header EGAIN (HDU 0)"``."""

    value: Any
    unit: str
    source: str

    @property
    def precedence(self) -> int:
        """Return the index of the source in :data:`PRECEDENCE`, 0 the most authoritative."""
        matches = (n for n, words in enumerate(PRECEDENCE) if self.source.startswith(words))
        return next(matches, PRECEDENCE.index("header"))


def checked(name: str, value: Any) -> Any:
    """Return the value as the named field holds it, or raise ConfigurationError with a sentence."""
    if name == "time":
        try:
            when = datetime.fromisoformat(str(value))
        except ValueError:
            message = f"time = {str(value)!r} is no date; give it as 2026-11-21T03:00:00 in UTC."
            raise ConfigurationError(ErrorCode.OUT_OF_RANGE, message) from None
        return when.astimezone(UTC).replace(tzinfo=None).isoformat() if when.tzinfo else str(value)
    if name == "unit":
        unit = resolve_unit(str(value))
        if unit is None:
            message = f"unit = {value!r} is none of {', '.join(map(repr, COUNTS + RATES))}; say which."
            raise ConfigurationError(ErrorCode.UNKNOWN_UNIT, message)
        return unit
    code = ErrorCode.WRONG_TYPE if isinstance(value, bool) else ErrorCode.OUT_OF_RANGE
    try:
        number = math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError):
        number, code = math.nan, ErrorCode.WRONG_TYPE
    problem = QUANTITIES[name].problem(number)
    if name == "bad_bits" and problem is None and not number.is_integer():
        problem = "is not a whole number"
    if problem is not None:
        raise ConfigurationError(code, f"{name} = {value!r} {problem}; give it in {QUANTITIES[name].unit}.")
    return int(number) if name == "bad_bits" else number


@dataclass(frozen=True)
class Metadata:
    """Hold what is known about a frame beside its pixels; None where unknown.

    Parameters
    ----------
    exposure : Sourced, optional
        Exposure time [s].
    gain : Sourced, optional
        Electrons per ADU [e-/ADU].
    read_noise : Sourced, optional
        Standard deviation of the read-out noise [e-].
    saturation : Sourced, optional
        Level at and above which a pixel is not to be trusted [ADU]; that of a header is in electrons where
        the pixels are, and its unit says so.
    bias : Sourced, optional
        Level of an unexposed pixel [ADU].
    plate_scale : Sourced, optional
        Side of a pixel on the sky [arcsec/pixel].
    plate_scale_err : Sourced, optional
        Relative standard error of the plate scale.
    va_factor : Sourced, optional
        Velocity aberration: what a separation is multiplied by to be that seen from the barycentre.
    orbit_change : Sourced, optional
        By how much orbital motion has widened the pair since the reference epoch [arcsec].
    line_time : Sourced, optional
        From the start of one row's exposure to that of the row above it [s]; negative where rows are
        exposed downwards, zero where all are at once.  Rows as held in memory, which a TIFF's are not:
        see ``row_order``.
    bad_bits : Sourced, optional
        Sum of the bits of a quality plane (DQ, MASK) that mark a pixel as unusable.
    time : Sourced, optional
        Start (or middle, the source says which) of the exposure, ISO 8601, UTC.
    unit : Sourced, optional
        Of the pixel values, ``"adu"`` or ``"electron"``, or a rate: ``"adu/s"`` or ``"electron/s"``.  Any
        other is as a header has it, and refused by a detector; ADU is meant where this is None.
    wcs : astropy.wcs.WCS, optional
        Celestial part of the frame's world coordinates, for the *original* frame's 0-based pixels.
    warnings : tuple of str
        Irregularities that were found, and how they were interpreted.
    row_order : {1, -1, 0}
        What became of the file's rows: kept in their order (1), turned over (-1: a TIFF stores its top row
        first), or made into columns (0).
    window : mapping
        What the header says of the part of the detector that the image is: see
        :mod:`jitterkit.frames.window`.
    """

    exposure: Sourced | None = None
    gain: Sourced | None = None
    read_noise: Sourced | None = None
    saturation: Sourced | None = None
    bias: Sourced | None = None
    plate_scale: Sourced | None = None
    plate_scale_err: Sourced | None = None
    va_factor: Sourced | None = None
    orbit_change: Sourced | None = None
    line_time: Sourced | None = None
    bad_bits: Sourced | None = None
    time: Sourced | None = None
    unit: Sourced | None = None
    wcs: Any = None
    warnings: tuple[str, ...] = ()
    row_order: int = 1
    window: Mapping[str, tuple[float, ...]] = field(default_factory=dict)

    def override(self, source: str, **values: Any) -> Metadata:
        """Return a copy in which the given values replace what was known.

        Parameters
        ----------
        source : str
            Where the values come from; begin with a word of :data:`PRECEDENCE`.
        **values
            By field name, in the field's unit; a None changes nothing.

        Raises
        ------
        ConfigurationError
            If a name is not a field or a value is not believable; the message names both.
        """
        unknown = sorted(set(values) - {*FIELDS, "wcs"})
        if unknown:
            allowed = ", ".join((*FIELDS, "wcs"))
            problem = f"{unknown[0]!r} is not known about a frame"
            raise ConfigurationError(ErrorCode.UNKNOWN_NAME, f"{problem}; use one of {allowed}.")
        given = {name: value for name, value in values.items() if value is not None}
        for name, value in given.items():
            if name != "wcs" and not isinstance(value, Sourced):
                unit = QUANTITIES[name].unit if name in QUANTITIES else "UTC" if name == "time" else ""
                given[name] = Sourced(checked(name, value), unit, source)
        return replace(self, **given)

    def fill(self, source: str, **values: Any) -> Metadata:
        """Return a copy in which the given values are used only where nothing was known."""
        present = {name: getattr(self, name, None) for name in values}
        kept = {name: known for name, known in present.items() if known is not None}
        return replace(self.override(source, **values), **kept)

    def apply(self, source: str, **values: Any) -> Metadata:
        """Return a copy in which each value is used unless a more authoritative source gives one.

        Of two sources of the same precedence the later one wins.  A ``wcs`` has no precedence and only fills.
        """
        other, kept = self.override(source, **values), {}
        for name in values:
            known, new = getattr(self, name), getattr(other, name)
            ranked = isinstance(known, Sourced) and isinstance(new, Sourced)
            if known is not None and not (ranked and new.precedence <= known.precedence):
                kept[name] = known
        return replace(other, **kept)

    def warn(self, *messages: str) -> Metadata:
        """Return a copy with further warnings, each kept once, without the middle of one that is too long."""
        short = (text if len(text) <= _LONGEST else f"{text[:200]} ... {text[-100:]}" for text in messages)
        new = dict.fromkeys(message for message in short if message not in self.warnings)
        return replace(self, warnings=(*self.warnings, *new)) if new else self

    @property
    def remark(self) -> str:
        """Return the first warnings as a sentence for a row's message; empty where there are none."""
        if not self.warnings:
            return ""
        more = len(self.warnings) - _REMARKS
        shown = "; ".join(self.warnings[:_REMARKS])
        said = "Warnings of its file"
        return f"{said}: {shown}{f'; and {more} more, which jitterkit info prints' * (more > 0)}."

    def reordered(self, order: int) -> Metadata:
        """Return a copy for an image whose rows are no longer in the file's order.

        Parameters
        ----------
        order : {1, -1, 0}
            See ``row_order``.  A ``line_time`` of the file's rows becomes that of the image's.
        """
        line_time, stated = self.line_time, self.value("line_time", 0.0)
        if line_time is not None:
            line_time = replace(line_time, value=stated * order if stated else 0.0)
        changed = replace(self, row_order=order, line_time=line_time)
        return changed.warn(ROWS_ARE_COLUMNS) if stated and not order else changed

    def known(self) -> dict[str, Sourced]:
        """Return the known values by name, in the order of the fields."""
        values = {name: getattr(self, name) for name in FIELDS}
        return {name: value for name, value in values.items() if value is not None}

    def value(self, name: str, default: Any = None) -> Any:
        """Return the bare value of a field, or the default where it is unknown."""
        known = getattr(self, name)
        return default if known is None else known.value

    def rows(self) -> list[tuple[str, str, str, str]]:
        """Return ``(name, value, unit, source)`` for every field, as text, for a table."""
        rows = []
        for name in FIELDS:
            known, unit = getattr(self, name), QUANTITIES[name].unit if name in QUANTITIES else ""
            value = "unknown" if known is None else known.value
            text = f"{value:g}" if isinstance(value, float) else str(value)
            rows.append((name, text, unit, "") if known is None else (name, text, known.unit, known.source))
        axes = "" if self.wcs is None else " ".join(self.wcs.wcs.ctype)
        return [*rows, ("wcs", axes or "unknown", "", "header" if axes else "")]


_OTHERS = ("wcs", "warnings", "row_order", "window")

FIELDS = tuple(f.name for f in fields(Metadata) if f.name not in _OTHERS)
