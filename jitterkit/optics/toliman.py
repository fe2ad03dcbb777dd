"""TOLIMAN's optics: the diffractive pupil of dLuxToliman's default optical system.

dLuxToliman takes seven seconds to build it, so the arrays are kept on disk and the second start is
immediate, with or without that package.
"""

from __future__ import annotations

import importlib.metadata
import logging
import os
import sys
from dataclasses import replace
from pathlib import Path

import jax

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.optics.dlux import pupil_from_dlux
from jitterkit.optics.pupil import Pupil
from jitterkit.optics.pupil_file import read_pupil, write_pupil

_HIGHEST = 22
"""Of Noll's aberrations that a frame shows: 2 nm of those from 11 to 22 bias a separation by up to 355 uas if
they are not fitted, and fitting them costs nothing in its error.  The paper has those up to 10."""

_REFERENCE = "0.5.1"  # the release that jitterkit is tested against, to rounding
_log = logging.getLogger(__name__)


def toliman_pupil(highest: int = _HIGHEST) -> Pupil:
    """Return TOLIMAN's pupil on 256 x 256 samples, with Noll's aberrations from 4 on.

    Parameters
    ----------
    highest : int
        Last of the aberrations, 4 to 22.

    Returns
    -------
    pupil : Pupil
        0.125 m wide, 0.032 m obscured, three struts; steps of half a wavelength at 585 nm.  Equal to
        rounding to ``dLuxToliman.TolimanOpticalSystem(noll_indices=range(4, highest + 1))``.

    Raises
    ------
    ConfigurationError
        If the pupil is not on disk and dLuxToliman is not installed.

    Notes
    -----
    Kept in the directory that the environment variable ``JITTERKIT_CACHE`` names, or in the user's
    cache directory; a damaged file is written again, and a directory that cannot be written to costs
    seven seconds at each start.
    """
    pupil, count = _kept(), highest - 3
    return replace(pupil, basis=pupil.basis[:count], names=pupil.names[:count])


def _kept() -> Pupil:
    """Return the pupil with all of its aberrations, from disk if it is there."""
    path = cache_directory() / f"toliman-pupil-{_version() or _REFERENCE}-noll{_HIGHEST}.npz"
    if path.exists():
        try:
            return read_pupil(path)
        except ConfigurationError as problem:
            _log.info("Building the TOLIMAN pupil again: %s", problem)
    pupil = _build()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_pupil(path, pupil)
    except OSError as problem:
        _log.info("The TOLIMAN pupil cannot be kept for the next start: %s", problem)
    return pupil


def cache_directory() -> Path:
    """Return the directory in which jitterkit caches results."""
    chosen = os.environ.get("JITTERKIT_CACHE")
    if chosen:
        return Path(chosen).expanduser()
    if sys.platform == "win32":
        root = os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local"
    elif sys.platform == "darwin":
        root = Path.home() / "Library" / "Caches"
    else:
        root = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(root) / "jitterkit"


def _version() -> str | None:
    try:
        return importlib.metadata.version("dLuxToliman")
    except importlib.metadata.PackageNotFoundError:
        return None


def _build() -> Pupil:
    try:
        from dLuxToliman import TolimanOpticalSystem
    except ImportError:
        raise ConfigurationError(
            ErrorCode.MISSING_PACKAGE,
            "The TOLIMAN pupil comes from dLuxToliman, which is not installed; "
            'run: pip install "jitterkit[toliman]"',
        ) from None
    with jax.enable_x64(True):  # the same pupil whatever precision the caller works in
        system = TolimanOpticalSystem(noll_indices=list(range(4, _HIGHEST + 1)))
    return pupil_from_dlux(system, [f"noll{j}" for j in range(4, _HIGHEST + 1)])
