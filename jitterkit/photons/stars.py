"""Spectra of stars, outside the atmosphere, at the brightness that their V magnitude says.

Reach for :func:`blackbody`; :func:`tabulated` scales a measured or modelled spectrum.  synphot (extra
``spectra``) evaluates and normalises; the passband and its zero point are given here, so that it never
looks for a file or a network.

Notes
-----
*Source*: the V passband is Bessell's (PASP 102, 1181, 1990, table 2), which weighs energy, not photons
(Bessell and Murphy, PASP 124, 140, 2012, appendix); the zero point is that of Bessell, Castelli and Plez
(A&A 333, 231, 1998, table A2).  They hold to about 1 and 2 %, and so does every count that rests on them.

*Fails when* the lines of a cool star matter: the contrast of two blackbodies in alpha Cen's place comes out
2 % above that of the Phoenix atmospheres in the paper's notebook, through the same filter.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.photons.curve import Curve

if TYPE_CHECKING:
    from synphot import SourceSpectrum


TEMPERATURES = (5790.0, 5260.0)
"""K, of alpha Cen A and B, as the paper's notebook has them.  Interferometry says 5795 and 5231 (Kervella et
al., A&A 597, A137, 2017), spectroscopy 5824 and 5223 (Porto de Mello et al., A&A 488, 653, 2008): the count
changes by 0.1 %, the contrast by 0.3 %."""

MAGNITUDES = (0.01, 1.33)
"""V of alpha Cen A and B in SIMBAD (Ducati 2002), as in the paper's notebook; others have -0.01 for A."""

_V_ENERGY = 3.631e-9
"""erg/s/cm²/Å: the passband's mean of a star of V = 0."""

_V_START, _V_END = 470.0, 700.0
_V = np.array(
    [
        [0.0, 0.030, 0.163, 0.458, 0.780, 0.967, 1.000, 0.973, 0.898, 0.792, 0.684, 0.574],
        [0.461, 0.359, 0.270, 0.197, 0.135, 0.081, 0.045, 0.025, 0.017, 0.013, 0.009, 0.0],
    ]
).ravel()
"""Weight of the energy at 470 nm and every 10 nm on, up to 700 nm."""

_GRID = (200.0, 1200.0, 0.5)
"""nm, where a blackbody is tabulated: straight lines between are good to 1e-6 of it above 400 nm."""

_ANGSTROM = 10.0
"""In a nanometre."""


def blackbody(temperature: float, magnitude: float) -> Curve:
    """Return a blackbody of a V magnitude.

    Parameters
    ----------
    temperature : float
        K, 1000 to 100,000.
    magnitude : float
        V.

    Returns
    -------
    photons : Curve
        Photons/s/cm²/nm, 200 to 1200 nm.

    Raises
    ------
    ConfigurationError
        If a value is outside its range, or synphot is not installed.
    """
    if not 1e3 <= temperature <= 1e5:
        problem = f"A star of {temperature} K is none; give 1000 to 100000 K."
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, problem)
    source_of, _, models, _ = _synphot()
    wavelengths = np.arange(_GRID[0], _GRID[1] + _GRID[2], _GRID[2])
    return _sampled(source_of(models.BlackBodyNorm1D, temperature=temperature), wavelengths, magnitude)


def tabulated(spectrum: Curve, magnitude: float) -> Curve:
    """Return a star's spectrum in any unit of photons per nm, scaled to a V magnitude.

    Parameters
    ----------
    spectrum : Curve
        Over the whole V passband, 470 to 700 nm, at least.
    magnitude : float
        V.

    Returns
    -------
    photons : Curve
        Photons/s/cm²/nm, on the rows of ``spectrum``.

    Raises
    ------
    ConfigurationError
        If the spectrum does not cover V, or synphot is not installed.
    """
    low, high = spectrum.wavelengths[[0, -1]]
    if low > _V_START or high < _V_END:
        problem = f"A spectrum of {low:g} to {high:g} nm has no V magnitude"
        remedy = f"give one that covers {_V_START:g} to {_V_END:g} nm"
        raise ConfigurationError(ErrorCode.SAMPLING, f"{problem}; {remedy}.")
    source_of, _, models, units = _synphot()
    table = spectrum.values * units.PHOTLAM
    source = source_of(models.Empirical1D, points=spectrum.wavelengths * _ANGSTROM, lookup_table=table)
    return _sampled(source, spectrum.wavelengths, magnitude)


def _sampled(source: SourceSpectrum, wavelengths: np.ndarray, magnitude: float) -> Curve:
    """Photons/s/cm²/nm at wavelengths [nm], once the source has its magnitude."""
    if not np.isfinite(magnitude):
        problem = f"V = {magnitude} is no magnitude; give a finite number."
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, problem)
    _, element_of, models, units = _synphot()
    fine = np.arange(_V_START, _V_END + 0.5)
    # a throughput is per photon: Bessell's weight of energy over the wavelength
    weight = np.interp(fine, np.linspace(_V_START, _V_END, len(_V)), _V) * fine[0] / fine
    band = element_of(models.Empirical1D, points=fine * _ANGSTROM, lookup_table=weight)
    scaled = source.normalize(_V_ENERGY * 10 ** (-0.4 * magnitude) * units.FLAM, band=band)
    photons = scaled(wavelengths * _ANGSTROM, flux_unit=units.PHOTLAM).value
    return Curve(wavelengths, photons * _ANGSTROM)


def _synphot():
    """synphot's spectrum, throughput, models and units, or a sentence on how to get them."""
    try:
        from synphot import SourceSpectrum, SpectralElement, models, units
    except ImportError:
        problem = 'Photon counts need synphot, which is not installed; run: pip install "jitterkit[spectra]"'
        raise ConfigurationError(ErrorCode.MISSING_PACKAGE, problem) from None
    return SourceSpectrum, SpectralElement, models, units
