"""The blur's length and angle from the cepstrum: the spectrum of the logarithm of the power spectrum.

The nulls of a streak are evenly spaced, ``ln(4 sin²(pi u L)) = -2 sum cos(2 pi k u L) / k``, and so the
cepstrum has a negative peak at the streak's end and weaker ones at its multiples.  Their weighted sum
over three multiples is the *comb*: :func:`comb_peaks` is where :mod:`~jitterkit.extended.blind` starts,
:func:`estimate_cepstrum` reports its highest tooth as it is.
"""

from __future__ import annotations

import numpy as np
from scipy import fft
from scipy.ndimage import map_coordinates

from jitterkit.errors import ErrorCode, UndeterminedError
from jitterkit.extended.spectrum import PowerSpectrum, apart, power_spectrum, streak_estimate, whitened
from jitterkit.kernel_estimate import KernelEstimate

_HARMONICS = 3
"""Multiples of the length that are summed; a fourth adds 3 % to the sum's significance."""

_STEP = 0.25, 0.5
"""Of the length [pixels] and the angle [degrees]; the peaks are some 1 pixel wide."""

_SHORTEST = 2.5
"""Pixels: shorter streaks have no null inside the band."""

_GATE = 6.0
"""Pixels: below, the comb mistakes the scene's own spectrum for nulls (see ``scripts/extended_study``)."""

_LEAST_CONTRAST = 1.25
"""Highest peak over the second highest that is neither near it nor a multiple."""

_ERRORS = 1.0, 0.3
"""Pixels, along and across: the scatter in ``scripts/extended_study``."""


def longest(shape: tuple[int, int]) -> float:
    """Return the longest streak [pixels] looked for: its nulls must stay some three frequencies apart."""
    return min(0.3 * min(shape), 120.0)


def estimate_cepstrum(image: np.ndarray, *, plate_scale: float = 1.0) -> KernelEstimate:
    """Estimate a uniform streak from the negative peaks of the cepstrum.

    Parameters
    ----------
    image : (ny, nx) array
    plate_scale : float
        Arcsec/pixel; without one, a pixel counts as an arcsec.

    Returns
    -------
    estimate : KernelEstimate

    Raises
    ------
    UndeterminedError
        If no peak stands out, or the highest belongs to less than 6 pixels.

    Notes
    -----
    *Assumes* uniform motion along a line, the same all over the image.  *Fails when* the noise covers the
    high frequencies: the peak then comes out long by up to two pixels.
    """
    (length, angle, score), *others = comb_peaks(power_spectrum(image))
    rivals = [s for other, _, s in others if abs(other / length - round(other / length)) > 0.1]
    if length < _GATE:
        raise UndeterminedError(
            ErrorCode.NOT_CONSTRAINED,
            f"The cepstrum's highest peak, at {length:.1f} pixels, is too close to the middle to be trusted "
            f"(it must lie beyond {_GATE:g}).",
        )
    rival = max(rivals, default=0.0)
    if score < _LEAST_CONTRAST * rival:
        raise UndeterminedError(
            ErrorCode.NOT_CONSTRAINED,
            f"No peak of the cepstrum stands out (the highest, {score:.1f} sigma, is less than "
            f"{_LEAST_CONTRAST:g} times another of {rival:.1f}): the image shows no streak's nulls.",
        )
    return streak_estimate(length, angle, "cepstrum", _ERRORS, plate_scale)


def comb_peaks(spectrum: PowerSpectrum, count: int = 4) -> list[tuple[float, float, float]]:
    """Return the highest peaks of the comb as ``(length [pixels], angle [deg], score)``, the highest first.

    The score is in standard deviations of a cepstrum without peaks.
    """
    lengths = np.arange(_SHORTEST, longest(spectrum.shape), _STEP[0])
    angles = np.arange(0.0, 180.0, _STEP[1])
    comb = _comb(spectrum, lengths, angles)
    found = []
    for _ in range(count):
        i, j = np.unravel_index(comb.argmax(), comb.shape)
        length, angle = lengths[i], angles[j]
        found.append((float(length), float(angle), float(comb[i, j])))
        comb[apart(lengths[:, None], angles, length, angle) < max(3.0, 0.1 * length)] = -np.inf
    return found


def _comb(spectrum: PowerSpectrum, lengths: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Sum (lengths, angles) of the negative cepstrum over multiples, weighted as the nulls weight them."""
    values = whitened(spectrum)
    ny, nx = spectrum.shape
    cepstrum = fft.ifft2(fft.ifftshift(values)).real * values.size / np.sqrt((values**2).sum())
    x, y = lengths[:, None] * np.cos(np.radians(angles)), lengths[:, None] * np.sin(np.radians(angles))
    total, norm = np.zeros(x.shape), np.zeros(x.shape)
    for k in range(1, _HARMONICS + 1):
        inside = (np.abs(k * x) < nx / 2) & (np.abs(k * y) < ny / 2)
        at = map_coordinates(cepstrum, [k * y % ny, k * x % nx], order=1, mode="grid-wrap")
        total -= at * inside / k
        norm += inside / k**2
    return total / np.sqrt(norm)
