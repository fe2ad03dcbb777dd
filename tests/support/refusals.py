"""Expect an error by its code and the values it names, not by its prose."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from jitterkit.errors import ErrorCode, JitterkitError


@contextmanager
def refused(
    code: ErrorCode, *values: object, error: type[JitterkitError] = JitterkitError
) -> Iterator[pytest.ExceptionInfo[JitterkitError]]:
    """Expect an error.

    Parameters
    ----------
    code : ErrorCode
        That the error must carry.
    *values : object
        Whose ``str`` must stand in the message: the file, the field, the number.
    error : type, optional
        Class of the error.

    Yields
    ------
    caught : pytest.ExceptionInfo
        Its ``value`` is the error, once the block has ended.
    """
    with pytest.raises(error) as caught:
        yield caught
    assert caught.value.code is code, f"{caught.value.code!r} with {caught.value}"
    for value in values:
        assert str(value) in str(caught.value)
