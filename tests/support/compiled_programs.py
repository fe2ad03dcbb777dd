"""Compiled programs that survive from one run of the tests to the next.

JAX writes a program into its cache in several strokes, so a reader beside it may see half of one, and a
killed process may leave half of one behind.  Therefore each process of a run has a folder of its own.  It
starts with links to all programs of a common store.  Between test modules :meth:`Store.exchange` links
complete new programs into the store, which is atomic, and fetches those of the other processes.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import os
import platform
import sys
import zlib
from contextlib import suppress
from pathlib import Path

SUFFIX = "-cache"
"""End of the names that JAX gives to programs."""


class Store:
    """A folder of complete compiled programs.

    Parameters
    ----------
    folder : Path
        Made if it does not exist.
    limit : int
        Bytes that :meth:`prune` leaves.
    """

    def __init__(self, folder: Path, limit: int) -> None:
        self.folder, self.limit = folder, limit
        folder.mkdir(parents=True, exist_ok=True)
        self._known: set[str] = set()

    def exchange(self, own: Path) -> None:
        """Publish the complete new programs of a process's own folder, and fetch those that it lacks."""
        own.mkdir(parents=True, exist_ok=True)
        for path in _programs(own):
            if path.name not in self._known and _is_complete(path):
                _link(path, self.folder / path.name)
        for path in _programs(self.folder):
            _link(path, own / path.name)
        self._known = {path.name for path in _programs(own)}

    def prune(self) -> None:
        """Delete the oldest programs until the rest fits into the limit."""
        ranked = []
        for path in _programs(self.folder):
            with suppress(OSError):  # another run may prune at the same time
                found = path.stat()
                ranked.append((found.st_mtime, found.st_size, path))
        total = sum(size for _, size, _ in ranked)
        for _, size, path in sorted(ranked):
            if total <= self.limit:
                break
            path.unlink(missing_ok=True)
            total -= size


def machine() -> str:
    """Return a name for what compiled programs depend on beside their source: versions and the processor."""
    versions = [importlib.metadata.version(name) for name in ("jax", "jaxlib")]
    python = f"py{sys.version_info.major}{sys.version_info.minor}"
    digest = hashlib.sha256(_processor().encode()).hexdigest()[:8]
    return "-".join([*versions, python, platform.machine(), digest])


def _processor() -> str:
    """Describe the processor: its name and what it can do, which decides what XLA compiles for it."""
    wanted = ("model name", "flags", "Features", "CPU implementer", "CPU part")
    with suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
        return "\n".join(sorted({line for line in lines if line.startswith(wanted)}))
    return platform.processor()


def _programs(folder: Path) -> list[Path]:
    return list(folder.glob(f"*{SUFFIX}"))


def _is_complete(path: Path) -> bool:
    """Return whether a program can be unpacked: its checksum stands at its end."""
    try:
        zlib.decompress(path.read_bytes())
    except (OSError, zlib.error):
        return False
    return True


def _link(source: Path, target: Path) -> None:
    """Link a file unless the target exists; copy it where links are not possible."""
    if target.exists():
        return
    try:
        os.link(source, target)
    except FileExistsError:  # another process was faster
        return
    except OSError:
        temporary = target.with_name(f".{os.getpid()}.{target.name}")
        with suppress(OSError):  # the source may have been pruned
            temporary.write_bytes(source.read_bytes())
            os.replace(temporary, target)
