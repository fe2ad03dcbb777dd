"""A curve over wavelength, as a spectrum, a transmission or a quantum efficiency, and what they let through.

Reach for :func:`read_curve`, which takes a CSV of the format of :mod:`jitterkit.optics.spectrum_file`.

:class:`Throughput` says how many of a hundred photons that reach the telescope are detected, and
:func:`collecting_area` the area that collects them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.ndimage import maximum_filter

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.optics import spectrum_file
from jitterkit.optics.pupil import Pupil
from jitterkit.optics.spectrum import Spectrum, flat_band


@dataclass(frozen=True, eq=False)
class Curve:
    """Straight lines between rows, and nothing outside.

    Parameters
    ----------
    wavelengths : (m,) array
        nm, positive and ascending, two at least.
    values : (m,) array
        Not negative, nor all zero.

    Raises
    ------
    ConfigurationError
        If they are not.
    """

    wavelengths: np.ndarray
    values: np.ndarray

    def __post_init__(self) -> None:
        wavelengths, values = (np.asarray(a, dtype=float) for a in (self.wavelengths, self.values))
        alike = wavelengths.ndim == 1 and wavelengths.shape == values.shape
        if not alike or len(wavelengths) < 2:
            code = ErrorCode.TOO_FEW if alike else ErrorCode.WRONG_SHAPE
            problem = f"A curve cannot have {wavelengths.size} wavelengths and {values.size} values"
            raise ConfigurationError(code, f"{problem}; give equal numbers of both, two at least.")
        in_place = np.isfinite(wavelengths) & (wavelengths > np.append(0.0, wavelengths[:-1]))
        if not in_place.all():
            problem = "A curve's wavelengths must be positive and ascend, in nm"
            found = f"and {wavelengths[~in_place][0]:g} is out of place; sort the table"
            raise ConfigurationError(ErrorCode.MALFORMED, f"{problem}, {found}.")
        if not (np.all(np.isfinite(values)) and np.all(values >= 0) and np.any(values > 0)):
            problem = "A curve must not be negative, nor zero everywhere"
            found = f"and this one reaches from {values.min():g} to {values.max():g}; correct the table"
            raise ConfigurationError(ErrorCode.OUT_OF_RANGE, f"{problem}, {found}.")
        object.__setattr__(self, "wavelengths", wavelengths)
        object.__setattr__(self, "values", values)

    def __call__(self, wavelengths: np.ndarray) -> np.ndarray:
        """Return the values at wavelengths [nm]."""
        return np.interp(wavelengths, self.wavelengths, self.values, left=0.0, right=0.0)

    @property
    def support(self) -> tuple[float, float]:
        """Shortest and longest wavelength [nm] between which the curve is not zero."""
        lit = np.flatnonzero(self.values)
        last = len(self.values) - 1
        return (float(self.wavelengths[max(lit[0] - 1, 0)]), float(self.wavelengths[min(lit[-1] + 1, last)]))


def flat_curve(low: float, high: float, value: float = 1.0) -> Curve:
    """Return a constant between two wavelengths [nm].

    Raises
    ------
    ConfigurationError
        If the wavelengths are out of order or the value is not positive.
    """
    if not 0 < low < high:
        problem = f"A band needs 0 < low < high in nm; got {low} to {high}."
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, problem)
    return Curve(np.array([low, high]), np.array([value, value]))


def band_of(spectrum: Spectrum) -> Curve:
    """Return the perfect filter that a flat band [nm] was made of.

    Raises
    ------
    ConfigurationError
        If the spectrum is not that of :func:`~jitterkit.optics.spectrum.flat_band`: its shape holds
        stars and detector already.
    """
    nodes = np.asarray(spectrum.wavelengths)
    outermost = np.polynomial.legendre.leggauss(nodes.size)[0][-1]
    if nodes.size > 1:
        middle, half = (nodes[0] + nodes[-1]) / 2, (nodes[-1] - nodes[0]) / 2 / outermost
        band = flat_band(middle - half, middle + half, nodes.size)
        if np.allclose(band.wavelengths, nodes) and np.allclose(band.weights, spectrum.weights):
            return flat_curve(middle - half, middle + half)
    raise ConfigurationError(
        ErrorCode.UNSUPPORTED,
        f"The instrument's spectrum, {nodes.size} wavelengths from {nodes.min():g} to {nodes.max():g} nm, is "
        "no flat band, and so no filter; give the filter.",
    )


def read_curve(path: str | Path, values: str = "share") -> Curve:
    """Read a curve from a CSV of wavelength [nm] and value.

    Parameters
    ----------
    path : str or Path
    values : str
        What is in the second column: a ``share`` of 1 (filter, quantum efficiency), or ``photons`` per nm.

    Raises
    ------
    ConfigurationError
        If the file is no such table, its names say other units, or its rows are no curve; the message names
        the file.
    """
    columns = spectrum_file.read_curve(path, values)
    try:
        return Curve(*columns)
    except ConfigurationError as error:
        raise ConfigurationError(error.code, f"{path}: {error}") from None


GLASS, PLATES = 0.91, 2
"""Transmission of one glass plate, and their number: the filter lies between two (paper, appendix A)."""

IMX183_QE = Curve(
    np.arange(300.0, 1101.0, 50.0),
    np.array(
        [0.01, 0.26, 0.72, 0.79, 0.84, 0.76, 0.66, 0.52, 0.44, 0.32, 0.23, 0.16, 0.11, 0.06, 0.03, 0.01, 0.0]
    ),
)
"""Nominal quantum efficiency of TOLIMAN's detector, a monochrome Sony IMX183 in a FLIR BFS-U3-200S6M: the
curve of the paper's notebook, read off to two digits every 50 nm.  Not a measurement of any one camera."""

