"""What goes wrong, and who is told.

Two rules hold everywhere in jitterkit:

* A *bad argument* is the caller's mistake: it raises, with one full sentence that names the
  value received and what would have been accepted.
* A *bad frame* is nobody's mistake: it becomes a row with a status, and the frames beside it
  are unharmed.  The reader raises :class:`FrameError` for it; only the batch catches it.

Everything raised on purpose derives from :class:`JitterkitError`, so that ``except JitterkitError``
separates what the user can mend from what we must.
"""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches
from pathlib import Path

__all__ = [
    "ConfigurationError",
    "FrameError",
    "JitterkitError",
    "NoStarError",
    "UndeterminedError",
    "did_you_mean",
]


class JitterkitError(ValueError):
    """Something the user can mend; the message is one sentence and ends with the remedy."""


class ConfigurationError(JitterkitError):
    """An instrument file, a preset or an option that cannot be used as given."""


class FrameError(JitterkitError):
    """A file, or one frame of it, that cannot be used.

    Parameters
    ----------
    path : str or Path
        The file the user named.
    problem : str
        What was found, with the value: ``"has 3 colour channels"``.
    remedy : str
        What to do about it: ``"convert it to one channel"``.
    """

    def __init__(self, path: str | Path, problem: str, remedy: str) -> None:
        name = "".join(c if c.isprintable() else "?" for c in str(path))  # a terminal obeys what is not
        super().__init__(f"{name}: {problem}; {remedy}.")
        self.path = Path(path)
        self.problem = problem
        self.remedy = remedy


class NoStarError(FrameError):
    """A frame in which nothing rises above the noise."""


class UndeterminedError(JitterkitError):
    """An image that does not hold the answer: the sentence says what is missing from it.

    An estimator that refuses is better than one that guesses; what it refuses is a row like any other.
    """


def did_you_mean(name: str, allowed: Iterable[str]) -> str:
    """The beginning of a remedy: the nearest of the allowed names, or nothing.

    >>> did_you_mean("tolimann", ["toliman", "smallsat"])
    "did you mean 'toliman'? "
    """
    close = get_close_matches(name, list(allowed), 1, 0.5)
    return f"did you mean {close[0]!r}? " if close else ""
