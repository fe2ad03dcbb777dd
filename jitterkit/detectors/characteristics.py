"""What is known about a detector: a frozen record of numbers and maps, with their sources.

Reach for :class:`jitterkit.detectors.Detector`, which is this record with something to do; the steps of
reading out and of calibrating know only the record.  Impossible values are refused, each in one sentence.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from jitterkit.detectors.response import BORDER, LIMIT, turning_point
from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.frames.metadata import QUANTITIES, Quantity
from jitterkit.frames.window import Window

FULL_WELL = Quantity("e-", 0.0, 1e9, zero_allowed=False)
BITS = range(1, 33)

_FARTHEST = 0.1 * (1 + 1e-6)
"""Pixels, rounded to 32 bits.  The second order of :func:`jitterkit.forward.displacement_effect` leaves out a
sixtieth of the change there, at the Nyquist frequency."""

NUMBERS: Mapping[str, Quantity] = {
    **{name: QUANTITIES[name] for name in ("gain", "read_noise", "bias", "saturation")},
    "full_well": FULL_WELL,
    "dark_current": Quantity("e-/s", 0.0, 1e9),
    "flat": Quantity("shares of the mean response", 0.0, 1e9),
    "coupling": Quantity("of a pixel's charge", 0.0, LIMIT * (1 - 1e-6)),
    "brighter_fatter": Quantity("pixel per electron", 0.0, 1e-3),
    "diffusion": Quantity("pixel", 0.0, 10.0),
    "pixel_shift_x": Quantity("pixel", -_FARTHEST, _FARTHEST),
    "pixel_shift_y": Quantity("pixel", -_FARTHEST, _FARTHEST),
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
    if (values["brighter_fatter"] or 0.0) * (values["full_well"] or 0.0) >= BORDER:
        raise ConfigurationError(
            ErrorCode.OUT_OF_RANGE,
            f"brighter_fatter = {values['brighter_fatter']:g} moves the border of a pixel that holds "
            f"{values['full_well']:g} e-, a full well, by {BORDER:g} pixel or more; give a smaller one.",
        )


def _check_shapes(values: Mapping[str, Any]) -> None:
    shapes = {name: np.shape(values[name]) for name in MAPS if values[name] is not None}
    for name, shape in shapes.items():
        if name == "bad_pixels" and len(shape) != 2:
            problem = f"bad_pixels has shape {shape}; give a map (ny, nx), True where a pixel is bad."
            raise ConfigurationError(ErrorCode.WRONG_SHAPE, problem)
        if len(shape) not in (0, 2) or (name in ONLY_MAPS and not shape):
            also = "" if name in ONLY_MAPS else "one number or "
            problem = f"{name} has shape {shape}; give {also}a map (ny, nx)."
            raise ConfigurationError(ErrorCode.WRONG_SHAPE, problem)
    maps = {name: shape for name, shape in shapes.items() if shape}
    for name, shape in maps.items():
        first = next(iter(maps))
        if shape != maps[first]:
            found = f"{first} is a map of {_size(maps[first])} pixels and {name} one of {_size(shape)}"
            raise ConfigurationError(ErrorCode.WRONG_SHAPE, f"{found}; give maps of one whole detector.")


def _size(shape: tuple[int, ...]) -> str:
    return f"{shape[1]} x {shape[0]}"


def _check_number(name: str, value: Any, quantity: Quantity) -> None:
    if value is None:
        return
    extremes = [value]
    if np.ndim(value):
        finite = np.asarray(value)[np.isfinite(value)]
        if finite.size == 0:
            message = f"{name} is a map of {_size(np.shape(value))} pixels without a finite number"
            raise ConfigurationError(ErrorCode.OUT_OF_RANGE, f"{message}; give another.")
        extremes = [float(finite.min()), float(finite.max())]
    for extreme in extremes:
        if (problem := quantity.problem(extreme)) is not None:
            said = f"{name} has a pixel of {extreme!r}, which" if np.ndim(value) else f"{name} = {value!r}"
            raise ConfigurationError(ErrorCode.OUT_OF_RANGE, f"{said} {problem}; give it in {quantity.unit}.")


def _check_bits(bits: Any, bias: Any) -> None:
    if bits is None:
        return
    if isinstance(bits, bool) or int(bits) != bits or int(bits) not in BITS:
        problem = f"bits = {bits!r} is impossible; a converter has {BITS[0]} to {BITS[-1]}."
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, problem)
    for level in () if bias is None else (np.nanmin(bias), np.nanmax(bias)):
        if not 0 <= level < 2**bits:
            problem = f"bias = {level:g} ADU lies outside the {bits}-bit range 0 to {2**bits - 1}"
            raise ConfigurationError(ErrorCode.CONFLICT, f"{problem}; correct one.")


def _check_flat(flat: Any) -> None:
    if flat is None:
        return
    good = np.asarray(flat)[np.isfinite(flat) & (np.asarray(flat) > 0)]
    mean = float(np.mean(good, dtype=float)) if good.size else 0.0
    if abs(mean - 1) > _EVEN:
        problem = f"flat has a mean of {mean:g} over its good pixels; divide it by that, so that fluxes stay."
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, problem)


def _check_nonlinearity(coefficients: Any, full_well: float | None) -> None:
    if coefficients is None:
        return
    is_list = np.ndim(coefficients) == 1 and np.size(coefficients) > 0
    if not is_list or not np.isfinite(coefficients).all():
        problem = f"nonlinearity = {coefficients!r}; give a list of numbers, c1 in 1/e- first."
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE if is_list else ErrorCode.WRONG_SHAPE, problem)
    if full_well is None:
        problem = "nonlinearity needs the full_well up to which it holds; give it, in e-."
        raise ConfigurationError(ErrorCode.MISSING_VALUE, problem)
    turn = turning_point(coefficients)
    if turn <= full_well:
        well = f"below the full_well of {full_well:g} e-"
        problem = f"nonlinearity = {list(coefficients)} stops rising at {turn:g} e-, {well}"
        raise ConfigurationError(ErrorCode.CONFLICT, f"{problem}; give a law that rises up to it.")


@dataclass(frozen=True, eq=False)
class Characteristics:
    """The numbers that describe a detector; None where one is not known.

    A map is an array ``(ny, nx)`` over the whole detector; a pixel without a finite number counts as bad.
    Maps of 32 bits stay, others become float64.

    Parameters
    ----------
    gain : float, optional
        e-/ADU.
    read_noise : float or map, optional
        Standard deviation of the read-out, e-, without that of rounding.
    bias : float or map, optional
        Reading of an unexposed pixel, ADU.
    full_well : float, optional
        Electrons a pixel holds.
    saturation : float, optional
        Level at and above which a pixel is not to be trusted, ADU.
    bits : int, optional
        Of the converter, which reads 0 to ``2**bits - 1``.
    bad_pixels : (ny, nx) bool array, optional
        True where a pixel is unusable, on the whole detector.
    sources : mapping, optional
        Where each number comes from, by its name; begin with a word of
        :data:`jitterkit.frames.metadata.PRECEDENCE`.
    dark_current : float or map, optional
        e-/s; a hot pixel has more.
    flat : map, optional
        Response relative to the mean of the good pixels; zero where a pixel is dead.
    nonlinearity : sequence of float, optional
        ``c1, c2, ...``: a charge of ``q`` e- is measured as ``q (1 + c1 q + c2 q² + ...)``, up to the full
        well; see :mod:`jitterkit.detectors.response`.
    coupling : float, optional
        Share of a pixel's charge with which each of its four neighbours is read; see
        :mod:`jitterkit.detectors.response`.
    brighter_fatter : float, optional
        Pixels by which the border of two pixels moves per electron that one of them holds more; see
        :mod:`jitterkit.detectors.response`.
    pixel_shift_x, pixel_shift_y : map, optional
        Where the light of a pixel is collected, from where an even grid has the pixel, in pixels along x
        (columns) and y (rows).
    diffusion : float, optional
        One sigma of the charge's diffusion before it is collected, pixels; the forward model blurs by it.
    line_time : float, optional
        From the start of one row's exposure to that of the next row *of the file*, s; zero where all rows
        are exposed at once.
    cosmic_rays : float, optional
        Hits per pixel and second, for simulations.
    bad_bits : int, optional
        Sum of the bits of a quality plane (DQ, MASK) that mark a pixel as unusable, in place of the
        convention of the file's observatory.
    map_orders : tuple of int
        What became of the rows of maps whose files do not say their order: kept (1), turned over (-1).
    map_windows : mapping
        What the files of maps say of the part of the detector that they are, by the name of the map.

    Raises
    ------
    ConfigurationError
        If a value is impossible; the message says what is possible.
    """

    gain: float | None = None
    read_noise: float | np.ndarray | None = None
    bias: float | np.ndarray | None = None
    full_well: float | None = None
    saturation: float | None = None
    bits: int | None = None
    bad_pixels: np.ndarray | None = None
    sources: Mapping[str, str] = field(default_factory=dict)
    dark_current: float | np.ndarray | None = None
    flat: np.ndarray | None = None
    nonlinearity: tuple[float, ...] | None = None
    coupling: float | None = None
    brighter_fatter: float | None = None
    pixel_shift_x: np.ndarray | None = None
    pixel_shift_y: np.ndarray | None = None
    diffusion: float | None = None
    line_time: float | None = None
    cosmic_rays: float | None = None
    bad_bits: int | None = None
    map_orders: tuple[int, ...] = ()
    map_windows: Mapping[str, Window] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_detector(vars(self))
        bad = None if self.bad_pixels is None else np.asarray(self.bad_pixels, dtype=bool)
        for name in (name for name in FLOATS if np.ndim(getattr(self, name))):
            values = np.asarray(getattr(self, name))
            values = values if values.dtype == np.float32 else values.astype(float)
            object.__setattr__(self, name, values)
            if (missing := ~np.isfinite(values)).any():  # such a pixel is bad, its number a harmless one
                bad, median = missing if bad is None else bad | missing, self.nominal(name)
                object.__setattr__(self, name, np.where(missing, median, values))  # type: ignore[arg-type]
        object.__setattr__(self, "bad_pixels", bad)
        if self.nonlinearity is not None:
            object.__setattr__(self, "nonlinearity", tuple(float(c) for c in self.nonlinearity))

    def source(self, name: str) -> str:
        """Return where a number comes from; ``"argument Detector"`` where nothing else was said."""
        return self.sources.get(name, "argument Detector")

    def nominal(self, name: str) -> float | None:
        """Return a number, or the median of a map where it is finite, by its name; None if it is unknown."""
        # kept once found: of 20 million pixels a median takes longer than a frame
        values, known = getattr(self, name), vars(self).setdefault("_nominals", {})
        if values is not None and name not in known:
            known[name] = float(np.median(np.asarray(values)[np.isfinite(values)]))
        return known.get(name)

    @property
    def map_shape(self) -> tuple[int, ...] | None:
        """Return the shape ``(ny, nx)`` that all maps have; None where there is none."""
        return next((np.shape(values) for name in MAPS if np.ndim(values := getattr(self, name))), None)

    @property
    def largest(self) -> float:
        """Return what the converter reads at most, ADU; infinite where the bits are not known."""
        return math.inf if self.bits is None else 2.0**self.bits - 1


FLOATS = ("bias", "read_noise", "dark_current", "flat", "pixel_shift_x", "pixel_shift_y")
"""What of a detector may be a map of numbers."""

MAPS = (*FLOATS, "bad_pixels")
"""What of a detector may be a map."""

ONLY_MAPS = ("flat", "pixel_shift_x", "pixel_shift_y")
"""Of these, what must not be one number."""
