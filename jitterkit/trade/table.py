"""Measured settings as a table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import Any

from astropy.table import QTable

from jitterkit.instruments import Instrument
from jitterkit.report.columns import Column, bind
from jitterkit.trade.grid import Point, front
from jitterkit.trade.settings import Settings, own_pad

_NONE = {"pad": -1, "tolerance": 0.0} | dict.fromkeys(("aberrations", "jitter", "method"), "")
"""What stands for none of a setting; of others it is 0, which of nodes means those of the locus itself."""


_OF_SEPARATION = (
    ("bias", "of the separation", ".3g"),
    ("scatter", "added to that of the separation", ".3g"),
    ("sigma", "stated error of the separation", ".4g"),
)


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
    used = [_used(point.settings, instrument) for point in points]
    columns: list[tuple[Column, Any]] = [
        (Column("setting", kind=str), [point.name for point in points]),
        (Column("time", "a frame takes", "ms", format=".1f"), [1e3 * point.seconds for point in points]),
        *(
            (Column(name, words, "uarcsec", format=digits), [1e6 * getattr(p, name) for p in points])
            for name, words, digits in _OF_SEPARATION
        ),
        (Column("error", "bias and scatter together", format=".2g"), [point.error for point in points]),
        (Column("front", "none is faster and better", kind=bool), [point.name in best for point in points]),
        *(
            (Column(name, kind=type(_NONE.get(name, 0))), [row.get(name, _NONE.get(name, 0)) for row in used])
            for name in (field.name for field in fields(Settings) if field.name != "without")
        ),
        (Column("message", kind=str), [point.message for point in points]),
    ]
    return bind(columns)


def _used(settings: Settings | None, instrument: Instrument) -> dict[str, Any]:
    """Settings by name, with what an instrument says itself where they say nothing."""
    if settings is None:
        return {}
    stated = {name: value for name, value in vars(settings).items() if value is not None}
    own = 0 if instrument.spectrum is None else len(instrument.spectrum.wavelengths)
    return {"pad": own_pad(instrument), "samples": own, "region": max(instrument.shape)} | stated
