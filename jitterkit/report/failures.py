"""Count failed frames by kind, because nobody reads thousands of messages.

Reach for :func:`group_failures`.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from jitterkit.errors import ErrorCode
from jitterkit.report.row import Row


@dataclass(frozen=True)
class FailureKind:
    """Frames that failed alike.

    Attributes
    ----------
    status : str
    reason : str
        Value of their :class:`~jitterkit.errors.ErrorCode`; empty in a table of version 0.1.9 or earlier.
    count : int
    example : dict
        Row of the first of them.
    """

    status: str
    reason: str
    count: int
    example: Row

    @property
    def meaning(self) -> str:
        """The reason in words."""
        try:
            return ErrorCode(self.reason).meaning
        except ValueError:  # a table of another version
            return self.reason.replace("_", " ")


def group_failures(rows: Iterable[Row]) -> list[FailureKind]:
    """Count failures by status and reason.

    Parameters
    ----------
    rows : iterable of dict
        Rows of failed frames, with ``status`` and ``reason``.

    Returns
    -------
    kinds : list of FailureKind
        The most frequent first.
    """
    found: dict[tuple[str, str], tuple[int, Row]] = {}
    for row in rows:
        key = (row["status"], row.get("reason", ""))
        count, example = found.get(key, (0, row))
        found[key] = (count + 1, example)
    kinds = [FailureKind(*key, *held) for key, held in found.items()]
    return sorted(kinds, key=lambda kind: -kind.count)
