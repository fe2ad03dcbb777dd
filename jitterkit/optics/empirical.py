"""A measured PSF instead of a pupil: a sharp frame or a star stack.

For instruments nobody has modelled.  It knows no aberrations and no wavelength, and its noise is
carried into every image made from it; where there is a pupil, use the pupil.
"""

from __future__ import annotations

import math

import jax.numpy as jnp
import numpy as np

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.optics.grid import DEFAULT_PAD, Grid
from jitterkit.optics.otf import OTF


def empirical_otf(
    psf: np.ndarray,
    plate_scale: float,
    shape: tuple[int, int],
    *,
    centre: tuple[float, float] | None = None,
    oversample: int = 1,
    enclosed: float = 1.0,
    pad: int = DEFAULT_PAD,
) -> OTF:
    """Return the transfer function of an unblurred star image.

    Parameters
    ----------
    psf : (ny, nx) array
        One star, background subtracted; any size, odd or even.  Each sample is the light of one whole pixel
        that is centred there, as in an image or an effective PSF.  Its sum is taken out.
    plate_scale : float
        arcsec per pixel of the frames.
    shape : (int, int)
        Frame to be modelled, ``(ny, nx)``.
    centre : (float, float), optional
        Where the star is in the stamp, ``(x, y)`` in samples from the centre of the first; the centroid
        if omitted.  An error moves every fitted position by as much and no separation.
    oversample : int
        Samples of the stamp per pixel, along each axis.
    enclosed : float
        Share of the star's light inside the stamp; with 1, ``flux`` means the light inside a stamp of this
        size.
    pad : int
        Pixels of padding on each side of the frame, at least; more if the stamp needs it.

    Returns
    -------
    otf : OTF
        Has no aberrations, and holds the pixel already.  A star at the frame's centre reproduces a
        stamp that is centred on it.

    Raises
    ------
    ConfigurationError
        If the stamp is not a finite image with a positive sum, the centre lies outside it, or a number is
        impossible.

    Notes
    -----
    Assumes light beyond the stamp is zero: a step at its edge appears as a step in every image, so
    subtract the background and taper, or take a larger stamp.  Fails when the stamp undersamples the optics
    (cutoff above Nyquist of its samples): then it does not determine the image between them, and shifts by a
    fraction of a sample ring.  A detector that undersamples needs an oversampled stamp.
    """
    stamp = _checked(psf)
    x, y = _centroid(stamp) if centre is None else centre
    if not (-0.5 <= x <= stamp.shape[1] - 0.5 and -0.5 <= y <= stamp.shape[0] - 0.5):
        problem = f"The star's centre ({x:.6g}, {y:.6g}) lies outside the stamp of {stamp.shape}"
        remedy = "give (x, y) in pixels inside it, or leave it out"
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, f"{problem}; {remedy}.")
    if oversample < 1 or not 0 < enclosed <= 1:
        problem = f"oversample = {oversample} and enclosed = {enclosed} need 1 or more samples per pixel"
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, f"{problem}, and a share from 0 to 1.")
    reach = max(math.ceil((s / oversample - n) / 2) for s, n in zip(stamp.shape, shape, strict=True))
    grid = Grid((shape[0], shape[1]), plate_scale, max(pad, reach), oversample)
    fy, fx = grid.frequencies
    spectrum = np.fft.rfft2(stamp * (enclosed / stamp.sum()), s=grid.fine_shape)
    spectrum = spectrum * np.exp(2j * np.pi * grid.pitch * (y * fy + x * fx))
    return OTF(
        jnp.asarray(spectrum), jnp.zeros((0, 2, *spectrum.shape)), jnp.zeros(0), grid, (), pixel_included=True
    )


def _checked(psf) -> np.ndarray:
    stamp = np.asarray(psf, dtype=float)
    if stamp.ndim != 2 or stamp.size == 0:
        problem = f"An empirical PSF is one image (ny, nx), got an array of shape {stamp.shape}."
        raise ConfigurationError(ErrorCode.WRONG_SHAPE, problem)
    missing = np.count_nonzero(~np.isfinite(stamp))
    if missing:
        problem = f"The empirical PSF holds {missing} NaN or infinite pixels"
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, f"{problem}; interpolate over them first.")
    if not stamp.sum() > 0:
        problem = f"The empirical PSF sums to {stamp.sum():.4g}, and must be positive"
        remedy = "subtract the background level, not more"
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, f"{problem}; {remedy}.")
    return stamp


def _centroid(stamp):
    """Return the mean position ``(x, y)`` of the light, in pixels."""
    rows, columns = np.indices(stamp.shape)
    return tuple(float(np.sum(axis * stamp) / stamp.sum()) for axis in (columns, rows))
