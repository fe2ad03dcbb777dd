"""What is known of the stars' spectra before a frame is looked at.

A star's photons per wavelength are those of the instrument's spectrum times ``1 + index (1 -
mean/wavelength)``, with the harmonic mean: so blackbodies differ to first order, and so extinction changes
them.  The index is free in a fit: fitted with one flat spectrum, the two stars of alpha Centauri bias
their separation by a milliarcsecond.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.constants import c, h, k

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.optics.spectrum import Spectrum

WAVELENGTH = "wavelength_shift"
"""Name of the shift by which all wavelengths are longer, nm."""

INDEX_ERROR = 2.0
"""Standard deviation of the index of a star: blackbodies of 3,000 and 30,000 K have indices of +4.2 and -2.7
about a flat spectrum at 0.6 um.  A narrower one would pull: 0.5 by 5 uas where an index is off by 0.3."""


WAVELENGTH_ERROR = 2e-3
"""Relative standard deviation of the wavelengths of a band: a filter's are known to a nanometre."""


@dataclass(frozen=True)
class Colours:
    """Spectral indices of the stars and wavelengths of the instrument, as they are known beforehand.

    Parameters
    ----------
    indices : tuple of float
        One for any star, or those of A and B.
    sigma : float
        Standard deviation of each; zero where they are known, and infinite where nothing is.
    wavelength_err : float
        Relative standard deviation of the instrument's wavelengths; zero where they are known.
    temperature : float, optional
        Of a blackbody [K] in front of the instrument: the light of a star of index zero.  By default it is
        flat in photons per wavelength.

    Raises
    ------
    ConfigurationError
        If there are not one or two indices, or a number is impossible.
    """

    indices: tuple[float, ...] = (0.0,)
    sigma: float = INDEX_ERROR
    temperature: float | None = None
    wavelength_err: float = WAVELENGTH_ERROR

    def __post_init__(self) -> None:
        if len(self.indices) not in (1, 2) or not np.all(np.isfinite(self.indices)):
            problem = f"indices = {list(self.indices)} are no spectral indices"
            raise ConfigurationError(ErrorCode.OUT_OF_RANGE, f"{problem}; give one, or those of A and B.")
        if not 0 <= self.wavelength_err < np.inf:
            problem = f"The relative error of the wavelengths is {self.wavelength_err}"
            raise ConfigurationError(ErrorCode.OUT_OF_RANGE, f"{problem}; give zero or more.")
        if not self.sigma >= 0:
            problem = f"The error of the spectral indices is {self.sigma}"
            remedy = "give zero or a positive number"
            raise ConfigurationError(ErrorCode.OUT_OF_RANGE, f"{problem}; {remedy}.")

    def of(self, count: int) -> tuple[float, ...]:
        """Return the indices of so many stars: a single star has the mean of two."""
        known = self.indices
        return known if len(known) == count else (float(np.mean(known)),) * count

    def seen(self, spectrum: Spectrum) -> Spectrum:
        """Return what an instrument's spectrum is for a star of index zero."""
        if self.temperature is None:
            return spectrum
        weights = np.array(spectrum.weights) * _photons(self.temperature, spectrum)
        return Spectrum(spectrum.wavelengths, tuple(weights))

    @property
    def precision(self) -> float:
        """Return the inverse variance of each index; zero where it is known exactly, and so never fitted."""
        return self.sigma**-2 if self.sigma > 0 else 0.0

    @property
    def log_density(self) -> float:
        """Logarithm of the prior density of an index at its mean; zero where it is known exactly."""
        return -math.log(self.sigma * math.sqrt(2 * math.pi)) if self.sigma > 0 else 0.0

    def held(self, names: Collection[str]) -> tuple[str, ...]:
        """Return those names of spectral indices that a fit holds."""
        return () if self.sigma > 0 else tuple(names)


def blackbody_index(temperature: float, spectrum: Spectrum) -> float:
    """Return the spectral index of a blackbody in a band.

    Parameters
    ----------
    temperature : float
        K, positive.
    spectrum : Spectrum
        Of the instrument; a source that is flat in photons per wavelength has it.

    Returns
    -------
    index : float
        Of the factor that fits best, weighted by the spectrum: it has the same mean wavenumber.

    Raises
    ------
    ConfigurationError
        If the temperature is not positive, or the spectrum has one wavelength only.
    """
    return _index(_photons(temperature, spectrum), spectrum)


def _index(photons: np.ndarray, spectrum: Spectrum) -> float:
    """Return the slope of photons at each wavelength of a spectrum, as factors of it."""
    weights, tilt = np.array(spectrum.weights), wavenumber_offsets(spectrum)
    if not np.any(tilt):
        problem = "A spectrum of one wavelength has no colour; leave temperatures out."
        raise ConfigurationError(ErrorCode.CONFLICT, problem)
    return float(np.sum(weights * tilt * photons) / np.sum(weights * tilt**2) / np.sum(weights * photons))


def _photons(temperature: float, spectrum: Spectrum) -> np.ndarray:
    """Return the photons of a blackbody at each wavelength, one on average."""
    if not 0 < temperature < np.inf:
        problem = f"A temperature of {temperature} K is impossible; give a positive one."
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, problem)
    metres = np.array(spectrum.wavelengths) * 1e-9
    with np.errstate(over="ignore"):  # a cold body has no light at all
        photons = metres**-4 / np.expm1(h * c / (metres * k * temperature))
    mean = np.sum(np.array(spectrum.weights) * photons)
    if not mean > 0:
        problem = f"A body of {temperature:g} K sends no light at {1e9 * metres.mean():.0f} nm; give K."
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, problem)
    return photons / mean


def wavenumber_offsets(spectrum: Spectrum) -> np.ndarray:
    """Return by how much the wavenumber of each wavelength lies below the mean one, as a share of that."""
    wavenumbers = 1 / np.array(spectrum.wavelengths)
    return 1 - wavenumbers / np.sum(np.array(spectrum.weights) * wavenumbers)


def colours_of(temperatures: Sequence[float], spectrum: Spectrum, sigma: float = INDEX_ERROR) -> Colours:
    """Return what the temperatures [K] of the stars say: a mean spectrum, and their indices about it."""
    middle = float(np.mean(temperatures))
    mean = Colours(temperature=middle).seen(spectrum)
    beside = _photons(middle, spectrum)
    indices = tuple(_index(_photons(one, spectrum) / beside, mean) for one in temperatures)
    return Colours(indices, sigma, middle)


def mean_spectrum(spectra: Sequence[Spectrum], samples: int) -> tuple[Spectrum, tuple[float, ...]]:
    """Return the mean of the stars' spectra at so many wavelengths, and the index of each about it.

    Parameters
    ----------
    spectra : sequence of Spectrum
        Detected photons of each star, with as many wavelengths each.
    samples : int

    Returns
    -------
    mean : Spectrum
        A star counts as much as any other.
    indices : tuple of float
        With them each star has the mean wavenumber of its own spectrum.
    """
    both = Spectrum(
        tuple(nm for one in spectra for nm in one.wavelengths),
        tuple(share for one in spectra for share in one.weights),
    )
    tilt = wavenumber_offsets(both)
    spread = float(np.dot(both.weights, tilt**2))
    parts = zip(np.split(tilt, len(spectra)), spectra, strict=True)
    return both.sampled(samples), tuple(float(np.dot(one.weights, part)) / spread for part, one in parts)
