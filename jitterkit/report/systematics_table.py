"""The table of what a model leaves out."""

from __future__ import annotations

from collections.abc import Sequence

from astropy.table import QTable

from jitterkit.forecast import SystematicError
from jitterkit.report.columns import Column, bind_rows

_COLUMNS = (
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


def systematics_table(errors: Sequence[SystematicError], night: int) -> QTable:
    """Return a table with a row for each effect.

    Parameters
    ----------
    errors : sequence of SystematicError
    night : int
        Frames of a night, for ``shown_by``.
    """
    rows = (_cells(one, night) for one in errors)
    return bind_rows(_COLUMNS, rows)


def _cells(one: SystematicError, night: int) -> list[str | float]:
    shown: list[str | float] = [one.sigmas, one.frames, one.shown_by(night), one.needed]
    return [one.name, one.size, one.unit, one.fitted, 1e6 * one.bias, one.cost, *shown]
