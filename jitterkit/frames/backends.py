"""The one place where a format's library is loaded, and only when a file of that format turns up.

astropy.io.fits costs 0.3 s to import and tifffile 0.1 s, so importing :mod:`jitterkit.frames`
loads neither.  To add a format: one module, one line here and one in :func:`jitterkit.frames.files.sniff`.
"""

from __future__ import annotations

from types import ModuleType

__all__ = ["backend"]


def backend(kind: str) -> ModuleType:
    """Return the module that reads and writes ``"FITS"`` or ``"TIFF"``: it has ``open`` and ``write``."""
    if kind == "FITS":
        from jitterkit.frames import fits as module
    else:
        from jitterkit.frames import tiff as module  # type: ignore[no-redef]
    return module
