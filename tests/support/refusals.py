"""Check an expected error by its class, its code and the values in its message, not by its wording."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

import pytest

from jitterkit.errors import ConfigurationError, ErrorCode, JitterkitError


@contextmanager
def refused(
    code: ErrorCode, *values: object, error: type[JitterkitError] = ConfigurationError
) -> Iterator[pytest.ExceptionInfo[JitterkitError]]:
    """Check that a block raises an error with a class, a code and values.

    Parameters
    ----------
    code : ErrorCode
        Code that the error must have.
    *values : object
        Values that the message must name, in this order, such as the file, the field or the number:
        see :func:`assert_names`.
    error : type, optional
        Class that the error must have; a class derived from it does not pass.

    Yields
    ------
    caught : pytest.ExceptionInfo
        After the block, its ``value`` is the error.
    """
    with pytest.raises(JitterkitError) as caught:
        yield caught
    assert type(caught.value) is error, f"{type(caught.value).__name__} with {caught.value}"
    assert caught.value.code is code, f"{caught.value.code!r} with {caught.value}"
    assert_names(str(caught.value), values)


def assert_names(message: str, values: Iterable[object]) -> None:
    """Check that a message names values as words of their own, each after the one before.

    A value within a longer number or name does not count: 1 is not named by 0.1, 10, -1 or x1.
    """
    position = 0
    for value in values:
        found = _word(str(value)).search(message, position)
        assert found, f"{str(value)!r} is not named in {message[position:]!r}, the rest of {message!r}"
        position = found.end()


def _word(text: str) -> re.Pattern[str]:
    """Pattern of a text; where it begins or ends with a letter or digit, none may stand beside it."""
    assert text, "an empty value is in every message"
    before = r"(?<![\w.])" if re.match(r"\w", text) else ""
    if text[0].isdigit():
        before += r"(?<!(?<!\w)[-\u2212])"  # a sign, but not the dash of a range
    after = r"(?!\w)(?!\.\d)" if re.search(r"\w\Z", text) else ""
    return re.compile(before + re.escape(text) + after)
