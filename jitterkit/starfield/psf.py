"""One star made of many: the PSF of a field, on the detector's own pixels.

Every star samples the PSF at a phase of its own.  Where the detector resolves the optics, a shift by
a fraction of a pixel is a phase ramp in the spectrum, so stars are shifted onto each other exactly and
averaged; nothing is interpolated.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jitterkit.errors import ErrorCode, UndeterminedError
from jitterkit.frames import Frame
from jitterkit.starfield.common import common_moments
from jitterkit.starfield.detect import find_stars
from jitterkit.starfield.moments import Moments, Stars, adaptive_moments

_ROUNDS = 3
"""Passes in which pixels that a star lacks are filled with what the others show there."""


@dataclass(frozen=True, eq=False)
class Psf:
    """A mean star.

    Attributes
    ----------
    stamp : (s, s) array
        Centred on its middle pixel, sum one.
    error : (s, s) array
        Its standard error, from photon and sky noise.
    moments, covariance : (3,) and (3, 3) array
        Adaptive moments that the stars have in common, with their scatter [pixels², pixels⁴].
    stars : int
        How many went into it.
    """

    stamp: np.ndarray
    error: np.ndarray
    moments: np.ndarray
    covariance: np.ndarray
    stars: int


def field_psf(frame: Frame, *, half: int | None = None) -> Psf:
    """Make the PSF of a sharp frame from its stars.

    Parameters
    ----------
    frame : Frame
    half : int, optional
        Half width of the stamp [pixels]; from the size of the stars if omitted.

    Returns
    -------
    psf : Psf

    Raises
    ------
    UndeterminedError
        If no isolated star can be measured.
    """
    stars = find_stars(frame, half=half)
    return stack_psf(stars, adaptive_moments(stars))


def stack_psf(stars: Stars, moments: Moments) -> Psf:
    """Average stars into one PSF.

    Parameters
    ----------
    stars : Stars
    moments : Moments
        Theirs.  Stars whose moments disagree with the rest are left out.

    Returns
    -------
    psf : Psf

    Raises
    ------
    UndeterminedError
        If no star can be measured, or they hold no light.

    Notes
    -----
    The least-squares estimate: each star, shifted to the middle, weighs with its flux over the noise of its
    core squared, ``sum w f I / sum w f²``.  Pixels not used are filled with the mean of the others,
    twice over.

    *Assumes* one PSF over the field.  *Fails when* the detector undersamples it (FWHM below two pixels):
    the shift then rings.
    """
    common = common_moments(moments)
    stars, moments = stars.chosen(common.used), moments.chosen(common.used)
    flux = moments.flux
    filled = np.where(stars.used, stars.electrons, 0.0)
    light = np.clip(filled, 0, None)
    variance = stars.variance
    # over the mean variance where the star is: of its photons and of the sky under it
    weight = flux * np.sum(light, axis=(1, 2)) / np.sum(variance * light, axis=(1, 2))
    total = np.sum(weight * flux)
    mean = np.zeros(filled.shape[1:])
    for _ in range(_ROUNDS):
        mean = np.tensordot(weight, _shifted(filled, -moments.centre), 1) / total
        model = flux[:, None, None] * _shifted(np.broadcast_to(mean, filled.shape), moments.centre)
        filled = np.where(stars.used, stars.electrons, model)
    whole = float(mean.sum())
    if not whole > 0:
        problem = f"The stacked stars ({len(stars)}) hold no light above their surroundings"
        raise UndeterminedError(ErrorCode.NO_SIGNAL, f"{problem}; they are no stars.")
    error = np.sqrt(np.tensordot(weight**2, np.where(stars.used, variance, 0.0), 1)) / total
    return Psf(mean / whole, error / whole, common.moments, common.covariance, len(stars))


def _shifted(images: np.ndarray, by: np.ndarray) -> np.ndarray:
    """Images ``(n, s, s)`` moved by ``(n, 2)`` pixels in x and y, by a phase ramp on a padded grid."""
    side = images.shape[-1]
    wide = 2 * side
    fy, fx = np.fft.fftfreq(wide)[:, None], np.fft.rfftfreq(wide)
    x, y = by[:, 0, None, None], by[:, 1, None, None]
    spectrum = np.fft.rfft2(images, s=(wide, wide)) * np.exp(-2j * np.pi * (fx * x + fy * y))
    return np.fft.irfft2(spectrum, s=(wide, wide))[:, :side, :side]
