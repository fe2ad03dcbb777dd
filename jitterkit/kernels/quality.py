"""How good a kernel is, in a few numbers: reach for :func:`kernel_quality`.

A kernel is a density, so it sums to one and is nowhere negative; what an estimator or a drawing adds to
that (fringes, detached bumps, a displaced centre, a transfer function of its own) shows in these numbers.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.kernels.image import kernel_moments
from jitterkit.loci import Locus, Mvn
from jitterkit.vision import components

_CORE = 0.01
"""A normal kernel holds 99 % of itself within its 1 % contour, whatever its size and shape."""

_FREQUENCIES = 65
"""Samples along each axis of the band on which transfer functions are compared."""


@dataclass(frozen=True)
class KernelQuality:
    """Numbers about a kernel.

    Attributes
    ----------
    sum : float
        One, or the image it is convolved with changes its flux by as much.
    negativity : float
        Sum of the negative pixels over the sum of all, both in absolute value: zero for a density,
        0.5 where as much is taken as given.
    ringing : float
        Share of the absolute values outside the core: the connected pixels about the peak that exceed
        1 % of it.  0.01 for a normal, zero for a streak.
    offset : (float, float)
        Centroid ``(x, y)`` from the middle pixel, pixels of the kernel: by so much everything moves.
    moments : (3,) array
        ``(Sxx, Sxy, Syy)`` about the centroid, arcsec².
    otf_rms, otf_max : float
        Root mean square and largest difference of its transfer function from the reference's, within the
        band; NaN without a reference.
    """

    sum: float
    negativity: float
    ringing: float
    offset: tuple[float, float]
    moments: np.ndarray
    otf_rms: float = float("nan")
    otf_max: float = float("nan")


def kernel_quality(
    kernel: np.ndarray,
    plate_scale: float,
    reference: Locus | np.ndarray | None = None,
    *,
    cutoff: float | None = None,
) -> KernelQuality:
    """Measure a kernel.

    Parameters
    ----------
    kernel : (ny, nx) array
        Odd sides.
    plate_scale : float
        arcsec per pixel of the kernel.
    reference : Locus, (3,) array or (my, mx) array, optional
        What it should be: a locus, second moments [arcsec²] of a normal, or another kernel on pixels
        of the same size.
    cutoff : float, optional
        The band's limit, cycles/arcsec: beyond the optics' own an image tells nothing of a kernel.  By
        default the Nyquist frequency of the pixels.

    Returns
    -------
    quality : KernelQuality

    Raises
    ------
    ConfigurationError
        If a kernel has even sides, values that are not finite or no positive sum.

    Notes
    -----
    The transfer functions compared are divided by their values at zero frequency, about the middle pixel:
    a displaced kernel differs from a centred one.
    """
    kernel = _checked(kernel)
    total, absolute = float(kernel.sum()), float(np.abs(kernel).sum())
    y, x = (np.arange(n) - n // 2 for n in kernel.shape)
    rms, most = (np.nan, np.nan) if reference is None else _misfit(kernel, reference, plate_scale, cutoff)
    return KernelQuality(
        sum=total,
        negativity=float(-kernel[kernel < 0].sum()) / absolute,
        ringing=1 - float(np.abs(kernel[_core(kernel)]).sum()) / absolute,
        offset=(float(kernel.sum(0) @ x) / total, float(kernel.sum(1) @ y) / total),
        moments=kernel_moments(kernel, plate_scale),
        otf_rms=rms,
        otf_max=most,
    )


def kernel_transfer(kernel: np.ndarray, plate_scale: float, fx: np.ndarray, fy: np.ndarray) -> np.ndarray:
    """Return the transfer function of a kernel about its middle pixel.

    Parameters
    ----------
    kernel : (ny, nx) array
    plate_scale : float
        arcsec per pixel of the kernel.
    fx : (mx,) array
    fy : (my,) array
        Frequencies, cycles/arcsec.

    Returns
    -------
    transfer : (my, mx) complex array
        One at zero frequency.
    """
    y, x = ((np.arange(n) - n // 2) * plate_scale for n in kernel.shape)
    rows = np.exp(-2j * np.pi * np.multiply.outer(fy, y))
    columns = np.exp(-2j * np.pi * np.multiply.outer(x, fx))
    return rows @ kernel @ columns / kernel.sum()


def _checked(kernel) -> np.ndarray:
    kernel = np.asarray(kernel, float)
    if kernel.ndim != 2 or kernel.shape[0] % 2 == 0 or kernel.shape[1] % 2 == 0:
        problem = f"A kernel is an image with odd sides, got shape {kernel.shape}."
        raise ConfigurationError(ErrorCode.WRONG_SHAPE, problem)
    if not (np.all(np.isfinite(kernel)) and kernel.sum() > 0):
        problem = f"A kernel is finite with a positive sum; this one sums to {kernel.sum()}."
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, problem)
    return kernel


def _core(kernel: np.ndarray) -> np.ndarray:
    """Return the pixels that hang together with the peak."""
    labels = components(kernel > _CORE * kernel.max()).labels
    return labels == labels.ravel()[kernel.argmax()]


def _misfit(kernel, reference, plate_scale: float, cutoff: float | None) -> tuple[float, float]:
    limit = 0.5 / plate_scale if cutoff is None else min(cutoff, 0.5 / plate_scale)
    f = np.linspace(-limit, limit, _FREQUENCIES)
    fx, fy = np.meshgrid(f, f)
    band = np.hypot(fx, fy) <= limit
    if not isinstance(reference, Locus) and np.ndim(reference) == 2:
        expected = kernel_transfer(_checked(reference), plate_scale, f, f)
    else:
        locus = reference if isinstance(reference, Locus) else Mvn.near(reference)
        expected = np.asarray(locus.transfer(fx, fy))
    difference = np.abs(kernel_transfer(kernel, plate_scale, f, f) - expected)[band]
    return float(np.sqrt(np.mean(difference**2))), float(difference.max())
