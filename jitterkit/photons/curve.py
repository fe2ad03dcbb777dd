"""A curve over wavelength: a spectrum, a transmission or a quantum efficiency.

Reach for :func:`read_curve`, which takes a CSV of the format of :mod:`jitterkit.optics.spectrum_file`.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.optics import spectrum_file
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


def read_curve(path: str | Path) -> Curve:
    """Read a curve from a CSV of wavelength [nm] and value.

    Raises
    ------
    ConfigurationError
        If the file is no such table, or its rows are no curve; the message names the file.
    """
    columns = spectrum_file.read_curve(path, "value")
    try:
        return Curve(*columns)
    except ConfigurationError as error:
        raise ConfigurationError(error.code, f"{path}: {error}") from None
