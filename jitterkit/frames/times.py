"""The time of an exposure, from the many ways headers write it.

:func:`resolve_time` returns ISO 8601 in UTC.  The start of the exposure is preferred: DATE-BEG, DATE-OBS
or DATE_OBS (with TIME-OBS or UT where the date stands alone), MJD-BEG, MJD-OBS; then the middle: DATE-AVG,
MJD-AVG; then MJD and JD.
"""

from __future__ import annotations

import math
import re
from datetime import UTC, datetime, timedelta
from typing import Any

from jitterkit.frames.cards import Cards
from jitterkit.frames.metadata import Sourced

TIME_KEYS = ("TIME-OBS", "UTC-OBS", "UTSTART", "UT-STR", "UT-TIME", "UT", "UTSHUT", "UTC", "TIME_OBS")
_DATE_KEYS = (
    "DATE-BEG", "DATE-OBS", "DATE_OBS", "MJD-BEG", "MJD-OBS", "DATE-AVG", "MJD-AVG", "MJD", "JD",
)  # fmt: skip
_END_KEYS = ("TIME-END", "UTC-END", "UT-END", "UTEND", "UTSTOP")
MJD_EPOCH = datetime(1858, 11, 17)

_JULIAN = 2400000.5
"""Julian date of the epoch of the modified one."""

_FIRST_MJD = 10000
"""Below, in 1886, are days counted from elsewhere."""

_DATE = re.compile(
    r"(?P<date>\d{4}([-/.])\d{1,2}\2\d{1,2})"
    r"((T|\s+)(?P<hours>\d{1,2}):(?P<minutes>\d{1,2})(:(?P<seconds>\d{1,2}([.,]\d*)?))?)?"
    r"\s*(Z|UTC?|GMT|(?P<sign>[-+])(?P<east>\d\d):?(?P<more>\d\d))?",
    re.I,
)
"""ISO 8601, and what is near it: slashes, blanks, single digits, 60 seconds."""

_OTHERS = {
    r"^(\d\d)/(\d\d)/(\d\d)$": r"19\3-\2-\1",
    r"^(\d{4})(\d\d)(\d\d)$": r"\1-\2-\3",
    r"^(\d{4})(\d\d)(\d\d)T(\d\d)(\d\d)(\d\d)$": r"\1-\2-\3T\4:\5:\6",
}
"""Dates of the years 1900 to 1999, and ISO 8601 without separators, with what they are replaced by."""

_DAY = timedelta(days=1)
_HEADER_FIRST = timedelta(seconds=1)
"""A DATE this soon, in whole seconds, may be that of a header which was made before the exposure."""

_CONTRADICTION = timedelta(hours=1)
"""Difference of a time in UTC and a local one, at least."""

_CLOCKS = timedelta(seconds=2)
"""Difference of one time in two keywords, at most; TAI is 10 s or more ahead of UTC."""

_FIRST_DETECTOR = 1970
"""Before, there were plates; the standard of two digits for the year means years from 1900 on."""

_LOCAL = re.compile(
    r"(?i:\b(local|lokal\w*|ortszeit|heure locale|hora local)\b)|\bLT\b|\b(UTC?|GMT) ?[-+] ?\d"
    r"|\b(JST|KST|EST|EDT|CST|CDT|MST|MDT|PST|PDT|CES?T|MES?Z|BST|IST|AES?T|AEDT|CLS?T|MSK)\b"
)
_IN_UTC = re.compile(r"^\W*(in )?(UTC?|GMT)\b(?! ?[-+] ?\d)")
"""Comments of a time that is local, and of one that is not although a local one is named."""

_LATE = re.compile(r"\b(end|stop|finish|clos\w+|mid(dle|point)?|cent(er|re)|average|mean)\b", re.I)
_BEGIN = re.compile(r"\b(start|begin\w*|open\w*|beginning)\b", re.I)
"""Comments of a time that is not, or is, the beginning of the exposure."""

_SCALES = {"TAI": "tai", "TT": "tt", "TDT": "tt", "ET": "tt", "TDB": "tdb", "TCB": "tcb", "TCG": "tcg"}
"""Time scales, of ``TIMESYS`` or else of a comment, that are converted to UTC."""

_SCALE_NAME = re.compile(rf"\b({'|'.join(_SCALES)})\b")
_UTC_NAME = re.compile(r"\b(UTC?|GMT)\b")
_ZONE = re.compile(r"T.*(Z|UTC?|GMT|[-+]\d\d:?\d\d)\s*$", re.I)
"""A date and time that name their zone, from which they are converted."""


