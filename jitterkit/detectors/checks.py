"""What no detector can be: one sentence for each impossible value."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from jitterkit.detectors.coupling import LIMIT
from jitterkit.detectors.linearity import turning_point
from jitterkit.detectors.maps import MAPS
from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.frames.metadata import QUANTITIES, Quantity

FULL_WELL = Quantity("e-", 0.0, 1e9, zero_allowed=False)
BITS = range(1, 33)

NUMBERS: Mapping[str, Quantity] = {
    **{name: QUANTITIES[name] for name in ("gain", "read_noise", "bias", "saturation")},
    "full_well": FULL_WELL,
    "dark_current": Quantity("e-/s", 0.0, 1e9),
    "flat": Quantity("shares of the mean response", 0.0, 1e9),
    "coupling": Quantity("of a pixel's charge", 0.0, LIMIT * (1 - 1e-6)),
    "diffusion": Quantity("pixel", 0.0, 10.0),
    "line_time": QUANTITIES["line_time"],
    "cosmic_rays": Quantity("hits per pixel and second", 0.0, 1.0),
    "bad_bits": QUANTITIES["bad_bits"],
}
"""The numbers of a detector with the widest range of each."""

_EVEN = 0.01
"""A flat's mean may differ from one by this share: more, and fluxes would mean something else."""


def check_detector(values: Mapping[str, Any]) -> None:
    """Refuse a detector that cannot be, given its fields by name.

    Raises
    ------
    ConfigurationError
        With the name, the value and what is possible.
    """
    _check_shapes(values)
    for name, quantity in NUMBERS.items():
        _check_number(name, values[name], quantity)
    _check_bits(values["bits"], values["bias"])
    _check_flat(values["flat"])
    _check_nonlinearity(values["nonlinearity"], values["full_well"])


def _check_shapes(values: Mapping[str, Any]) -> None:
    shapes = {name: np.shape(values[name]) for name in MAPS if values[name] is not None}
    for name, shape in shapes.items():
        if name == "bad_pixels" and len(shape) != 2:
            raise ConfigurationError(
                ErrorCode.WRONG_SHAPE,
                f"bad_pixels has shape {shape}; give a map (ny, nx), True where a pixel is bad.",
            )
        if len(shape) not in (0, 2) or (name == "flat" and not shape):
            also = "" if name == "flat" else "one number or "
            raise ConfigurationError(
                ErrorCode.WRONG_SHAPE, f"{name} has shape {shape}; give {also}a map (ny, nx)."
            )
    maps = {name: shape for name, shape in shapes.items() if shape}
    for name, shape in maps.items():
        first = next(iter(maps))
        if shape != maps[first]:
            raise ConfigurationError(
                ErrorCode.WRONG_SHAPE,
                f"{first} is a map of {_size(maps[first])} pixels and {name} one of {_size(shape)}; "
                "give maps of one whole detector.",
            )


def _size(shape: tuple[int, ...]) -> str:
    return f"{shape[1]} x {shape[0]}"


def _check_number(name: str, value: Any, quantity: Quantity) -> None:
    if value is None:
        return
    if np.ndim(value) == 0:
        problem = quantity.problem(value)
        if problem is not None:
            raise ConfigurationError(
                ErrorCode.OUT_OF_RANGE, f"{name} = {value!r} {problem}; give it in {quantity.unit}."
            )
        return
    finite = np.asarray(value)[np.isfinite(value)]
    if finite.size == 0:
        raise ConfigurationError(
            ErrorCode.OUT_OF_RANGE,
            f"{name} is a map of {_size(np.shape(value))} pixels without a finite number; give another.",
        )
    for extreme in (float(finite.min()), float(finite.max())):
        problem = quantity.problem(extreme)
        if problem is not None:
            raise ConfigurationError(
                ErrorCode.OUT_OF_RANGE,
                f"{name} has a pixel of {extreme!r}, which {problem}; give it in {quantity.unit}.",
            )


def _check_bits(bits: Any, bias: Any) -> None:
    if bits is None:
        return
    if isinstance(bits, bool) or int(bits) != bits or int(bits) not in BITS:
        raise ConfigurationError(
            ErrorCode.OUT_OF_RANGE, f"bits = {bits!r} is impossible; a converter has {BITS[0]} to {BITS[-1]}."
        )
    for level in () if bias is None else (np.nanmin(bias), np.nanmax(bias)):
        if not 0 <= level < 2**bits:
            raise ConfigurationError(
                ErrorCode.CONFLICT,
                f"bias = {level:g} ADU lies outside the {bits}-bit range 0 to {2**bits - 1}; correct one.",
            )


def _check_flat(flat: Any) -> None:
    if flat is None:
        return
    good = np.asarray(flat)[np.isfinite(flat) & (np.asarray(flat) > 0)]
    mean = float(np.mean(good, dtype=float)) if good.size else 0.0
    if abs(mean - 1) > _EVEN:
        raise ConfigurationError(
            ErrorCode.OUT_OF_RANGE,
            f"flat has a mean of {mean:g} over its good pixels; divide it by that, so that fluxes stay.",
        )


def _check_nonlinearity(coefficients: Any, full_well: float | None) -> None:
    if coefficients is None:
        return
    is_list = np.ndim(coefficients) == 1 and np.size(coefficients) > 0
    if not is_list or not np.isfinite(coefficients).all():
        raise ConfigurationError(
            ErrorCode.OUT_OF_RANGE if is_list else ErrorCode.WRONG_SHAPE,
            f"nonlinearity = {coefficients!r}; give a list of numbers, c1 in 1/e- first.",
        )
    if full_well is None:
        raise ConfigurationError(
            ErrorCode.MISSING_VALUE, "nonlinearity needs the full_well up to which it holds; give it, in e-."
        )
    turn = turning_point(coefficients)
    if turn <= full_well:
        raise ConfigurationError(
            ErrorCode.CONFLICT,
            f"nonlinearity = {list(coefficients)} stops rising at {turn:g} e-, below the full_well of "
            f"{full_well:g} e-; give a law that rises up to it.",
        )
