"""A blur as a centred kernel for tools that convolve: reach for :func:`kernel_image`.

A raster of the time spent on each pixel (:func:`jitterkit.loci.rasterise`) is right for a picture and
wrong for a convolution: up to a fifth of a pixel squared of variance is lost or added, more than many a
jitter has.  Here the kernel's transfer function follows the locus's own over the band that pixels carry,
and sum, centre and second moments are exact whatever the size of the pixels.  The price is that of
every band-limited drawing: a streak much thinner than a pixel has negative fringes.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.fft import next_fast_len

from jitterkit.errors import ConfigurationError, ErrorCode, UndeterminedError
from jitterkit.kernel_estimate import KernelEstimate
from jitterkit.loci import Locus, Mvn, principal_axes

_MARGIN = 4
"""Pixels about the locus: with 2, 4 and 6 the transfer function of a tilted streak of one pixel is wrong by
0.015, 0.009 and 0.007 rms below 0.86 of the Nyquist frequency (rasterised: 0.10)."""

_POINTS = 65536


def kernel_image(
    blur: KernelEstimate | Locus,
    plate_scale: float,
    oversample: int = 1,
    shape: tuple[int, int] | None = None,
) -> np.ndarray:
    """Draw a blur on pixels so that convolving with the drawing blurs as the pointing did.

    Parameters
    ----------
    blur : KernelEstimate or Locus
        Of an estimate its locus is drawn; without one its kernel as it is; without either the normal
        with its moments (see :func:`locus_of`).
    plate_scale : float
        Of the detector, arcsec per pixel.
    oversample : int
        Kernel pixels per detector pixel along each axis, for tools that blur before they bin.
    shape : (int, int), optional
        ``(ny, nx)``, both odd.  By default the smallest square with four pixels to spare.

    Returns
    -------
    kernel : (ny, nx) array
        Centred on its middle pixel; sums to one; second moments about that pixel are the locus's.

    Raises
    ------
    ConfigurationError
        If a side is even or too short, a scale is not positive, or a kernel known on detector pixels
        only is to be oversampled; the message gives the value received.
    UndeterminedError
        If an estimate of moments alone has no positive variance.

    Notes
    -----
    The inverse Fourier transform of ``M(f)`` up to the pixels' Nyquist frequency, cut to its shape, with
    the least change (in squares) that makes sum, centroid and second moments exact.  No kernel without
    negative pixels has the moments of a tilted streak much thinner than a pixel.  *Assumes* an image that
    the pixels sample: for an undersampled one, oversample.
    """
    if not (math.isfinite(plate_scale) and plate_scale > 0 and oversample >= 1):
        needs = "A kernel needs a positive plate scale and an oversampling of 1 or more"
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, f"{needs}; got {plate_scale} and {oversample}.")
    if shape is not None and (len(shape) != 2 or min(shape) < 1 or shape[0] % 2 == 0 or shape[1] % 2 == 0):
        problem = f"A kernel's sides must be odd, so that its centre is a pixel; got {shape}."
        raise ConfigurationError(ErrorCode.WRONG_SHAPE, problem)
    if isinstance(blur, KernelEstimate) and blur.locus is None and blur.kernel is not None:
        return _as_it_is(blur.kernel, oversample, shape)
    locus = blur if isinstance(blur, Locus) else locus_of(blur)[0]
    return _drawn(locus, plate_scale / oversample, shape)


def locus_of(estimate: KernelEstimate) -> tuple[Locus, str]:
    """Return the locus that stands for an estimate, and a remark where it is not quite what was measured.

    Parameters
    ----------
    estimate : KernelEstimate

    Returns
    -------
    locus : Locus
        The estimate's own, or the normal with its moments.
    remark : str
        Says that a negative variance was set to zero; empty otherwise.

    Raises
    ------
    UndeterminedError
        If neither axis has a positive variance: noise about no jitter.
    """
    if estimate.locus is not None:
        return estimate.locus, ""
    sxx, sxy, syy = (float(s) for s in estimate.moments)
    major, minor, angle = principal_axes(estimate.moments)
    if not major > 0:
        moments = f"The moments ({sxx:.3g}, {sxy:.3g}, {syy:.3g}) arcsec²"
        problem = f"{moments} have no positive variance along any axis"
        remedy = "the image shows no blur, and there is no kernel to draw"
        raise UndeterminedError(ErrorCode.NO_SIGNAL, f"{problem}: {remedy}.")
    clipped = sxx * syy < sxy**2
    remark = "the variance along the minor axis was negative and is set to zero" if clipped else ""
    return Mvn.of(major, minor, angle), remark


def kernel_moments(kernel: np.ndarray, pixel: float = 1.0) -> np.ndarray:
    """Second moments ``(Sxx, Sxy, Syy)`` of a kernel (ny, nx) about its centroid, in units of ``pixel²``."""
    y, x = (np.arange(n) - (n - 1) / 2 for n in kernel.shape)
    weights = kernel / kernel.sum()
    x, y = x - weights.sum(0) @ x, y - weights.sum(1) @ y
    return pixel**2 * np.array([weights.sum(0) @ x**2, y @ weights @ x, weights.sum(1) @ y**2])


def _as_it_is(kernel: np.ndarray, oversample: int, shape: tuple[int, int] | None) -> np.ndarray:
    if oversample != 1:
        problem = "This kernel is known on the detector's pixels only and cannot be oversampled"
        raise ConfigurationError(ErrorCode.UNSUPPORTED, f"{problem} by {oversample}; use 1.")
    kernel = np.asarray(kernel, float)
    if not (np.all(np.isfinite(kernel)) and kernel.sum() > 0):
        problem = f"The estimate's kernel sums to {kernel.sum():.3g}; a kernel is finite with a positive sum."
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, problem)
    shape = kernel.shape if shape is None else shape
    spare = [(n - m) // 2 for n, m in zip(shape, kernel.shape, strict=True)]
    if min(spare) < 0:
        problem = f"The kernel of {kernel.shape} does not fit into {shape}."
        raise ConfigurationError(ErrorCode.WRONG_SHAPE, problem)
    return np.pad(kernel / kernel.sum(), [(n, n) for n in spare])


def _drawn(locus: Locus, pixel: float, shape: tuple[int, int] | None) -> np.ndarray:
    reach = np.ceil(np.abs(locus.points(_POINTS)).max(0) / pixel - 1e-9).astype(int)[::-1]
    moments = np.asarray(locus.moments())
    if not np.all(np.isfinite(moments)):
        problem = f"The locus has the second moments {moments.tolist()} arcsec², which are not all finite"
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, f"{problem}; there is nothing to draw.")
    if shape is None:
        side = 2 * int(reach.max() + _MARGIN) + 1
        shape = (side, side)
    needs = tuple(int(n) for n in 2 * np.maximum(reach, 1) + 1)
    if shape[0] < needs[0] or shape[1] < needs[1]:
        problem = f"The locus does not fit into {shape}; it needs {needs} at least."
        raise ConfigurationError(ErrorCode.WRONG_SHAPE, problem)
    return _exact(_band_limited(locus, pixel, shape), moments / pixel**2)


def _band_limited(locus: Locus, pixel: float, shape: tuple[int, int]) -> np.ndarray:
    """The inverse transform of ``M`` over the pixels' band (ny, nx), from a plane three times as wide."""
    wide = [next_fast_len(3 * n) for n in shape]
    fy, fx = (np.fft.fftfreq(n, pixel) for n in wide)
    plane = np.fft.ifft2(np.asarray(locus.transfer(fx[None, :], fy[:, None])) * np.ones(wide)).real
    rows, columns = (np.arange(n) - n // 2 for n in shape)
    return plane[np.ix_(rows, columns)]


def _exact(kernel: np.ndarray, moments: np.ndarray) -> np.ndarray:
    """Return the nearest kernel (ny, nx) with sum one, centroid zero and these second moments [pixel²]."""
    y, x = np.meshgrid(*(np.arange(n) - n // 2 for n in kernel.shape), indexing="ij")
    laws = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y]).reshape(6, -1).astype(float)
    lacking = np.array([1.0, 0.0, 0.0, *moments]) - laws @ kernel.ravel()
    return kernel + (laws.T @ np.linalg.solve(laws @ laws.T, lacking)).reshape(kernel.shape)
