"""What is known about a detector: a frozen record of numbers and maps, with their sources.

Reach for :class:`jitterkit.detectors.Detector`, which is this record with something to do; the steps of
reading out and of calibrating know only the record.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from jitterkit.detectors.checks import check_detector
from jitterkit.detectors.maps import as_map, nominal


@dataclass(frozen=True, eq=False)
class Characteristics:
    """The numbers that describe a detector; None where one is not known.

    A map is an array ``(ny, nx)`` over the whole detector; a pixel without a finite number counts as bad.

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
        :data:`jitterkit.frames.metadata.RANKS`.
    dark_current : float or map, optional
        e-/s; a hot pixel has more.
    flat : map, optional
        Response relative to the mean of the good pixels; zero where a pixel is dead.
    nonlinearity : sequence of float, optional
        ``c1, c2, ...``: a charge of ``q`` e- is measured as ``q (1 + c1 q + c2 q² + ...)``, up to the full
        well; see :mod:`jitterkit.detectors.linearity`.
    coupling : float, optional
        Share of a pixel's charge with which each of its four neighbours is read; see
        :mod:`jitterkit.detectors.coupling`.
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
    diffusion: float | None = None
    line_time: float | None = None
    cosmic_rays: float | None = None
    bad_bits: int | None = None

    def __post_init__(self) -> None:
        check_detector(vars(self))
        for name in ("bias", "read_noise", "dark_current", "flat"):
            object.__setattr__(self, name, as_map(getattr(self, name)))
        object.__setattr__(self, "bad_pixels", self._unusable())
        if self.nonlinearity is not None:
            object.__setattr__(self, "nonlinearity", tuple(float(c) for c in self.nonlinearity))

    def _unusable(self) -> np.ndarray | None:
        """The bad pixels, and those for which a map has no number; such a number is made a harmless one."""
        bad = None if self.bad_pixels is None else np.asarray(self.bad_pixels, dtype=bool)
        for name in ("bias", "read_noise", "dark_current", "flat"):
            values = getattr(self, name)
            if np.ndim(values) and not np.isfinite(values).all():
                missing = ~np.isfinite(values)
                bad = missing if bad is None else bad | missing
                object.__setattr__(self, name, np.where(missing, nominal(values), values))
        return bad

    def source(self, name: str) -> str:
        """Where a number comes from; ``"argument Detector"`` where nothing else was said."""
        return self.sources.get(name, "argument Detector")

    def nominal(self, name: str) -> float | None:
        """A number, or the median of a map, by its name; None where it is not known."""
        if name not in self._nominals:
            self._nominals[name] = nominal(getattr(self, name))
        return self._nominals[name]

    @cached_property
    def _nominals(self) -> dict[str, float | None]:
        """Medians once found: of 20 million pixels one takes longer than a frame."""
        return {}

    @property
    def largest(self) -> float:
        """What the converter reads at most, ADU; infinite where the bits are not known."""
        return math.inf if self.bits is None else 2.0**self.bits - 1