_STEP = 0.1
"""nm: on it the trapezoidal rule errs by less than 1e-7 of a blackbody's photons."""


@dataclass(frozen=True, eq=False)
class Throughput:
    """Filter, glass and detector.

    Parameters
    ----------
    filter : Curve
        Transmission, 0 to 1.
    glass : float
        Transmission of one plate, at every wavelength.
    plates : int
    qe : Curve
        Quantum efficiency, 0 to 1; nominal if omitted.

    Raises
    ------
    ConfigurationError
        If a share is not between 0 and 1 (per cent, say), or nothing passes.
    """

    filter: Curve
    glass: float = GLASS
    plates: int = PLATES
    qe: Curve = field(default_factory=lambda: IMX183_QE)

    def __post_init__(self) -> None:
        for name, curve in (("filter", self.filter), ("quantum efficiency", self.qe)):
            if curve.values.max() > 1:
                problem = f"The {name} reaches {curve.values.max():g}; give shares of 1, not per cent."
                raise ConfigurationError(ErrorCode.OUT_OF_RANGE, problem)
        if not 0 < self.glass <= 1:
            problem = f"glass = {self.glass} is no transmission; give 0 to 1."
            raise ConfigurationError(ErrorCode.OUT_OF_RANGE, problem)
        if self.plates < 0:
            problem = f"plates = {self.plates} is no number of plates; give 0 or more."
            raise ConfigurationError(ErrorCode.OUT_OF_RANGE, problem)
        if not np.any(self(self.grid())):
            raise ConfigurationError(
                ErrorCode.CONFLICT,
                f"Filter ({_range(self.filter)}) and quantum efficiency ({_range(self.qe)}) have no "
                "wavelength in common; give curves that overlap.",
            )

    @property
    def plates_transmission(self) -> float:
        """Return the transmission of all plates together."""
        return self.glass**self.plates

    def __call__(self, wavelengths: np.ndarray) -> np.ndarray:
        """Return the share of the photons that is detected, at wavelengths [nm]."""
        return self.filter(wavelengths) * self.plates_transmission * self.qe(wavelengths)

    def grid(self) -> np.ndarray:
        """Wavelengths [nm] from end to end of what passes, 0.1 nm apart or less, every row among them."""
        ends = list(zip(self.filter.support, self.qe.support, strict=True))
        low, high = max(ends[0]), min(ends[1])
        if low >= high:
            return np.empty(0)
        fine = np.linspace(low, high, int(np.ceil((high - low) / _STEP)) + 1)
        rows = np.concatenate([fine, self.filter.wavelengths, self.qe.wavelengths])
        return np.unique(rows[(rows >= low) & (rows <= high)])


def _range(curve: Curve) -> str:
    low, high = curve.support
    return f"{low:g} to {high:g} nm"


_CM2 = 1e4
"""In a square metre."""


def collecting_area(pupil: Pupil) -> float:
    """Area of a pupil, weighted by the share of the photons that it passes, cm².

    Notes
    -----
    The transmission ``t`` is of the amplitude, and a grey pupil passes the sum of ``t²``.  A sample that a
    hard edge cuts holds the share of it that is clear, and passes that: of a pupil with hard edges the sum
    of ``t`` counts (that of ``t²`` is 0.5 % too small for TOLIMAN's 256 samples).  A pupil is taken for
    hard-edged if each of its samples is clear or opaque, or touches one that is, corners included.

    *Fails when* a grey rim is a sample or two wide: it is taken for an edge.
    """
    transmission = np.asarray(pupil.transmission)
    decided = np.isclose(transmission, 0) | np.isclose(transmission, 1)
    hard = np.all(maximum_filter(decided, 3))
    return float(np.sum(transmission if hard else transmission**2) * pupil.pitch**2 * _CM2)


def annulus_area(diameter: float, obscuration: float = 0.0) -> float:
    """Area of a circle of a diameter without one of another, cm².

    Parameters
    ----------
    diameter, obscuration : float
        m, ``0 <= obscuration < diameter``.

    Examples
    --------
    >>> round(annulus_area(0.125, 0.032), 2)  # TOLIMAN
    114.68

    Raises
    ------
    ConfigurationError
        If the diameters are out of order.
    """
    if not 0 <= obscuration < diameter:
        problem = f"The obscuration must lie between 0 and the diameter of {diameter} m, got {obscuration} m."
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, problem)
    return math.pi / 4 * (diameter**2 - obscuration**2) * _CM2
