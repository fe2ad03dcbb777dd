"""Tables of a forecast: of its parameters, of a sweep, of how much jitter may be.

Reach for :func:`parameter_table`, :func:`sweep_table` or :func:`requirement_table`; :func:`observing_time`
is what all of them count time by.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from astropy import units
from astropy.table import QTable

from jitterkit.forecast import Forecast, Requirement, Sweep
from jitterkit.report.columns import unit_of


def observing_time(error: float, target: float, exposure: float) -> float:
    """Hours of exposure after which the mean of frames has a target error."""
    return (error / target) ** 2 * exposure / 3600


def parameter_table(forecast: Forecast) -> QTable:
    """One row a free parameter, then the jitter's size: value, least error, and what that error suffers.

    Returns
    -------
    table : QTable
        ``parameter``, ``value``, ``error``, ``unit``; ``inflation``, times by which not knowing the others
        widens the error; and ``correlation`` of the error with that of the first parameter, the separation.
        NaN for sizes, which are derived.
    """
    rows = [
        (name, value, forecast.error(name), unit_of(name), forecast.inflation(name), correlation)
        for name, value, correlation in zip(
            forecast.names, forecast.values, forecast.correlation[0], strict=True
        )
    ]
    rows += [(name, *size, unit_of(name), math.nan, math.nan) for name, size in forecast.jitter().items()]
    return _short(
        QTable(rows=rows, names=("parameter", "value", "error", "unit", "inflation", "correlation"))
    )


def sweep_table(sweep: Sweep, still, target: float, exposure: float | None) -> QTable:
    """One row a point: its settings, the error of the separation, and what that takes in frames and time.

    Parameters
    ----------
    sweep : Sweep
    still : float or (n, m, ...) array
        Error of the separation without jitter, arcsec, at every point.
    target : float
        Error to reach, arcsec.
    exposure : float or None
        s; without it there is no time.
    """
    table = QTable()
    for name, values in sweep.points().items():
        table[name] = values * units.Unit(unit_of(name))
    error = sweep.error().ravel()
    table["separation_err"] = error * units.arcsec
    table["time_ratio"] = (error / np.broadcast_to(still, sweep.forecasts.shape).ravel()) ** 2
    table["frames"] = np.ceil((error / target) ** 2)
    if exposure is not None:
        table["time"] = (error / target) ** 2 * exposure / 3600 * units.hour
    table["masked"] = [one.masked for one in sweep.forecasts.ravel()]
    table["masked"].info.description = "pixels that saturate"
    table["time_ratio"].info.description = "observing time over that without jitter"
    table["frames"].info.description = f"to {target * 1e6:g} uas"
    table = _short(table)
    table["frames"].info.format = ".0f"
    return table


def requirement_table(requirements: Sequence[Requirement], exposure: float | None) -> QTable:
    """One row a motion and an angle: the largest size, and the frequency of a vibration."""
    table = QTable()
    table["motion"] = [one.motion for one in requirements]
    cycles = np.array([one.cycles for one in requirements])
    table["cycles"] = cycles
    if exposure is not None:
        table["frequency"] = cycles / exposure * units.Hz
    table["angle"] = np.array([one.angle for one in requirements]) * units.deg
    table["size"] = np.array([one.size for one in requirements]) * units.arcsec
    table["rms"] = np.array([one.rms for one in requirements]) * units.arcsec
    table["angle"].info.description = "of the motion from the pair's direction"
    table["size"].info.description = "largest length, peak to peak, FWHM or whole major axis"
    table["rms"].info.description = "one sigma along the major axis within an exposure"
    return _short(table)


def _short(table: QTable) -> QTable:
    """Show six digits, and keep all."""
    for column in table.itercols():
        if column.dtype.kind == "f":
            column.info.format = ".6g"
    return table
