"""Unit and uncertainty of an ``astropy.nddata`` object, as its attributes say them."""

from __future__ import annotations

from typing import Any

import numpy as np

from jitterkit.errors import ErrorCode, JitterkitError
from jitterkit.frames.metadata import Known
from jitterkit.frames.units import resolve_unit

__all__ = ["unit_of", "usable", "variance_of"]


def unit_of(data: Any, said: Known | None) -> Known:
    """Return the unit of the pixels.

    Parameters
    ----------
    data : NDData
    said : Known or None
        What its header says, used where the object has no unit.

    Raises
    ------
    JitterkitError
        If it is none that a detector converts.
    """
    own = getattr(data, "unit", None)
    source = "argument CCDData.unit" if own is not None or said is None else said.source
    text = str(own if own is not None else "" if said is None else said.value)
    unit = resolve_unit(text)
    if unit is None:
        problem = f"the unit {text!r} ({source}) is neither ADU nor electrons, nor a rate of them"
        raise JitterkitError(ErrorCode.UNKNOWN_UNIT, f"{problem}; convert the data.")
    return Known(unit, "", source)


def variance_of(data: Any) -> tuple[np.ndarray | None, str]:
    """Return the variance that an uncertainty stands for, and a warning where it is not used.

    Raises
    ------
    JitterkitError
        If its unit is not that of the data.
    """
    uncertainty = getattr(data, "uncertainty", None)
    values = getattr(uncertainty, "array", None)
    if values is None:
        return None, ""
    kind = getattr(uncertainty, "uncertainty_type", "unknown")
    powers = {"std": 2.0, "var": 1.0, "ivar": -1.0}
    if kind not in powers:
        return None, f"the uncertainty is of type {kind!r} and is not used: say what it is"
    own, unit = getattr(uncertainty, "unit", None), getattr(data, "unit", None)
    expected = None if unit is None else unit ** (2 / powers[kind])
    if own is not None and own != expected:
        problem = f"the uncertainty is in {own} and the data in {unit}"
        raise JitterkitError(ErrorCode.UNKNOWN_UNIT, f"{problem}; convert one of them.")
    with np.errstate(divide="ignore", invalid="ignore"):
        return usable(np.asarray(values, dtype=np.float64) ** powers[kind], "the uncertainty")


def usable(variance: np.ndarray, name: str) -> tuple[np.ndarray | None, str]:
    """Return a variance and an empty text, or None and a warning where no pixel has one."""
    if (np.isfinite(variance) & (variance > 0)).any():
        return variance, ""
    return None, f"{name} has no positive value and is not used"
