"""Keep compiled programs from one run of the tests to the next.

JAX writes a program into its cache in several steps, so another process may read an incomplete file, and a
killed process may leave one behind.  Therefore each process of a run has its own folder, which starts with
copies of all programs of a common store.  Between test modules :meth:`Store.exchange` copies complete new
programs into the store, each in one step, and fetches those of the other processes.
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
"""Suffix of the files in which JAX stores compiled programs."""


class Store:
    """A folder of complete compiled programs.

    Parameters
    ----------
    folder : Path
        Created if it does not exist.  Its parent holds the stores of all versions and processors.
    limit : int
        Bytes that :meth:`prune` leaves in all of these stores.
    """

    def __init__(self, folder: Path, limit: int) -> None:
        self.folder, self.limit = folder, limit
        folder.mkdir(parents=True, exist_ok=True)
        self._shared: set[str] = set()

    def exchange(self, own: Path) -> None:
        """Publish new complete programs of a process's own folder, and fetch those that it lacks.

        Each program is checked once.  An incomplete one is not published, and is deleted from the store.
        """
        own.mkdir(parents=True, exist_ok=True)
        for path in _programs(own):
            if path.name not in self._shared and (content := _complete(path)) is not None:
                _write(self.folder / path.name, content)
                self._shared.add(path.name)
        for path in _programs(self.folder):
            if path.name in self._shared:
                continue
            if (content := _complete(path)) is None:
                path.unlink(missing_ok=True)
                continue
            _write(own / path.name, content)
            self._shared.add(path.name)

    def prune(self) -> None:
        """Delete the oldest programs until the rest fits into the limit; what is missed is compiled again."""
        ranked = []
        for path in self.folder.parent.glob("*/*"):
            with suppress(OSError):  # another run may prune at the same time
                found = path.stat()
                ranked.append((found.st_mtime, found.st_size, path))
        total = sum(size for _, size, _ in ranked)
        for _, size, path in sorted(ranked):
            if total <= self.limit:
                break
            path.unlink(missing_ok=True)
            total -= size


def use(folder: Path) -> None:
    """Let JAX keep every compiled program in a folder, in this process and in those that it starts.

    XLA's own caches are switched off: the path of their folder would be part of every program's key, so that
    no process with another folder would find the program.
    """
    import jax

    os.environ["JAX_PERSISTENT_CACHE_ENABLE_XLA_CACHES"] = "none"
    jax.config.update("jax_persistent_cache_enable_xla_caches", "none")
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)


def machine() -> str:
    """Return a name of what compiled programs depend on besides their source: versions and processor."""
    versions = [importlib.metadata.version(name) for name in ("jax", "jaxlib")]
    python = f"py{sys.version_info.major}{sys.version_info.minor}"
    digest = hashlib.sha256(_processor().encode()).hexdigest()[:8]
    return "-".join([*versions, python, platform.machine(), digest])


def _processor() -> str:
    """Return the processor's name and instruction sets, on which the programs that XLA compiles depend."""
    wanted = ("model name", "flags", "Features", "CPU implementer", "CPU part")
    with suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
        return "\n".join(sorted({line for line in lines if line.startswith(wanted)}))
    return platform.processor()


def _programs(folder: Path) -> list[Path]:
    return list(folder.glob(f"*{SUFFIX}"))


def _complete(path: Path) -> bytes | None:
    """Return the contents of a program, or None if they cannot be unpacked (their end is a checksum)."""
    try:
        content = path.read_bytes()
        zlib.decompress(content)
    except (OSError, zlib.error):
        return None
    return content


def _write(path: Path, content: bytes) -> None:
    """Write a file in one step, so that no other process reads a part of it."""
    temporary = path.with_name(f"{path.name}.{os.getpid()}.part")
    with suppress(OSError):  # without a copy the program is compiled again
        temporary.write_bytes(content)
        os.replace(temporary, path)
