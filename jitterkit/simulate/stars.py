"""A table of stars as a scene."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from jitterkit.errors import ErrorCode, FrameError
from jitterkit.instruments.background_stars import read_star_table
from jitterkit.scene import Stars

_UNITS = {"x": "arcsec", "y": "arcsec", "flux": "electron"}


def read_stars(path: str | Path) -> Stars:
    """Read the stars of a scene from a table.

    Parameters
    ----------
    path : str or Path
        ECSV or CSV with the columns ``x``, ``y`` (offsets from the frame's centre; arcsec unless the table
        says otherwise) and ``flux`` (electrons per frame).

    Returns
    -------
    stars : Stars

    Raises
    ------
    FrameError
        If the file cannot be read as such a table, or holds what no star can have.
    """
    x, y, flux = read_star_table(path, _UNITS)
    if np.any(flux <= 0):
        problem = "holds a star without light"
        raise FrameError(ErrorCode.OUT_OF_RANGE, path, problem, "give positive fluxes")
    return Stars.of(x, y, flux)
