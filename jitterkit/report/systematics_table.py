"""The table of what a model leaves out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from astropy import units
from astropy.table import QTable

from jitterkit.forecast import SystematicError

_COLUMNS = {
    "size": "of one standard deviation, where the effect is random",
    "fitted": "whether the fit has parameters for it; the row is of a fit that holds them",
    "bias": "of the separation; rms of several or random changes",
    "cost": "error of the separation with the effect free, over that without",
    "sigmas": "added to the chi-squared of a frame, in its standard deviations",
    "frames": "whose mean chi-squared shows the effect at five standard deviations",
    "shown_by": "frame, night or nothing",
    "needed": "size at which the bias is the target",
}


def systematics_table(errors: Sequence[SystematicError], night: int) -> QTable:
    """Return a table with a row for each effect.

    Parameters
    ----------
    errors : sequence of SystematicError
    night : int
        Frames of a night, for ``shown_by``.
    """
    table = QTable({"effect": [one.name for one in errors], "unit": [one.unit for one in errors]})
    for name in _COLUMNS:
        values = [one.shown_by(night) if name == "shown_by" else getattr(one, name) for one in errors]
        table[name] = np.array(values) * 1e6 * units.uas if name == "bias" else values
        table[name].info.description = _COLUMNS[name]
        table[name].info.format = ".4g" if table[name].dtype.kind == "f" else None
    return table["effect", "size", "unit", *list(_COLUMNS)[1:]]