def resolve_time(cards: Cards) -> Sourced | None:
    """Find when the exposure was taken.

    Parameters
    ----------
    cards : Cards
        The headers; a malformed date adds a warning to them.

    Returns
    -------
    time : Sourced or None
        Text such as ``"2016-09-09T08:12:26"``, unit ``"UTC"``.  Another keyword that says more than an hour
        and than the exposure from it adds a warning.
    """
    day = None
    for key in _DATE_KEYS:
        known = _stated(cards, key)
        if known is not None and "T" in known.value and (day is None or known.value[:10] == day.value[:10]):
            break
        day = day or known  # without a time of day, unless another keyword has one on it
    else:
        return day
    when = datetime.fromisoformat(known.value)
    for other in ("DATE-OBS", "MJD-OBS", "JD"):
        said = None if other == key else _stated(cards.aside, other)
        at = None if said is None or "T" not in said.value else datetime.fromisoformat(said.value)
        if said is not None and at is not None and _contradicts(cards, abs(at - when)):
            cards.warn(f"{key} = {known.value} is used, and {other} contradicts it ({said.value})")
            return known
    for other in TIME_KEYS:
        text = cards.text(other)
        at = _parse(f"{when.date().isoformat()}T{text.partition('T')[2] or text}")
        if isinstance(at, datetime) and _contradicts(cards, abs((at - when + _DAY / 2) % _DAY - _DAY / 2)):
            cards.warn(f"{known.source} = {known.value} is used, and {other} = {text} contradicts it")
            break
    return known


def seconds_to_end(cards: Cards, start: Sourced | None) -> tuple[str, float | None]:
    """Return the seconds from the time of a header to the end of its exposure, and what says so.

    Parameters
    ----------
    cards : Cards
    start : Sourced or None
        As :func:`resolve_time` gives it.

    Returns
    -------
    key : str
        ``DATE-END`` and its like, the middle, a time of day, or ``DATE``, when the file was written.
    seconds : float or None
        Negative if the end is earlier; None unless the header has the time of day of both.
    """
    if start is None or "T" not in start.value or "AVG" in start.source:
        return "", None
    when, cards = datetime.fromisoformat(start.value), cards.aside
    for key, times in (("DATE-END", 1), ("MJD-END", 1), ("DATE-AVG", 2), ("MJD-AVG", 2)):
        said = _stated(cards, key)
        end = None if said is None or "T" not in said.value else datetime.fromisoformat(said.value)
        if end is not None and (times == 1 or end > when):
            return key, times * (end - when).total_seconds()
    for key in _END_KEYS:
        end = _parse(f"{when.date().isoformat()}T{cards.text(key)}")
        if isinstance(end, datetime):
            return key, ((end - when) % _DAY).total_seconds()
    end = _parse(cards.text("DATE"))
    if isinstance(end, datetime) and end - when > _HEADER_FIRST:  # a copy may have kept an older one
        return "DATE", (end - when).total_seconds()
    return "", None


def _contradicts(cards: Cards, apart: timedelta) -> bool:
    """Return whether two times differ by more than the exposure, and by as much as those of two zones."""
    if apart < _CONTRADICTION:
        return False
    exposure = next(cards.aside.believed("exposure"), None)
    return apart.total_seconds() > (0.0 if exposure is None else exposure.value)


