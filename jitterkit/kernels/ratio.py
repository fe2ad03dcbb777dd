"""The blur's transfer function as an image shows it, along a direction: for pictures of a fit.

The modulus of an image's spectrum over that of the same scene without blur is the modulus of the blur's
transfer function, whatever the scene.  :func:`transfer_ratio` measures it in bins along an axis, and
averages a model in the same bins with the same weights, so that the two can be laid over each other.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import fft
from scipy.signal.windows import hann

from jitterkit.errors import ConfigurationError, ErrorCode, UndeterminedError

_WEDGE = 20.0
"""Degrees on either side of the axis: wide enough for a few frequencies a bin, and a linear streak's
``sinc`` is known to cos 20° = 0.94 of its argument."""

_LEAST_SNR = 4.0
"""Power of the unblurred scene over the noise's in a bin that is shown."""


@dataclass(frozen=True)
class TransferRatio:
    """Modulus of a blur's transfer function along an axis.

    Attributes
    ----------
    angle : float
        Of the axis, degrees counter-clockwise from +x.
    frequency : (n,) array
        Middle of each bin that the noise leaves, cycles/arcsec.
    measured, error : (n,) array
        The ratio and its standard error.
    fitted : (n,) array or None
        The model in the same bins.
    """

    angle: float
    frequency: np.ndarray
    measured: np.ndarray
    error: np.ndarray
    fitted: np.ndarray | None = None


def transfer_ratio(
    image: np.ndarray,
    template: np.ndarray,
    plate_scale: float,
    angle: float,
    *,
    variance: np.ndarray | float = 0.0,
    transfer: Callable | None = None,
    bins: int = 24,
) -> TransferRatio:
    """Measure the modulus of a blur's transfer function along an axis.

    Parameters
    ----------
    image : (ny, nx) array
        The blurred scene, without holes: fill masked pixels with a model and give them no variance.
    template : (ny, nx) array
        The same scene without blur, in the same place.
    plate_scale : float
        arcsec per pixel.
    angle : float
        Of the axis, degrees counter-clockwise from +x.
    variance : (ny, nx) array or float
        Of the image's noise.
    transfer : callable, optional
        ``M(fx, fy)`` of a model, a locus's ``transfer``.  Both curves then have the same mean level, for
        the template's flux need not be the image's.
    bins : int
        Between zero and the Nyquist frequency.

    Returns
    -------
    ratio : TransferRatio
        A bin's ratio is the root of the sum of powers (less the noise's) over the template's.

    Raises
    ------
    ConfigurationError
        If the shapes disagree or a pixel is not finite.
    UndeterminedError
        If no bin rises above the noise.

    Notes
    -----
    Hann-windowed.  *Assumes* noise that is independent from pixel to pixel.  The errors are first order in
    it and know that window and stars tie the frequencies of a bin together; those of different bins are
    tied too: what they share goes into the common level, and the errors are then up to twice too large.
    """
    image, template = np.asarray(image, float), np.asarray(template, float)
    if image.shape != template.shape:
        problem = f"Image and template must be of one shape; got {image.shape} and {template.shape}."
        raise ConfigurationError(ErrorCode.WRONG_SHAPE, problem)
    if bad := np.count_nonzero(~(np.isfinite(image) & np.isfinite(template))):
        problem = f"Image or template is not finite in {bad} of {image.size} pixels"
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, f"{problem}; cut them away or fill them.")
    window = np.outer(*(hann(n, sym=False) for n in image.shape))
    windowed = np.broadcast_to(variance, image.shape) * window**2
    noise = float(windowed.sum())
    transform, reference = fft.fft2(image * window), np.abs(fft.fft2(template * window)) ** 2
    frequencies, bin_of = _bins(image.shape, plate_scale, angle, bins)

    def summed(values) -> np.ndarray:
        return np.bincount(bin_of[bin_of >= 0], values[bin_of >= 0], bins)

    expected, number = summed(reference), summed(np.ones(image.shape))
    signal = summed(np.abs(transform) ** 2) - noise * number
    shown = expected > np.maximum(_LEAST_SNR * noise * number, 1e-12 * expected.max(initial=0.0))
    if not shown.any():
        problem = f"No frequency along the axis at {angle:g} degrees rises above the noise"
        raise UndeterminedError(ErrorCode.NO_SIGNAL, f"{problem}; expose longer or stack frames.")
    spread = np.array([_spread(np.where(bin_of == b, transform, 0), windowed) for b in np.flatnonzero(shown)])
    signal, expected = np.maximum(signal[shown], 0), expected[shown]
    measured = np.sqrt(signal / expected)
    error = spread / (2 * np.sqrt(np.maximum(signal, spread) * expected) + np.finfo(float).tiny)
    middle = (np.arange(bins)[shown] + 0.5) * 0.5 / plate_scale / bins
    if transfer is None:
        return TransferRatio(angle, middle, measured, error)
    model = np.abs(np.asarray(transfer(*frequencies))) ** 2 * np.ones(image.shape)
    fitted = np.sqrt(summed(reference * model)[shown] / expected)
    level = np.sum(expected * fitted * measured) / np.sum(expected * fitted**2)
    if not level > 0:
        problem = f"The image holds no more power along the axis at {angle:g} degrees than its noise"
        raise UndeterminedError(ErrorCode.NO_SIGNAL, f"{problem}; expose longer or stack frames.")
    return TransferRatio(angle, middle, measured / level, error / level, fitted)


def _bins(shape, plate_scale: float, angle: float, bins: int):
    """Frequencies ``(fx, fy)`` and the bin of each (ny, nx): -1 off the axis, and for the mirror half."""
    fy, fx = (fft.fftfreq(n, plate_scale) for n in shape)
    fx, fy = fx[None, :], fy[:, None]
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    along, across = c * fx + s * fy, c * fy - s * fx
    number = np.floor(np.hypot(fx, fy) * 2 * plate_scale * bins).astype(int)
    chosen = (along > 0) & (np.abs(across) <= np.tan(np.radians(_WEDGE)) * along) & (number < bins)
    return (fx, fy), np.where(chosen, number, -1)


def _spread(transform: np.ndarray, variance: np.ndarray) -> float:
    """Standard error of the sum of powers of part of a spectrum (ny, nx), from the windowed variance.

    To first order the sum changes by ``2 Re(conj(D) dD)``, which is linear in the pixels.
    """
    weights = 2 * fft.fft2(np.conj(transform)).real
    return float(np.sqrt(np.sum(variance * weights**2)))
