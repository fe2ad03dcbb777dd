"""The blur from the autocorrelation of the image's derivative along the motion.

A streak is a box; its derivative is a pair of opposite spikes, one at either end.  So the derivative
of the blurred image along the motion resembles its own negative a streak's length away: its autocorrelation
has a negative peak there (Yitzhaky & Kopeika, Graph. Models Image Process. 59, 310, 1997).  The scene is
whitened first, so that only the blur is left to correlate.
"""

from __future__ import annotations

import numpy as np
from scipy import fft
from scipy.ndimage import map_coordinates

from jitterkit.errors import ErrorCode, UndeterminedError
from jitterkit.extended.cepstrum import longest
from jitterkit.extended.spectrum import PowerSpectrum, apart, power_spectrum, streak_estimate
from jitterkit.kernel_estimate import KernelEstimate

_GATE = 6.0
"""Pixels: closer in, the derivative's own peak, at no distance at all, hides the streak's."""

_LEAST_CONTRAST = 2.0
"""Highest peak over the second highest; photographs without blur, and wrong answers, reach 1.9."""

_STEP = 0.25, 0.5
"""Of the length [pixels] and the angle [degrees]."""

_ERRORS = 0.3, 0.2
"""Pixels, along and across: the scatter in ``scripts/extended_study``."""


def estimate_autocorrelation(image: np.ndarray, *, plate_scale: float = 1.0) -> KernelEstimate:
    """Estimate a uniform streak from the derivative's autocorrelation.

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
        If no negative peak stands out beyond 6 pixels.

    Notes
    -----
    *Assumes* uniform motion along a line, the same all over the image.  *Fails when* the scene repeats itself
    (brick, text): then the scene has peaks of its own.
    """
    spectrum = power_spectrum(image)
    lengths = np.arange(_GATE, longest(spectrum.shape), _STEP[0])
    angles = np.arange(0.0, 180.0, _STEP[1])
    peaks = _along(_correlation(spectrum), lengths, angles)
    i, j = np.unravel_index(peaks.argmax(), peaks.shape)
    length, angle, height = float(lengths[i]), float(angles[j]), float(peaks[i, j])
    rest = apart(lengths[:, None], angles, length, angle) > max(4.0, 0.15 * length)
    if height < _LEAST_CONTRAST * peaks[rest].max():
        problem = f"No negative peak of the derivative's autocorrelation stands out beyond {_GATE:g} pixels."
        raise UndeterminedError(ErrorCode.NOT_CONSTRAINED, problem)
    return streak_estimate(length, angle, "autocorrelation", _ERRORS, plate_scale)


def _correlation(spectrum: PowerSpectrum) -> np.ndarray:
    """Autocorrelation (ny, nx) of the image with its spectrum flattened, in units of its scatter.

    The scene is taken to fall as 1/f², the noise is damped as Wiener would.
    """
    squared = spectrum.fx**2 + spectrum.fy**2
    flat = spectrum.power * squared * spectrum.weight
    flat = np.minimum(flat, 20 * np.median(flat[spectrum.weight > 0]))  # a line in the scene is not its blur
    correlation = fft.ifft2(fft.ifftshift(flat)).real
    return correlation / correlation.std()


def _along(correlation: np.ndarray, lengths: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Return the second derivative (lengths, angles) of the correlation along the ray at each angle.

    It is the negative autocorrelation of the derivative.
    """
    ny, nx = correlation.shape
    c, s = np.cos(np.radians(angles)), np.sin(np.radians(angles))

    def at(r: np.ndarray) -> np.ndarray:
        positions = [r[:, None] * s % ny, r[:, None] * c % nx]
        return map_coordinates(correlation, positions, order=1, mode="grid-wrap")

    return at(lengths - 1) - 2 * at(lengths) + at(lengths + 1)