def _stated(cards: Cards, key: str) -> Sourced | None:
    """Return the time of a keyword in UTC, with warnings of what is odd about it; None if it is none."""
    card = cards.find(key)
    if card is None:
        return None
    value, comment, source = card
    if key.startswith("DATE"):
        text, precision = str(value).strip(), "auto"
        when = _parse(text)
        if when is None:
            cards.warn(f"{key} = {text!r} is not a date and is ignored")
            return None
        if not isinstance(when, datetime):
            when, source = _with_time(cards, when, source)
        elif when == datetime(when.year, when.month, when.day):  # midnight may stand for no time of day
            when, source = _with_time(cards, when.date(), source)
            when = when if isinstance(when, datetime) else datetime(when.year, when.month, when.day)
        if when.year < _FIRST_DETECTOR:
            cards.warn(f"{key} = {text!r} is read as a date of {when.year}")
    else:
        number, precision = cards.number(key), "milliseconds"
        if number is None:
            return None
        days = number.value - _JULIAN if key == "JD" else number.value
        if not _FIRST_MJD < days < 200000:
            cards.warn(f"{number.said} is not a date and is ignored")
            return None
        when = MJD_EPOCH + timedelta(days=days)
        if isinstance(value, int) and key != "JD":  # a day that is counted, without its time
            when, source = _with_time(cards, when.date(), source)
    if _LOCAL.search(comment) and not _IN_UTC.search(comment):
        cards.warn(f"{key} is local time by its comment {comment!r}; it is left as written")
    if (late := _LATE.search(comment)) and not _BEGIN.search(comment) and not key.endswith("AVG"):
        cards.warn(f"{key} is not the beginning by its comment ({late[0]!r}); it is taken for it")
    # to UTC by the header's time scale; a date alone is left as written
    offset = cards.number("TIMEOFFS")
    if offset is not None and offset.value:
        cards.warn(f"{offset.said} is not added to the time")
    system = cards.text("TIMESYS").upper().partition("(")[0].strip()
    if _ZONE.search(str(value)):  # of TESS, whose TIMESYS is that of its other times
        system = "UTC"
    named = None if system or _UTC_NAME.search(comment) else _SCALE_NAME.search(comment)
    system = named[0] if named else system
    clock = _universal(cards, key, when) if system in _SCALES and isinstance(when, datetime) else ""
    if clock:
        cards.warn(f"TIMESYS = {system!r}, and {clock} says that {key} is in UTC: it is not converted")
    elif system in _SCALES and isinstance(when, datetime):
        from astropy.time import Time  # 0.2 s, and few headers need it

        when = Time(when, scale=_SCALES[system]).utc.to_datetime(leap_second_strict="silent")
        source = f"{source} less {system} - UTC"
    elif system not in ("", "UTC", "UT", "GMT"):
        cards.warn(f"TIMESYS = {system!r} is not UTC; the time is left as written")
    text = when.isoformat(timespec=precision) if isinstance(when, datetime) else when.isoformat()
    return Sourced(text, "UTC", source)


def _universal(cards: Cards, key: str, when: datetime) -> str:
    """Return what says that a time is UTC already: its own comment, or a clock of UTC that agrees."""
    if _UTC_NAME.search((cards.find(key) or ("", ""))[1]):
        return "its comment"
    for other in TIME_KEYS:
        text, comment, _ = cards.find(other) or ("", "", "")
        at = _parse(f"{when.date().isoformat()}T{text}")
        universal = other.startswith("UT") or _UTC_NAME.search(comment)
        if universal and isinstance(at, datetime) and abs(at - when) < _CLOCKS:
            return other
    return ""


def _parse(text: str) -> Any:
    """Read a date or time of day on it; None of what is neither.

    A 60th second, which UTC has now and then, is that of the minute after, as in the time of computers.
    """
    for pattern, iso in _OTHERS.items():
        text = re.sub(pattern, iso, text)
    match = _DATE.fullmatch(text)
    if match is None:
        return None
    year, month, day = (int(part) for part in re.split(r"[-/.]", match["date"]))
    try:
        if match["hours"] is None:
            return datetime(year, month, day).date()
        hours, minutes = int(match["hours"]), int(match["minutes"])
        seconds = float((match["seconds"] or "0").replace(",", "."))
        if hours > 23 or minutes > 59 or seconds >= 61:
            return None
        when = datetime(year, month, day, hours, minutes) + timedelta(seconds=seconds)
        if match["sign"]:
            ahead = timedelta(hours=int(match["east"]), minutes=int(match["more"]))
            when -= ahead if match["sign"] == "+" else -ahead
        return when
    except (ValueError, OverflowError):  # the latter of the last hour of the year 9999, west of Greenwich
        return None


def _with_time(cards: Cards, day: Any, source: str) -> tuple[Any, str]:
    """Add the time of day where a keyword of its own has it; otherwise the date stands alone."""
    for key in TIME_KEYS:
        text = cards.text(key)
        whole = _parse(f"{day.isoformat()}T{text.removeprefix(f'{day.isoformat()}T')}") if text else None
        if whole is not None:
            return whole, source.replace(" (HDU", f" and {key} (HDU")
        if text:
            cards.warn(f"{key} = {text!r} is not a time of day and is ignored")
    return day, source


def epoch_seconds(text: str) -> float:
    """Return the seconds since 1970 of an ISO 8601 time, UTC unless it names a zone; NaN if it is none."""
    try:
        when = datetime.fromisoformat(text)
        return (when if when.tzinfo else when.replace(tzinfo=UTC)).timestamp()
    except (ValueError, OverflowError):
        return math.nan
