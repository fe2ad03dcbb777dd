"""The blur from the stripes of the spectrum: the Radon transform of its logarithm.

A streak lays parallel dark stripes over the power spectrum, across its own direction.  Summed along the
right direction they add up, and along others they average out: the projection with the largest
variance tells the angle.  The nulls in that projection, matched as a whole, tell the length.
"""

from __future__ import annotations

import numpy as np

from jitterkit.errors import ErrorCode, UndeterminedError
from jitterkit.extended.cepstrum import longest
from jitterkit.extended.spectrum import PowerSpectrum, power_spectrum, streak_estimate, whitened
from jitterkit.kernel_estimate import KernelEstimate

_GATE = 6.0
"""Pixels: below, fewer than two nulls a side lie where a photograph rises above its noise."""

_LEAST_CORRELATION = 0.25
"""Of the projection with the nulls of the best streak; photographs without blur reach 0.23."""

_STEP = 0.1, 0.5
"""Of the length [pixels] and the angle [degrees]."""

_ERRORS = 0.2, 0.1
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
    angles = np.arange(0.0, 180.0, _STEP[1])
    projections = _projections(spectrum, whitened(spectrum), angles)
    best = int(np.argmax([(share * mean**2).sum() for mean, share in projections]))
    length, correlation = _match(*projections[best], longest(spectrum.shape))
    if correlation < _LEAST_CORRELATION:
        problem = "No stripes of a streak in the spectrum"
        found = f"the best match correlates by {correlation:.2f} (it takes {_LEAST_CORRELATION:g})"
        raise UndeterminedError(ErrorCode.NOT_CONSTRAINED, f"{problem}: {found}.")
    if length < _GATE:
        raise UndeterminedError(
            ErrorCode.NOT_CONSTRAINED,
            f"The stripes belong to {length:.1f} pixels, too few to be distinguished from the scene's "
            f"spectrum (it takes {_GATE:g}).",
        )
    return streak_estimate(length, float(angles[best]), "radon", _ERRORS, plate_scale)


def _projections(
    spectrum: PowerSpectrum, values: np.ndarray, angles: np.ndarray
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return for each angle the mean of the values at every frequency along it, and their weight."""
    half = values.shape[1] // 2  # of a frequency and its negative, one
    values, weight = values[:, half:].ravel(), spectrum.weight[:, half:].ravel()
    bins = max(spectrum.shape)
    fx, fy = spectrum.fx[:, half:], spectrum.fy
    projections = []
    for angle in np.radians(angles):
        at = np.rint(np.abs(np.cos(angle) * fx + np.sin(angle) * fy) * bins).astype(np.intp).ravel()
        share = np.bincount(at, weight, bins)[: bins // 2]
        total = np.bincount(at, values, bins)[: bins // 2]
        projections.append((total / np.maximum(share, 1.0), share))
    return projections


def _match(mean: np.ndarray, share: np.ndarray, limit: float) -> tuple[float, float]:
    """Return the length [pixels] whose nulls correlate best with a projection, and that correlation."""
    lengths = np.arange(2.5, limit, _STEP[0])
    u = np.arange(mean.size) / (2 * mean.size)
    # a null is filled by the window over some three of these frequencies
    nulls = np.log(np.sin(np.pi * u * lengths[:, None]) ** 2 + (2.0 * lengths[:, None] / mean.size) ** 2 / 4)
    nulls -= (nulls @ share / share.sum())[:, None]
    centred = mean - np.average(mean, weights=share)
    norm = np.sqrt((nulls**2 @ share) * (centred**2 @ share))
    match = (nulls * centred) @ share / norm
    return float(lengths[match.argmax()]), float(match.max())
