"""Measured settings as a table."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from astropy.table import QTable
from astropy.units import Unit

from jitterkit.trade.ladder import Point, front

__all__ = ["trade_table"]

_NONE = {"pad": 0, "samples": 0, "binning": 0, "aberrations": "", "tolerance": 0.0, "region": 0, "bits": 0}
"""Settings, and what stands for none."""


def trade_table(points: Sequence[Point]) -> QTable:
    """What settings cost and give, a row each.

    Parameters
    ----------
    points : sequence of Point

    Returns
    -------
    table : QTable
        Name, ms a frame, bias and error of the separation [uas], error beyond the bound as a share of it,
        whether the row is on the front, the settings (a region of 0 is the whole frame; nothing of
        another package's), and why there are no numbers where there are none.
    """
    best = [point.name for point in front(points)]
    table = QTable()
    table["setting"] = [point.name for point in points]
    table["time"] = np.array([point.seconds for point in points]) * 1e3 << Unit("ms")
    for name in ("bias", "sigma"):
        table[name] = np.array([getattr(point, name) for point in points]) * 1e6 << Unit("uarcsec")
    table["error"] = [point.error for point in points]
    table["front"] = [point.name in best for point in points]
    for name in _NONE:
        table[name] = [getattr(point.settings, name, None) or _NONE[name] for point in points]
    table["message"] = [point.message for point in points]
    for name, how in {"time": ".1f", "bias": ".3g", "sigma": ".4g", "error": ".2g"}.items():
        table[name].info.format = how
    return table
