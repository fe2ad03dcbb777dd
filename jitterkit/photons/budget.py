"""The photons of a pair of stars that an exposure detects.

Reach for :func:`count_photons`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.optics.spectrum import Spectrum
from jitterkit.optics.spectrum_file import band_from_table
from jitterkit.photons.curve import Curve
from jitterkit.photons.throughput import Throughput


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
