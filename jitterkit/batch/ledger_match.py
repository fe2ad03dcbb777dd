"""Whether a run that is resumed is the run that was begun.

Reach for :func:`refuse_difference`: rows of two configurations in one table would be worse than none.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.report.words import printable

__all__ = ["FILES", "VERSIONS", "refuse_difference"]

FILES = "files"
"""Key of a configuration under which the names of files stand, in order."""

VERSIONS = "versions"
"""Key of a configuration under which the versions of programs stand."""

_LONGEST = 80
"""Characters of a value that are worth reading in a sentence."""

_ABSENT = object()
_NOT_MADE: tuple[Any, ...] = (None, {}, _ABSENT)
"""What stands for a setting that is left alone, or that there was not when a run began."""


def refuse_difference(directory: Path, begun: Any, now: Any) -> None:
    """Compare two configurations and refuse the second if anything in it is different.

    Parameters
    ----------
    directory : Path
        Of the run.
    begun, now : dict
        As JSON gives them back: nested dicts and lists of text, numbers, booleans and None.

    Raises
    ------
    ConfigurationError
        It names the first difference.
    """
    if (difference := _first_difference(begun, now)) is None:
        return
    place, before, after = difference
    inside_files = place[0] == FILES and len(place) > 1
    if inside_files and (sentence := _come_or_gone(printable(directory), begun[FILES], now[FILES])):
        raise ConfigurationError(ErrorCode.CONFLICT, sentence)
    what = f"{printable(directory)} was begun {_said(place, before, after)}"
    if place[0] == VERSIONS:
        raise ConfigurationError(
            ErrorCode.CONFLICT,
            f"{what}, and the last digits need the same versions; install those, or give another directory.",
        )
    raise ConfigurationError(ErrorCode.CONFLICT, f"{what}; give the same, or another directory.")


def _first_difference(a: Any, b: Any, place: tuple = ()) -> tuple[tuple, Any, Any] | None:
    """Where two values first differ, and both values there; None if they do not."""
    if isinstance(a, dict) and isinstance(b, dict):
        return _first_of(dict.fromkeys([*a, *b]), a.get, b.get, place)
    if isinstance(a, list) and isinstance(b, list):
        return _first_of(range(max(len(a), len(b))), dict(enumerate(a)).get, dict(enumerate(b)).get, place)
    same = a == b or (a != a and b != b)  # NaN is NaN
    same = same or all(value in _NOT_MADE for value in (a, b))
    return None if same else (place, a, b)


def _first_of(keys, a, b, place: tuple) -> tuple[tuple, Any, Any] | None:
    pairs = ((key, a(key, _ABSENT), b(key, _ABSENT)) for key in keys)
    found = (_first_difference(x, y, (*place, key)) for key, x, y in pairs)
    return next((difference for difference in found if difference), None)


def _said(place: tuple, before: Any, after: Any) -> str:
    names = [f"[{key}]" if isinstance(key, int) else f".{key}" for key in place]
    name = printable("".join(names).removeprefix("."))
    if before is _ABSENT:
        return f"without {name}, not with {name} {_short(after)}"
    if after is _ABSENT:
        return f"with {name} {_short(before)}, not without"
    return f"with {name} {_short(before)}, not {_short(after)}"


def _come_or_gone(directory: str, begun: list[str], now: list[str]) -> str:
    """What to do about files that are new, or about some that are missing; nothing if both, or neither."""
    new, gone = _without(now, begun), _without(begun, now)
    if new and not gone:
        return (
            f"{directory} was begun without {len(new)} of these files ({_some(new)}); process what is new "
            "into another directory, give --overwrite instead of --resume to begin anew with all, or let "
            "'jitterkit watch' follow a directory that grows."
        )
    if gone and not new:
        return (
            f"{directory} was begun with {len(gone)} file{'s' * (len(gone) > 1)} more than these "
            f"({_some(gone)}); put back what is missing, or give another directory."
        )
    return ""


def _without(names: list[str], others: list[str]) -> list[str]:
    known = set(others)
    return [name for name in names if name not in known]


def _some(names: list[str]) -> str:
    return printable(names[0]) + " for one" * (len(names) > 1)


def _short(value: Any) -> str:
    text = printable(value if isinstance(value, str) and value else json.dumps(value))
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 3]}..."
