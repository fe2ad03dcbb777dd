"""The photons of a pair of stars that an exposure detects.

Reach for :func:`count_photons`; :func:`compare` sets it beside what the paper published.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.optics.spectrum import Spectrum
from jitterkit.optics.spectrum_file import band_from_table
from jitterkit.photons.curve import Curve, Throughput, annulus_area


@dataclass(frozen=True, eq=False)
class PhotonBudget:
    """Detected photons of a pair.

    Parameters
    ----------
    stars : (Curve, Curve)
        Spectra of A and B before the telescope, photons/s/cm²/nm.
    throughput : Throughput
    area : float
        Collecting area, cm².
    exposure : float
        s.
    wavelengths : (m,) array
        nm, over all that passes.
    detected : (2, m) array
        Of A and B, photons/s/cm²/nm.
    """

    stars: tuple[Curve, Curve]
    throughput: Throughput
    area: float
    exposure: float
    wavelengths: np.ndarray
    detected: np.ndarray

    @property
    def rates(self) -> tuple[float, float]:
        """Detected photons/s/cm² of A and of B."""
        a, b = np.trapezoid(self.detected, self.wavelengths)
        return float(a), float(b)

    @property
    def rate(self) -> float:
        """Detected photons/s/cm² of both."""
        return sum(self.rates)

    @property
    def contrast(self) -> float:
        """Return the photons of A over those of B: in the band, which is not quite their ratio in V."""
        return self.rates[0] / self.rates[1]

    @property
    def mean_wavelength(self) -> float:
        """Return the mean wavelength of the detected photons of both stars, nm."""
        total = self.detected.sum(axis=0)
        return float(np.trapezoid(total * self.wavelengths, self.wavelengths) / self.rate)

    @property
    def photons(self) -> float:
        """Detected from both in the exposure, in the frame or not."""
        return self.photons_through(self.area)

    def photons_through(self, area: float) -> float:
        """Detected from both in the exposure, through another collecting area [cm²]."""
        return self.rate * area * self.exposure

    def spectrum(self, samples: int = 13) -> Spectrum:
        """Return the detected photons of both as the wavelengths to model optics with.

        Parameters
        ----------
        samples : int
            Number of Gauss nodes, as in :func:`~jitterkit.optics.spectrum_file.band_from_table`.

        Returns
        -------
        spectrum : Spectrum
            In place of a flat band.
        """
        return band_from_table(self.wavelengths, self.detected.sum(axis=0), samples)


def count_photons(
    stars: tuple[Curve, Curve], throughput: Throughput, *, area: float, exposure: float
) -> PhotonBudget:
    """Count the photons of a pair of stars that an exposure detects.

    Parameters
    ----------
    stars : (Curve, Curve)
        A and B, photons/s/cm²/nm: :func:`~jitterkit.photons.stars.blackbody` or
        :func:`~jitterkit.photons.stars.tabulated`.
    throughput : Throughput
    area : float
        Collecting area, cm².
    exposure : float
        s.

    Returns
    -------
    budget : PhotonBudget
        A spectrum of 1 photon/s/cm²/nm through a perfect band of 110 nm has a rate of 110 photons/s/cm².

    Raises
    ------
    ConfigurationError
        If area or exposure is not positive, or a spectrum ends within what passes.

    Notes
    -----
    *Assumes* mirrors without loss; what the secondary and its struts hold back is in the area.
    *Source*: the paper's appendix A.
    """
    for name, value, unit in (("area", area, "cm²"), ("exposure", exposure, "s")):
        if not 0 < value < np.inf:
            problem = f"{name} = {value} is not positive; give it in {unit}."
            raise ConfigurationError(ErrorCode.OUT_OF_RANGE, problem)
    wavelengths = throughput.grid()
    low, high = wavelengths[[0, -1]]
    for letter, star in zip("AB", stars, strict=True):
        first, last = star.wavelengths[[0, -1]]
        if first > low or last < high:
            raise ConfigurationError(
                ErrorCode.SAMPLING,
                f"The spectrum of {letter} covers {first:g} to {last:g} nm, but light passes from {low:g} to "
                f"{high:g} nm; give a longer spectrum or a narrower filter.",
            )
    wavelengths = np.unique(np.concatenate([wavelengths, *(_within(star, wavelengths) for star in stars)]))
    share = throughput(wavelengths)
    return PhotonBudget(
        stars,
        throughput,
        area,
        exposure,
        wavelengths,
        np.array([star(wavelengths) * share for star in stars]),
    )


def _within(star: Curve, wavelengths: np.ndarray) -> np.ndarray:
    """The rows of a spectrum between the ends of wavelengths: a spectral line is narrower than a step."""
    rows = star.wavelengths
    return rows[(rows >= wavelengths[0]) & (rows <= wavelengths[-1])]


_DIAMETER, _OBSCURATION = 0.125, 0.032
"""m, of TOLIMAN: the figures that the paper takes for radii."""

_RATE, _RATES = 8.309e5, (6.342e5, 1.967e5)
"""Published: photons/s/cm² of both (paper), of A and of B (notebook), from Phoenix atmospheres."""

_AREA, _EXPOSURE, _PHOTONS = 458.7, 0.1, 3.811e7
"""Published by both: cm², s, photons per exposure."""

_CONTRAST = 3.37
"""Published: of the paper's model; 2.5 log10 of it is the difference in V, while the notebook's rates in the
band have 3.22."""


@dataclass(frozen=True)
class Line:
    """A quantity, what it is here, and what paper and notebook published (NaN where they are silent).

    The paper (appendix A, and the notebook it points to) takes TOLIMAN's diameters for radii, so that its
    area, and its photons per exposure, are four times too large.
    """

    quantity: str
    unit: str
    here: float
    paper: float = math.nan
    notebook: float = math.nan


def compare(budget: PhotonBudget, published: bool = True) -> list[Line]:
    """Say a budget in lines.

    Parameters
    ----------
    budget : PhotonBudget
        Its ``area`` is that of the pupil.
    published : bool
        Whether to set the published figures beside, and to say the photons by the paper's area too: for
        TOLIMAN.

    Returns
    -------
    lines : list of Line
    """
    rates, both, area = "photons/s/cm²", budget.rate, budget.area
    true, slip = annulus_area(_DIAMETER, _OBSCURATION), annulus_area(2 * _DIAMETER, 2 * _OBSCURATION)
    lines = [
        Line("rate of A", rates, budget.rates[0], notebook=_RATES[0]),
        Line("rate of B", rates, budget.rates[1], notebook=_RATES[1]),
        Line("rate of both", rates, both, _RATE, _RATE),
        Line("contrast in the band", "", budget.contrast, _CONTRAST, _RATES[0] / _RATES[1]),
        Line("mean wavelength", "nm", budget.mean_wavelength),
        Line("exposure", "s", budget.exposure, _EXPOSURE, _EXPOSURE),
        Line("area of the pupil", "cm²", area),
        Line("photons by it", "", budget.photons),
        Line("area without struts", "cm²", true),
        Line("photons by it", "", budget.photons_through(true)),
        Line("area, diameters for radii", "cm²", slip, _AREA, _AREA),
        Line("photons by it", "", budget.photons_through(slip), _PHOTONS, _PHOTONS),
    ]
    return lines if published else [Line(x.quantity, x.unit, x.here) for x in lines[:8]]
