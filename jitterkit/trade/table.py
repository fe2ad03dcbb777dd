"""Measured settings as a table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import Any

from astropy.table import QTable

from jitterkit.instruments import Instrument
from jitterkit.report.columns import Column, bind
from jitterkit.trade.grid import Point, front
from jitterkit.trade.settings import Settings, own_values

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
    own = own_values(instrument)
    used = [{} if point.settings is None else own | _stated(point.settings) for point in points]
    scatter = Column("scatter", "added to that of the separation", "uarcsec", format=".3g")
    sigma = Column("sigma", "stated error of the separation", "uarcsec", format=".4g")
    columns: list[tuple[Column, Any]] = [
        (Column("setting", kind=str), [point.name for point in points]),
        (Column("time", "a frame takes", "ms", format=".1f"), [1e3 * point.seconds for point in points]),
        (Column("bias", "of the separation", "uarcsec", format=".3g"), [1e6 * one.bias for one in points]),
        (scatter, [1e6 * point.scatter for point in points]),
        (sigma, [1e6 * point.sigma for point in points]),
        (Column("error", "bias and scatter together", format=".2g"), [point.error for point in points]),
        (Column("front", "none is faster and better", kind=bool), [point.name in best for point in points]),
        *(
            (Column(name, kind=type(_NONE.get(name, 0))), [row.get(name, _NONE.get(name, 0)) for row in used])
            for name in (field.name for field in fields(Settings) if field.name != "without")
        ),
        (Column("message", kind=str), [point.message for point in points]),
    ]
    return bind(columns)


def _stated(settings: Settings) -> dict[str, Any]:
    return {name: value for name, value in vars(settings).items() if value is not None}
