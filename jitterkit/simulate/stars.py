"""A table of stars as a scene."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from astropy.table import QTable
from astropy.units import Quantity, UnitConversionError

from jitterkit.errors import ErrorCode, FrameError
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
    try:
        table = QTable.read(path, format="ascii.ecsv" if str(path).endswith(".ecsv") else "ascii.csv")
    except FileNotFoundError:
        raise FrameError(ErrorCode.NOT_FOUND, path, "does not exist", "check the path") from None
    except Exception as error:
        said = f"cannot be read as a table of stars ({error})"
        raise FrameError(
            ErrorCode.MALFORMED, path, said, "give ECSV or CSV with the columns x, y, flux"
        ) from None
    missing = [name for name in _UNITS if name not in table.colnames]
    if missing:
        problem = f"has no column {missing[0]!r}"
        raise FrameError(ErrorCode.MISSING_VALUE, path, problem, "give the columns x, y, flux")
    try:
        x, y, flux = (
            np.asarray(Quantity(table[name], unit, dtype=float).value) for name, unit in _UNITS.items()
        )
    except (ValueError, TypeError, UnitConversionError) as error:
        remedy = "give numbers in arcsec and electrons"
        raise FrameError(
            ErrorCode.MALFORMED, path, f"holds what is no number there ({error})", remedy
        ) from None
    if not len(x) or not np.all(np.isfinite([x, y, flux])) or np.any(flux <= 0):
        problem = "holds no star" if not len(x) else "holds a star without a place, or without light"
        raise FrameError(ErrorCode.OUT_OF_RANGE, path, problem, "give finite places and positive fluxes")
    return Stars.of(x, y, flux)
