"""Images of stars by direct Fourier sums: no FFT, no transfer function, and no formula of the package.

The field at each of 4 x 4 Gauss-Legendre points in every pixel is summed over the samples of the pupil, for
each star, wavelength and pointing; intensities add up.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

__all__ = ["Source", "Telescope", "absorption", "blackbody", "flat", "noll_mode", "render"]

_ARCSEC = math.pi / 180 / 3600
_POINTS = 4
"""Gauss-Legendre points along each side of a pixel: 8 gave the same separation to 0.001 uas."""

Spectrum = Callable[[np.ndarray], np.ndarray]


def flat(nm: np.ndarray) -> np.ndarray:
    """As many photons at every wavelength."""
    return np.ones_like(nm)


def blackbody(kelvin: float) -> Spectrum:
    """Photons per wavelength of a blackbody, in any unit."""
    return lambda nm: nm**-4.0 / (np.exp(1.438777e7 / (nm * kelvin)) - 1)


def absorption(spectrum: Spectrum, lines: Sequence[tuple[float, float, float]]) -> Spectrum:
    """The same with lines: centre and width [nm] and depth of each."""

    def absorbed(nm: np.ndarray) -> np.ndarray:
        depth = sum(deep * np.exp(-(((nm - at) / wide) ** 2)) for at, wide, deep in lines)
        return spectrum(nm) * (1 - depth)

    return absorbed


@dataclass(frozen=True)
class Source:
    """A star: place [arcsec], electrons, spectrum, and wavefront error [nm] that only its light has."""

    x: float
    y: float
    flux: float
    spectrum: Spectrum = flat
    opd: np.ndarray | float = 0.0


@dataclass(frozen=True)
class Telescope:
    """A pupil of amplitudes and wavefront errors [nm] on a square grid of a width [m], and a band [nm]."""

    amplitude: np.ndarray
    opd: np.ndarray
    width: float
    band: tuple[float, float]
    wavelengths: int = 17
    pointing: Sequence[tuple[float, float, float]] = field(default_factory=lambda: [(0.0, 0.0, 1.0)])


def render(
    telescope: Telescope,
    sources: Sequence[Source],
    shape: tuple[int, int],
    plate_scale: float,
    displaced: tuple[np.ndarray, np.ndarray] | None = None,
) -> np.ndarray:
    """Return the expected electrons (ny, nx).

    Columns may be displaced along x and rows along y, by the pixels given.
    """
    nodes, shares = np.polynomial.legendre.leggauss(_POINTS)
    along = [((np.arange(n) - (n - 1) / 2)[:, None] + nodes / 2).ravel() * plate_scale for n in shape[::-1]]
    if displaced is not None:
        along = [a + np.repeat(by, _POINTS) * plate_scale for a, by in zip(along, displaced, strict=True)]
    at, weight = np.polynomial.legendre.leggauss(telescope.wavelengths)
    low, high = telescope.band
    nm = (low + high) / 2 + at * (high - low) / 2
    n = len(telescope.amplitude)
    pitch = telescope.width / n
    pupil = (np.arange(n) - (n - 1) / 2) * pitch
    image = np.zeros(shape)
    for star in sources:
        photons = weight * star.spectrum(nm)
        for wave, share in zip(nm, star.flux * photons / photons.sum(), strict=True):
            field_there = telescope.amplitude * np.exp(2j * np.pi * (telescope.opd + star.opd) / wave)
            wavenumber = 2 * np.pi / (wave * 1e-9) * _ARCSEC
            for x, y, part in telescope.pointing:
                columns = np.exp(-1j * wavenumber * np.outer(along[0] - star.x - x, pupil))
                rows = np.exp(-1j * wavenumber * np.outer(along[1] - star.y - y, pupil))
                light = np.abs(rows @ field_there @ columns.T) ** 2
                light = light.reshape(shape[0], _POINTS, shape[1], _POINTS)
                density = part * share * (pitch * _ARCSEC / (wave * 1e-9)) ** 2
                image += density * np.einsum("asbt,s,t->ab", light, shares / 2, shares / 2)
    return image * plate_scale**2 / np.sum(telescope.amplitude**2)


def noll_mode(number: int, samples: int) -> np.ndarray:
    """Return a Zernike polynomial (samples, samples) of one nm rms over the full circle, by Noll's number."""
    order = 0
    while (order + 1) * (order + 2) // 2 < number:
        order += 1
    position = number - order * (order + 1) // 2
    azimuth = 2 * (position // 2) if order % 2 == 0 else 2 * ((position - 1) // 2) + 1
    axis = (np.arange(samples) - (samples - 1) / 2) * 2 / samples
    x, y = axis[None], axis[:, None]
    radius, angle = np.hypot(x, y), np.arctan2(y, x)
    radial = sum(
        (-1.0) ** s
        * math.factorial(order - s)
        / math.factorial(s)
        / math.factorial((order + azimuth) // 2 - s)
        / math.factorial((order - azimuth) // 2 - s)
        * radius ** (order - 2 * s)
        for s in range((order - azimuth) // 2 + 1)
    )
    if azimuth == 0:
        return math.sqrt(order + 1) * radial
    turn = np.cos(azimuth * angle) if number % 2 == 0 else np.sin(azimuth * angle)
    return math.sqrt(2 * (order + 1)) * radial * turn
