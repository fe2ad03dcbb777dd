"""One star made of many: the PSF of a field, on the detector's own pixels.

Every star samples the PSF at a phase of its own.  Where the detector resolves the optics, a shift by
a fraction of a pixel is a phase ramp in the spectrum, so stars are shifted onto each other exactly and
averaged; nothing is interpolated.  :func:`common_moments` says what the stars' shapes have in common, and
how far they scatter about it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from jitterkit.errors import ErrorCode, UndeterminedError
from jitterkit.frames import Frame
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


_OUTLIER = 25.0
"""Squared distance, of three degrees of freedom, beyond which a star is a blend: 2e-5 by chance."""

_WIDER = 1.3
"""Of the smallest stars' variance across their axis: what is wider is a galaxy or a blend.  Trails and coma
lengthen stars and leave their width."""

_COLLAPSED = 0.4
"""Share of the stars whose weight shrinks to nothing from which the sampling is too coarse: 0.7 to 0.9 of
normal stars of FWHM 1.6 to 1.4 pixels, a tenth of those of 1.8."""

_PASSES = 20

_ALIKE = 0.4, 0.15
"""Scatter of the elongation and of the size, as shares of either, below which few stars are alike."""

_LEAST = 3
"""Stars from which a scatter can be determined, and one distinguished from the rest."""


class Common(NamedTuple):
    """Return the mean of the moments of a field.

    Attributes
    ----------
    moments : (3,) array
        [pixels²]
    covariance : (3, 3) array
        Of the mean; noise and scatter [pixels⁴].
    scatter : (3, 3) array
        Covariance from star to star beyond the noise [pixels⁴].
    used : (n,) bool array
        Stars that agree; the rest are blends, galaxies and worse.
    agree : bool
        Whether these are two or more and scatter by less than 0.4 of their own elongation and 0.15 of their
        size, noise included: so alike are few galaxies or speckles.
    chi2 : float
        Of equal moments, noise alone; its expectation is ``dof`` if they are.
    dof : int
    """

    moments: np.ndarray
    covariance: np.ndarray
    scatter: np.ndarray
    used: np.ndarray
    agree: bool
    chi2: float
    dof: int


def common_moments(moments: Moments) -> Common:
    """Average the moments of a field.

    Parameters
    ----------
    moments : Moments

    Returns
    -------
    common : Common
        Weights are inverse variances, of noise plus scatter, so that a few bright stars do not speak
        for a field that varies.

    Raises
    ------
    UndeterminedError
        If no star is sound, or many are too sharp for their pixels (code ``sampling``).
    """
    collapsed, n = int(np.sum(~np.isfinite(moments.moments).all(1))), len(moments.moments)
    if collapsed > _COLLAPSED * n:
        why = "narrower than a FWHM of some 1.8 pixels, their shapes cannot be measured"
        remedy = "use finer sampling, or known optics with --instrument"
        problem = f"{collapsed} of {n} stars are undersampled: {why}; {remedy}."
        raise UndeterminedError(ErrorCode.SAMPLING, problem)
    values, noise, used = moments.moments, moments.covariance, _narrow(moments)
    if not used.any():
        problem = "No isolated star has a measurable shape; expose longer or give a larger frame."
        raise UndeterminedError(ErrorCode.TOO_FEW_STARS, problem)
    mean, scatter = np.median(values[used], axis=0), np.zeros((3, 3))
    several = used.sum() >= _LEAST
    if several:
        scatter = np.diag((1.4826 * np.median(np.abs(values[used] - mean), axis=0)) ** 2)
    sized = used
    for _ in range(_PASSES):
        weight = np.linalg.inv(np.where(sized[:, None, None], noise, np.eye(3)) + scatter)
        if several:
            distance = np.einsum("na,nab,nb->n", values - mean, weight, values - mean)
            used = sized & (distance < _OUTLIER)
        covariance = np.linalg.inv(weight[used].sum(0))
        mean = covariance @ np.einsum("nab,nb->a", weight[used], values[used])
        if several:
            scatter = _scatter(values[used] - mean, noise[used], scatter)
    residual = values[used] - mean
    chi2 = float(np.einsum("na,nab,nb->", residual, np.linalg.inv(noise[used]), residual))
    share = 1 / np.trace(noise[used] + scatter, axis1=1, axis2=2)
    agree = _agree(values[used], share) and bool(used.sum() > moments.sound.sum() / 2)
    return Common(mean, covariance, scatter, used, agree, chi2, 3 * (int(used.sum()) - 1))


def _narrow(moments: Moments) -> np.ndarray:
    """Return which sound stars (n,) are as narrow as the narrowest that crowd together."""
    width = np.linalg.eigvalsh(moments.moments[:, [0, 1, 1, 2]].reshape(-1, 2, 2)[moments.sound])[:, 0]
    if len(width) < 2 * _LEAST:
        return moments.sound.copy()
    ordered = np.log(np.maximum(np.sort(width), np.finfo(float).tiny))
    crowd = max(_LEAST, len(width) // 4)
    spans = ordered[crowd - 1 :] - ordered[: len(ordered) - crowd + 1]
    typical = np.exp(ordered[np.argmin(spans) + crowd // 2])
    noise = np.sqrt(np.trace(moments.covariance[moments.sound], axis1=1, axis2=2) / 3)
    narrow = moments.sound.copy()
    narrow[moments.sound] = width < _WIDER * typical + np.sqrt(_OUTLIER) * noise
    return narrow


def _agree(values: np.ndarray, weights: np.ndarray) -> bool:
    """Return whether moments (n, 3) are alike in elongation and size."""
    n = len(values)
    if n < 2:
        return False
    # elongation by its two components, and size
    shapes = values @ np.array([[1.0, 0.0, -1.0], [0.0, 2.0, 0.0], [1.0, 0.0, 1.0]]).T
    mean = np.average(shapes, axis=0, weights=weights)
    spread = np.average((shapes - mean) ** 2, axis=0, weights=weights) * n / (n - 1)
    alike = np.sqrt([spread[:2].sum(), spread[2]]) < np.multiply(_ALIKE, [np.hypot(*mean[:2]), mean[2]])
    return bool(alike.all())


def _scatter(residual: np.ndarray, noise: np.ndarray, before: np.ndarray) -> np.ndarray:
    """Return the covariance of residuals (n, 3) beyond their noise, without its negative part."""
    n = len(residual)
    share = 1 / (np.trace(noise, axis1=1, axis2=2) + np.trace(before)) ** 2
    outer = residual[:, :, None] * residual[:, None, :] * n / max(n - 1, 1)
    excess = np.einsum("n,nab->ab", share / share.sum(), outer - noise)
    size, axes = np.linalg.eigh(excess)
    return (axes * np.clip(size, 0, None)) @ axes.T
