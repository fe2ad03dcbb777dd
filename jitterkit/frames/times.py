"""The time of an exposure, from the many ways headers write it.

:func:`resolve_time` returns ISO 8601 in UTC.  The start of the exposure is preferred: DATE-OBS
(with TIME-OBS or UT where the date stands alone), then MJD-OBS, then DATE-AVG, the middle.
"""

from __future__ import annotations

import re
from datetime import UTC, datetime, timedelta

from jitterkit.frames.cards import Cards
from jitterkit.frames.metadata import Known

__all__ = ["resolve_time"]

TIME_KEYS = ("TIME-OBS", "UTC-OBS", "UT", "UTSTART")
MJD_EPOCH = datetime(1858, 11, 17)
OLD_DATE = re.compile(r"(\d\d)/(\d\d)/(\d\d)$")


def resolve_time(cards: Cards) -> Known | None:
    """Find when the exposure was taken.

    Parameters
    ----------
    cards : Cards
        The headers; a malformed date adds a warning to them.

    Returns
    -------
    time : Known or None
        Text such as ``"2016-09-09T08:12:26"``, unit ``"UTC"``.
    """
    system = cards.text("TIMESYS").upper()
    if system not in ("", "UTC", "UT"):
        cards.warnings.append(f"TIMESYS = {system!r} is not UTC; the time is left as written")
    return _date(cards, "DATE-OBS") or _mjd(cards) or _date(cards, "DATE-AVG")


def _date(cards: Cards, key: str) -> Known | None:
    card = cards.find(key)
    if card is None:
        return None
    text = str(card[0]).strip()
    source = card[2]
    when = _parse(text)
    if when is None:
        cards.warnings.append(f"{key} = {text!r} is not a date and is ignored")
        return None
    if "T" in text or " " in text:
        return Known(when.isoformat(), "UTC", source)
    return _with_time(cards, when, source)


def _parse(text: str) -> datetime | None:
    """Read ISO 8601 or the ``dd/mm/yy`` of the years 1900 to 1999."""
    old = OLD_DATE.match(text)
    if old is not None:
        text = f"19{old[3]}-{old[2]}-{old[1]}"
    try:
        when = datetime.fromisoformat(text)
        return when if when.tzinfo is None else when.astimezone(UTC).replace(tzinfo=None)
    except (ValueError, OverflowError):  # the latter of the last hour of the year 9999, west of Greenwich
        return None


def _with_time(cards: Cards, day: datetime, source: str) -> Known:
    """Add the time of day where a keyword of its own has it; otherwise the date stands alone."""
    for key in TIME_KEYS:
        text = cards.text(key)
        whole = _parse(f"{day.date().isoformat()}T{text}") if text else None
        if whole is not None:
            return Known(whole.isoformat(), "UTC", source.replace(" (HDU", f" and {key} (HDU"))
        if text:
            cards.warnings.append(f"{key} = {text!r} is not a time of day and is ignored")
    return Known(day.date().isoformat(), "UTC", source)


def _mjd(cards: Cards) -> Known | None:
    card = cards.number("MJD-OBS")
    if card is None:
        return None
    if not 0 < card[0] < 200000:
        cards.warnings.append(f"MJD-OBS = {card[0]:g} is not a date and is ignored")
        return None
    return Known((MJD_EPOCH + timedelta(days=card[0])).isoformat(timespec="milliseconds"), "UTC", card[2])
