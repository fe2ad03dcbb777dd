"""Tables of a forecast: of its parameters, of a sweep, of how much jitter may be, of systematic errors.

Reach for :func:`parameter_table`, :func:`sweep_table` or :func:`requirement_table`, and for
:func:`systematics_table` of what a model leaves out; :func:`observing_time` is what they count time by.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from astropy.table import QTable

from jitterkit.forecast import Forecast, Requirement, Sweep, SystematicError
from jitterkit.report.columns import Column, bind, bind_rows, named, unit_of

_DIGITS = ".6g"
"""Of printed numbers."""

_PARAMETERS = (
    Column("parameter", kind=str),
    Column("value"),
    Column("error", "least error"),
    Column("unit", kind=str),
    Column("inflation", "of the error, by not knowing the other parameters"),
    Column("correlation", "of the error with that of the first parameter"),
)

_REQUIREMENTS = (
    Column("motion", kind=str),
    Column("cycles", "of a vibration in an exposure"),
    Column("frequency", "of a vibration", "Hz"),
    Column("angle", "of the motion from the pair's direction", "deg"),
    Column("size", "largest length, peak to peak, FWHM or whole major axis", "arcsec"),
    Column("rms", "one sigma along the major axis within an exposure", "arcsec"),
)


_EFFECTS = (
    Column("effect", kind=str),
    Column("size", "of one standard deviation, where the effect is random", format=".4g"),
    Column("unit", "of size and needed", kind=str),
    Column("fitted", "whether the fit has parameters for it; the row is of a fit that holds them", kind=bool),
    Column("bias", "of the separation; rms of several or random changes", "uas", format=".4g"),
    Column("cost", "error of the separation with the effect free, over that without", format=".4g"),
    Column("sigmas", "added to the chi-squared of a frame, in its standard deviations", format=".4g"),
    Column("frames", "whose mean chi-squared shows the effect at five standard deviations", format=".4g"),
    Column("shown_by", "frame, night or nothing", kind=str),
    Column("needed", "size at which the bias is the target", format=".4g"),
)


def observing_time(error: float, target: float, exposure: float) -> float:
    """Hours of exposure after which the mean of frames has a target error."""
    return (error / target) ** 2 * exposure / 3600


def parameter_table(forecast: Forecast) -> QTable:
    """Tabulate free parameters, then the jitter's size: value, least error, and its inflation.

    Returns
    -------
    table : QTable
        ``parameter``, ``value``, ``error``, ``unit``; ``inflation``, times by which not knowing the others
        widens the error; and ``correlation`` of the error with that of the first parameter, the separation.
        NaN for sizes, which are derived.
    """
    found = zip(forecast.names, forecast.values, forecast.correlation[0], strict=True)
    rows = [
        (name, value, forecast.error(name), unit_of(name), forecast.inflation(name), correlation)
        for name, value, correlation in found
    ]
    rows += [(name, *size, unit_of(name), math.nan, math.nan) for name, size in forecast.jitter().items()]
    return bind_rows(_PARAMETERS, rows, format=_DIGITS)


def sweep_table(sweep: Sweep, still, target: float, exposure: float | None) -> QTable:
    """Tabulate the points: settings, error of the separation, and the frames and time it takes.

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
    error = sweep.error().ravel()
    frames = (error / target) ** 2
    slower = (error / np.broadcast_to(still, sweep.forecasts.shape).ravel()) ** 2
    columns = [
        *((Column(name, unit=unit_of(name)), values) for name, values in sweep.points().items()),
        *zip(named("separation_err"), [error], strict=True),
        (Column("time_ratio", "observing time over that without jitter"), slower),
        (Column("frames", f"to {target * 1e6:g} uas", format=".0f"), np.ceil(frames)),
    ]
    if exposure is not None:
        columns.append((Column("time", "exposure time of these", "h"), frames * exposure / 3600))
    saturated = Column("masked", "pixels that saturate", kind=int)
    columns.append((saturated, [one.masked for one in sweep.forecasts.ravel()]))
    return bind(columns, format=_DIGITS)


def requirement_table(requirements: Sequence[Requirement], exposure: float | None) -> QTable:
    """Tabulate motions and angles: the largest size, and the frequency of a vibration."""
    rows = [
        [one.motion, one.cycles, one.cycles / (exposure or math.nan), one.angle, one.size, one.rms]
        for one in requirements
    ]
    table = bind_rows(_REQUIREMENTS, rows, format=_DIGITS)
    if exposure is None:
        table.remove_column("frequency")
    return table


def systematics_table(errors: Sequence[SystematicError], night: int) -> QTable:
    """Return a table with a row for each effect.

    Parameters
    ----------
    errors : sequence of SystematicError
    night : int
        Frames of a night, for ``shown_by``.
    """
    rows = []
    for one in errors:
        shown = (one.sigmas, one.frames, one.shown_by(night), one.needed)
        rows.append((one.name, one.size, one.unit, one.fitted, 1e6 * one.bias, one.cost, *shown))
    return bind_rows(_EFFECTS, rows)
