"""What no detector can be: one sentence for each impossible value."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from jitterkit.errors import ConfigurationError
from jitterkit.frames.metadata import QUANTITIES, Quantity

__all__ = ["BITS", "FULL_WELL", "check_detector"]

FULL_WELL = Quantity("e-", 0.0, 1e9, zero_allowed=False)
BITS = range(1, 33)


def check_detector(values: Mapping[str, Any]) -> None:
    """Refuse a detector that cannot be, given its fields by name.

    Raises
    ------
    ConfigurationError
        With the name, the value and what is possible.
    """
    for name in ("gain", "read_noise", "bias", "saturation", "full_well"):
        _check_number(name, values[name], FULL_WELL if name == "full_well" else QUANTITIES[name])
    bits, bias, bad_pixels = (values[name] for name in ("bits", "bias", "bad_pixels"))
    if bits is not None and (isinstance(bits, bool) or int(bits) != bits or int(bits) not in BITS):
        raise ConfigurationError(f"bits = {bits!r} is impossible; a converter has {BITS[0]} to {BITS[-1]}.")
    if bad_pixels is not None and np.ndim(bad_pixels) != 2:
        shape = np.shape(bad_pixels)
        raise ConfigurationError(
            f"bad_pixels has shape {shape}; give a map (ny, nx), True where a pixel is bad."
        )
    if bits is not None and bias is not None and not 0 <= bias < 2**bits:
        raise ConfigurationError(
            f"bias = {bias:g} ADU lies outside the {bits}-bit range 0 to {2**bits - 1}; correct one."
        )


def _check_number(name: str, value: float | None, quantity: Quantity) -> None:
    if value is None:
        return
    problem = quantity.problem(value) if math.isfinite(value) else "is not a finite number"
    if problem is not None:
        raise ConfigurationError(f"{name} = {value!r} {problem}; give it in {quantity.unit}.")
