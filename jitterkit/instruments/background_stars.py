"""Stars of a catalogue around the target, too faint to be found in a frame.

A star of a ten-thousandth of the light biases a separation by microarcseconds.  Where such stars are known,
so is their light: :mod:`jitterkit.known_light` takes it out of a frame.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from astropy.table import QTable
from astropy.units import Quantity, UnitConversionError

from jitterkit.errors import ErrorCode, FrameError

_COLUMNS = {"separation": "arcsec", "position_angle": "deg", "delta_mag": "mag"}
_IN_FRAME = {"separation": "arcsec", "angle_from_b": "deg", "delta_mag": "mag"}


@dataclass(frozen=True, eq=False)
class BackgroundStars:
    """Stars by their positions relative to A, the brightest star of the target.

    Attributes
    ----------
    separation : (n,) array
        From A, arcsec.
    position_angle : (n,) array
        At A, from north through east, degrees.
    delta_mag : (n,) array
        Magnitudes by which each is fainter than A, in the instrument's band.
    pair_angle : float or None
        Position angle of B at A, degrees: it says how a frame of the pair is turned, where no WCS does.
    mirrored : bool
        Whether east is clockwise from north in such a frame.
    in_frame : bool
        Whether ``position_angle`` is no angle on the sky, but counter-clockwise in the frame from the
        direction of B; then nothing else has to say how the frame is turned.
    """

    separation: np.ndarray
    position_angle: np.ndarray
    delta_mag: np.ndarray
    pair_angle: float | None = None
    mirrored: bool = False
    in_frame: bool = False

    def offsets(self, theta: float, position_angle: float, mirrored: bool) -> np.ndarray:
        """Return the offsets (2, n) from A along x and y [arcsec], in the frame's own axes.

        Parameters
        ----------
        theta : float
            A direction in the frame, degrees counter-clockwise from +x.
        position_angle : float
            Of that direction on the sky, degrees.
        mirrored : bool
            Whether position angles grow clockwise in the frame.
        """
        turn = np.radians(self.position_angle - position_angle) * (-1 if mirrored else 1)
        angle = np.radians(theta) + turn
        return self.separation * np.array([np.cos(angle), np.sin(angle)])


def read_background_stars(path: Path, pair_angle: float | None, mirrored: bool) -> BackgroundStars:
    """Read the stars of a catalogue from a table.

    Parameters
    ----------
    path : Path
        ECSV or CSV with the columns ``separation`` (arcsec), ``position_angle`` (deg) and ``delta_mag``; or
        with ``angle_from_b`` (deg), counter-clockwise in the frame, in place of the second.
    pair_angle, mirrored
        As for :class:`BackgroundStars`.

    Raises
    ------
    FrameError
        If the file cannot be read as such a table, or holds what no star can have.
    """
    table = _read(path, _COLUMNS)
    in_frame = "angle_from_b" in table.colnames
    if in_frame and "position_angle" in table.colnames:
        problem = "has both a position_angle and an angle_from_b"
        raise FrameError(ErrorCode.CONFLICT, path, problem, "leave one of the columns out")
    separation, angle, delta_mag = _columns(path, table, _IN_FRAME if in_frame else _COLUMNS)
    if np.any(separation < 0):
        problem = "holds a negative separation"
        raise FrameError(ErrorCode.OUT_OF_RANGE, path, problem, "turn its position angle by 180 deg")
    if in_frame:
        return BackgroundStars(separation, angle, delta_mag, 0.0, in_frame=True)
    return BackgroundStars(separation, angle, delta_mag, pair_angle, mirrored)


def read_star_table(path: str | Path, units: Mapping[str, str]) -> list[np.ndarray]:
    """Read some columns of a table of stars.

    Parameters
    ----------
    path : str or Path
        ECSV or CSV.
    units : mapping
        The columns, and the unit of each unless the table says another.

    Returns
    -------
    columns : list of (n,) array
        Finite, in those units.

    Raises
    ------
    FrameError
        If the file cannot be read as such a table, or holds no star, or one without a number.
    """
    return _columns(path, _read(path, units), units)


def _remedy(units: Mapping[str, str]) -> str:
    return f"give ECSV or CSV with the columns {', '.join(units)}"


def _read(path: str | Path, units: Mapping[str, str]) -> QTable:
    try:
        kind = "ascii.ecsv" if str(path).endswith(".ecsv") else "ascii.csv"
        return QTable.read(path, format=kind, encoding="utf-8-sig")  # spreadsheets begin with a mark
    except FileNotFoundError:
        raise FrameError(ErrorCode.NOT_FOUND, path, "does not exist", "check the path") from None
    except Exception as error:
        problem = f"cannot be read as a table of stars ({error})"
        raise FrameError(ErrorCode.MALFORMED, path, problem, _remedy(units)) from None


def _columns(path: str | Path, table: QTable, units: Mapping[str, str]) -> list[np.ndarray]:
    missing = [name for name in units if name not in table.colnames]
    if missing:
        raise FrameError(ErrorCode.MISSING_VALUE, path, f"has no column {missing[0]!r}", _remedy(units))
    try:
        columns = [_numbers(table[name], unit) for name, unit in units.items()]
    except (ValueError, TypeError, UnitConversionError) as error:
        words = [unit for unit in dict.fromkeys(units.values()) if unit]
        problem = f"holds what is no number there ({error})"
        raise FrameError(ErrorCode.MALFORMED, path, problem, f"give numbers in {', '.join(words)}") from None
    if not len(table) or not np.all(np.isfinite(columns)):
        problem = "holds a star without a number" if len(table) else "holds no star"
        raise FrameError(ErrorCode.OUT_OF_RANGE, path, problem, "give finite numbers for each star")
    return columns


def _numbers(column: Any, unit: str) -> np.ndarray:
    """Return the numbers of a column in a unit, NaN of cells without one, which astropy has as zeros."""
    numbers = Quantity(getattr(column, "unmasked", column), unit, dtype=float)
    return np.where(getattr(column, "mask", False), np.nan, np.asarray(numbers.value))
