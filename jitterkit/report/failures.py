"""Why frames failed, by kind: of thousands of failures a person reads the reasons, not the frames.

Reach for :func:`group_failures`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

from jitterkit.report.row import Row

__all__ = ["FailureKind", "group_failures", "reason"]

_BLANK, _NUMBER = "…", "#"

_NAMES = re.compile(r"\S+\.(?:fits?|fts|tiff?|toml|fz|gz)\b(?:\[\d+\])?", re.IGNORECASE)
"""Files; a path with a space in it is known only where it is the frame's own."""

_QUOTED = re.compile(r"'[^']*'|\"[^\"]*\"")
"""What a header said."""

_NUMBERS = re.compile(r"(?<![\w.…])[-+−]?\d+(?:[.,]\d+)*(?:[eE][-+]?\d+)?(?![\w])(?: × 10[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)?")
"""Numbers that stand alone: the 3 of ``NAXIS3`` and the 2 of ``noll2`` are names."""


@dataclass(frozen=True)
class FailureKind:
    """Frames that failed alike.

    Attributes
    ----------
    status : str
    reason : str
        Their sentence with a # for each number and an ellipsis for each name that is a frame's own.
    count : int
    example : dict
        Row of the first of them.
    """

    status: str
    reason: str
    count: int
    example: Row


def reason(row: Row) -> str:
    """The sentence of a failed frame without what is its own.

    >>> reason({"file": "a.fits", "path": "/n/a.fits", "message": "/n/a.fits: holds 12 bytes of 2880."})
    'holds # bytes of #.'
    """
    text = row["message"]
    for name in (row["path"], row["file"]):
        text = text.replace(name, _BLANK) if name else text
    text = _QUOTED.sub(f"'{_BLANK}'", _NAMES.sub(_BLANK, text))
    text = _NUMBERS.sub(_NUMBER, text)
    return re.sub(rf"^{_BLANK}(?:\[{_NUMBER}\])?: ", "", text)


def group_failures(rows: Iterable[Row]) -> list[FailureKind]:
    """Count failures by status and reason.

    Parameters
    ----------
    rows : iterable of dict
        With ``status``, ``message``, ``path`` and ``file``, of frames that failed.

    Returns
    -------
    kinds : list of FailureKind
        The most frequent first.
    """
    found: dict[tuple[str, str], tuple[int, Row]] = {}
    for row in rows:
        key = (row["status"], reason(row))
        count, example = found.get(key, (0, row))
        found[key] = (count + 1, example)
    kinds = [FailureKind(*key, *held) for key, held in found.items()]
    return sorted(kinds, key=lambda kind: -kind.count)
