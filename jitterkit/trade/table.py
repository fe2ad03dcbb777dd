"""Measured settings as a table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import Any

import numpy as np
from astropy.table import QTable
from astropy.units import Unit

from jitterkit.instruments import Instrument
from jitterkit.trade.ladder import Point, front
from jitterkit.trade.settings import Settings, own_pad

_NONE = {"pad": -1, "tolerance": 0.0} | dict.fromkeys(("aberrations", "jitter", "method"), "")
"""What stands for none of a setting; of others it is 0, which of nodes means those of the locus itself."""


def trade_table(points: Sequence[Point], instrument: Instrument) -> QTable:
    """Return what settings cost and give, a row each.

    Parameters
    ----------
    points : sequence of Point
    instrument : Instrument
        That they were measured with.

    Returns
    -------
    table : QTable
        Name, ms a frame, bias, added scatter and stated error of the separation [uas], the first two together
        as a share of the least error, whether the row is on the front, what was modelled (nothing is said of
        another package), and why there are no numbers where there are none.
    """
    best = [point.name for point in front(points)]
    table = QTable()
    table["setting"] = [point.name for point in points]
    table["time"] = np.array([point.seconds for point in points]) * 1e3 << Unit("ms")
    for name in ("bias", "scatter", "sigma"):
        table[name] = np.array([getattr(point, name) for point in points]) * 1e6 << Unit("uarcsec")
    table["error"] = [point.error for point in points]
    table["front"] = [point.name in best for point in points]
    used = [_used(point.settings, instrument) for point in points]
    for name in (field.name for field in fields(Settings) if field.name != "without"):
        table[name] = [row.get(name, _NONE.get(name, 0)) for row in used]
    table["message"] = [point.message for point in points]
    for name, how in {"time": ".1f", "bias": ".3g", "scatter": ".3g", "sigma": ".4g", "error": ".2g"}.items():
        table[name].info.format = how
    return table


def _used(settings: Settings | None, instrument: Instrument) -> dict[str, Any]:
    """Settings by name, with what an instrument says itself where they say nothing."""
    if settings is None:
        return {}
    said = {name: value for name, value in vars(settings).items() if value is not None}
    own = 0 if instrument.spectrum is None else len(instrument.spectrum.wavelengths)
    return {"pad": own_pad(instrument), "samples": own, "region": max(instrument.shape)} | said
