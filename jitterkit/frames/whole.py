"""Write a file whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from uuid import uuid4

from jitterkit.errors import ErrorCode, FrameError


@contextmanager
def replacing(path: Path, overwrite: bool) -> Iterator[Path]:
    """Give a temporary name in the same directory, and rename it to ``path`` if the block succeeds.

    The temporary name ends like the final one, so that a library which looks at the ending sees the
    right one.  If the block fails, nothing is left behind and an existing file is untouched.

    Raises
    ------
    FrameError
        If ``path`` exists and ``overwrite`` is False, or the directory cannot be written to.
    """
    if path.exists() and not overwrite:
        remedy = "choose another name or allow it to be overwritten"
        raise FrameError(ErrorCode.EXISTS, path, "exists already", remedy)
    # not the whole name, as a longer one than that may be too long for the file system
    temporary = path.with_name(f".{uuid4().hex[:8]}.{path.name[-20:]}")
    try:
        yield temporary
        with temporary.open("rb") as written:
            os.fsync(written.fileno())  # a name must not survive a power cut that its content does not
        os.replace(temporary, path)
    except OSError as error:
        reason = error.strerror or str(error)
        problem = f"cannot be written ({reason})"
        remedy = "check the directory and its permissions"
        raise FrameError(ErrorCode.NOT_WRITABLE, path, problem, remedy) from error
    finally:
        temporary.unlink(missing_ok=True)
