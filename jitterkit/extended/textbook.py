"""The textbook's methods to find a blur's length and angle in the spectrum of one image.

**Cepstrum**, the spectrum of the logarithm of the power spectrum.  The nulls of a streak are evenly spaced,
``ln(4 sin²(pi u L)) = -2 sum cos(2 pi k u L) / k``, and so the cepstrum has a negative peak at the streak's
end and weaker ones at its multiples.  Their weighted sum over three multiples is the *comb*:
:func:`comb_peaks` is where :mod:`~jitterkit.extended.blind` starts, :func:`estimate_cepstrum` reports its
highest tooth as it is.

**Autocorrelation** of the image's derivative along the motion.  A streak is a box; its derivative is a pair
of opposite spikes, one at either end.  So the derivative of the blurred image along the motion resembles its
own negative a streak's length away: its autocorrelation has a negative peak there (Yitzhaky & Kopeika, Graph.
Models Image Process. 59, 310, 1997).  The scene is whitened first: only the blur is left to correlate.

**Radon transform** of the log spectrum.  A streak lays parallel dark stripes over the power spectrum, across
its own direction.  Summed along the right direction they add up, and along others they average out: the
projection with the largest variance tells the angle.  The nulls in that projection, matched as a whole, tell
the length.
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
"""Pixels: below, the comb mistakes the scene's own spectrum for nulls (see ``scripts/extended_study``), the
derivative's own peak, at no distance at all, hides the streak's, and fewer than two nulls a side lie where a
photograph rises above its noise."""

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
        problem = f"The cepstrum's highest peak, at {length:.1f} pixels, is too close to the middle"
        message = f"{problem} to be trusted (it must lie beyond {_GATE:g})."
        raise UndeterminedError(ErrorCode.NOT_CONSTRAINED, message)
    rival = max(rivals, default=0.0)
    if score < _LEAST_CONTRAST * rival:
        peaks = f"{score:.1f} sigma, is less than {_LEAST_CONTRAST:g} times another of {rival:.1f}"
        problem = f"No peak of the cepstrum stands out (the highest, {peaks})"
        message = f"{problem}: the image shows no streak's nulls."
        raise UndeterminedError(ErrorCode.NOT_CONSTRAINED, message)
    return streak_estimate(length, angle, "cepstrum", _ERRORS, plate_scale)


def comb_peaks(spectrum: PowerSpectrum, count: int = 4) -> list[tuple[float, float, float]]:
    """Return the highest peaks of the comb as ``(length [pixels], angle [deg], score)``, the highest first.

    The score is in standard deviations of a cepstrum without peaks.
    """
    lengths = np.arange(_SHORTEST, longest(spectrum.shape), _STEP[0])
    angles = np.arange(0.0, 180.0, _STEP[1])
    # the sum of the negative cepstrum over multiples, weighted as the nulls weight them
    values, (ny, nx) = whitened(spectrum), spectrum.shape
    cepstrum = fft.ifft2(fft.ifftshift(values)).real * values.size / np.sqrt((values**2).sum())
    x, y = lengths[:, None] * np.cos(np.radians(angles)), lengths[:, None] * np.sin(np.radians(angles))
    total, norm = np.zeros(x.shape), np.zeros(x.shape)
    for k in range(1, _HARMONICS + 1):
        inside = (np.abs(k * x) < nx / 2) & (np.abs(k * y) < ny / 2)
        at = map_coordinates(cepstrum, [k * y % ny, k * x % nx], order=1, mode="grid-wrap")
        total -= at * inside / k
        norm += inside / k**2
    comb = total / np.sqrt(norm)
    found = []
    for _ in range(count):
        i, j = np.unravel_index(comb.argmax(), comb.shape)
        length, angle = lengths[i], angles[j]
        found.append((float(length), float(angle), float(comb[i, j])))
        comb[apart(lengths[:, None], angles, length, angle) < max(3.0, 0.1 * length)] = -np.inf
    return found


_LEAST_PEAK = 2.0
"""Highest peak over the second highest; photographs without blur, and wrong answers, reach 1.9."""

_PEAK_ERRORS = 0.3, 0.2
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
    if height < _LEAST_PEAK * peaks[rest].max():
        problem = f"No negative peak of the derivative's autocorrelation stands out beyond {_GATE:g} pixels."
        raise UndeterminedError(ErrorCode.NOT_CONSTRAINED, problem)
    return streak_estimate(length, angle, "autocorrelation", _PEAK_ERRORS, plate_scale)


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


_LEAST_CORRELATION = 0.25
"""Of the projection with the nulls of the best streak; photographs without blur reach 0.23."""

_STRIPE_STEP = 0.1, 0.5
"""Of the length [pixels] and the angle [degrees]."""

_STRIPE_ERRORS = 0.2, 0.1
"""Pixels, along and across: the scatter in ``scripts/extended_study``."""


def estimate_radon(image: np.ndarray, *, plate_scale: float = 1.0) -> KernelEstimate:
    """Estimate a uniform streak from projections of the log spectrum.

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
        If the projection does not look like a streak's nulls, or the streak is below 6 pixels.

    Notes
    -----
    *Assumes* uniform motion along a line, the same all over the image.  *Fails when* the scene has stripes
    of its own (brick, cloth, text): they take the angle.  A vibration's
    nulls are taken for a streak's; only the blind fit tells them apart.
    """
    spectrum = power_spectrum(image)
    angles = np.arange(0.0, 180.0, _STRIPE_STEP[1])
    # for each angle the mean of the values at every frequency along it, and their weight
    values, bins = whitened(spectrum), max(spectrum.shape)
    half = values.shape[1] // 2  # of a frequency and its negative, one
    values, weight = values[:, half:].ravel(), spectrum.weight[:, half:].ravel()
    projections = []
    for angle in np.radians(angles):
        along = np.abs(np.cos(angle) * spectrum.fx[:, half:] + np.sin(angle) * spectrum.fy)
        at = np.rint(along * bins).astype(np.intp).ravel()
        share = np.bincount(at, weight, bins)[: bins // 2]
        total = np.bincount(at, values, bins)[: bins // 2]
        projections.append((total / np.maximum(share, 1.0), share))
    best = int(np.argmax([(share * mean**2).sum() for mean, share in projections]))
    length, correlation = _match(*projections[best], longest(spectrum.shape))
    if correlation < _LEAST_CORRELATION:
        problem = "No stripes of a streak in the spectrum"
        found = f"the best match correlates by {correlation:.2f} (it takes {_LEAST_CORRELATION:g})"
        raise UndeterminedError(ErrorCode.NOT_CONSTRAINED, f"{problem}: {found}.")
    if length < _GATE:
        problem = f"The stripes belong to {length:.1f} pixels, too few to be distinguished from the"
        message = f"{problem} scene's spectrum (it takes {_GATE:g})."
        raise UndeterminedError(ErrorCode.NOT_CONSTRAINED, message)
    return streak_estimate(length, float(angles[best]), "radon", _STRIPE_ERRORS, plate_scale)


def _match(mean: np.ndarray, share: np.ndarray, limit: float) -> tuple[float, float]:
    """Return the length [pixels] whose nulls correlate best with a projection, and that correlation."""
    lengths = np.arange(2.5, limit, _STRIPE_STEP[0])
    u = np.arange(mean.size) / (2 * mean.size)
    # a null is filled by the window over some three of these frequencies
    nulls = np.log(np.sin(np.pi * u * lengths[:, None]) ** 2 + (2.0 * lengths[:, None] / mean.size) ** 2 / 4)
    nulls -= (nulls @ share / share.sum())[:, None]
    centred = mean - np.average(mean, weights=share)
    norm = np.sqrt((nulls**2 @ share) * (centred**2 @ share))
    match = (nulls * centred) @ share / norm
    return float(lengths[match.argmax()]), float(match.max())
