"""The power spectrum of a picture, made ready for the search for a blur's nulls.

A picture's spectrum falls by six decades from the middle to the corner and its noise does not; what a
blur adds are nulls.  Here is what all blind methods start from: :func:`power_spectrum`, and
:func:`whitened`, its logarithm with the scene's smooth fall taken away and the noise weighted down.
They end with :func:`streak_estimate`, by which a length and an angle become a :class:`KernelEstimate`;
:func:`apart` is the distance between two streaks.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import fft
from scipy.signal.windows import hann

from jitterkit.conventions import axis_angle
from jitterkit.errors import ConfigurationError, ErrorCode, UndeterminedError
from jitterkit.kernel_estimate import KernelEstimate
from jitterkit.loci import Linear, covariance_on_axis
from jitterkit.vision import box_mean

_LEAST_SIDE = 64
"""Pixels: of a smaller picture the Hann window leaves some 40, less than the nulls of a blur need."""

_FLOOR_QUANTILE = 0.02
"""Where the scene is weakest the noise is all there is: the power there, or less, is noise."""

_LEAST_SHARE = 0.16
"""Mean weight; of pure noise it is 0.09 to 0.14, of photographs at 30 decibels behind 40 pixels 0.21."""

_LEAST_RADIUS = 0.012
"""Cycles/pixel; below, the window leaks the picture's mean and its slope."""

_SCENE_SCALE = 8
"""Pixels: the whitening keeps what varies in the log spectrum faster than a blur of that length makes it."""


@dataclass(frozen=True, eq=False)
class PowerSpectrum:
    """Power of a windowed picture, zero frequency in the middle, in units of a pixel's variance.

    Attributes
    ----------
    power, local : (ny, nx) float32 arrays
        The power, and its mean over 7 x 7 frequencies.
    weight : (ny, nx) float32 array
        From 0, where nothing rises above the noise, to 1.
    fx, fy : (1, nx) and (ny, 1) float32 arrays
        Frequencies, cycles/pixel.
    noise : float
        Power of the white noise, at most.
    """

    power: np.ndarray
    local: np.ndarray
    weight: np.ndarray
    fx: np.ndarray
    fy: np.ndarray
    noise: float

    @property
    def shape(self) -> tuple[int, int]:
        """Return the shape of the picture, and of every array here."""
        ny, nx = self.power.shape
        return ny, nx


def power_spectrum(image: np.ndarray) -> PowerSpectrum:
    """Transform a Hann-windowed picture.

    Parameters
    ----------
    image : (ny, nx) array
        In any linear unit: neither a factor nor an offset matters.

    Raises
    ------
    ConfigurationError
        If it is no image, is smaller than 64 pixels a side, or has values that are not finite.
    UndeterminedError
        If it is constant, or nothing but noise.
    """
    array = np.asarray(image)
    check_image(array, _LEAST_SIDE)
    pixels = array.astype(float)
    pixels -= pixels.mean()
    spread = pixels.std()
    if not spread > 1e-9 * np.abs(array).max():
        problem = f"The image is constant ({float(array.flat[0]):g} everywhere)"
        raise UndeterminedError(ErrorCode.NO_SIGNAL, f"{problem}: it shows no scene, and no blur either.")
    window = np.outer(*(hann(n + 2)[1:-1] for n in array.shape))
    windowed = (pixels - np.average(pixels, weights=window)) * window / spread
    transform = fft.fftshift(fft.fft2(windowed))
    power = (np.abs(transform) ** 2 / (window**2).sum()).astype(np.float32)
    fy, fx = (fft.fftshift(fft.fftfreq(n)).astype(np.float32) for n in array.shape)
    radius = np.hypot(fx[None], fy[:, None])
    local = np.maximum(box_mean(power, 7), np.finfo(np.float32).tiny)
    noise = float(np.quantile(local, _FLOOR_QUANTILE))
    inside = (radius > _LEAST_RADIUS) & (radius < 0.5)
    weight = np.clip(1 - 1.5 * noise / local, 0, 1) * inside
    if weight.mean() < _LEAST_SHARE:
        share = f"a share of {weight.mean():.3f}, less than {_LEAST_SHARE:g}"
        problem = f"Too few frequencies of the image rise above white noise ({share}): it shows no scene."
        raise UndeterminedError(ErrorCode.NO_SIGNAL, problem)
    return PowerSpectrum(power, local, weight.astype(np.float32), fx[None], fy[:, None], noise)


def check_image(array: np.ndarray, least: int = 1) -> None:
    """Refuse what is no image (ny, nx) of finite numbers with a least number of pixels a side."""
    code = None
    if array.dtype.kind not in "buif":
        code = ErrorCode.WRONG_TYPE
    elif array.ndim != 2:
        code = ErrorCode.WRONG_SHAPE
    elif min(array.shape) < least:
        code = ErrorCode.TOO_FEW
    if code is not None:
        sides = f"(ny, nx) of numbers, at least {least} pixels a side"
        got = f"shape {array.shape} of type {array.dtype}"
        raise ConfigurationError(code, f"A blur is read from an image {sides}; got {got}.")
    if lost := int(np.sum(~np.isfinite(array))):
        problem = f"{lost} of {array.size} pixels of the image are not finite; cut them away or fill them."
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, problem)


def smoothed(values: np.ndarray, shape: tuple[int, int], length: float) -> np.ndarray:
    """Means over some two and a half periods of the nulls that a streak of ``length`` pixels makes."""
    box = (2 * int(1.2 * shape[0] / length) + 1, 2 * int(1.2 * shape[1] / length) + 1)
    return box_mean(box_mean(values, box), box)


def whitened(spectrum: PowerSpectrum) -> np.ndarray:
    """Return the logarithm of the power (ny, nx) less its smooth part, times the weight."""
    weight = spectrum.weight
    logarithm = weight * np.log(spectrum.power + np.float32(0.1 * spectrum.noise))
    smooth, share = (smoothed(a, spectrum.shape, _SCENE_SCALE) for a in (logarithm, weight))
    # deeper than e**-4 is the noise's tail, higher than e**2 a line in the scene
    return np.clip(logarithm - weight * smooth / np.maximum(share, 1e-4), -4, 2)


def streak_estimate(
    length: float, angle: float, method: str, errors: tuple[float, float], plate_scale: float
) -> KernelEstimate:
    """Report a uniform streak.

    Parameters
    ----------
    length : float
        Pixels.
    angle : float
        Degrees counter-clockwise from +x.
    method : str
    errors : (float, float)
        Standard errors of the streak's end along and across it, pixels: of the length, and of the length
        times the angle.
    plate_scale : float
        Arcsec/pixel.

    Returns
    -------
    estimate : KernelEstimate
        The moments and their covariance to first order in the errors.
    """
    along, across = errors
    # along itself a streak's moments are (L²/12, 0, 0); turned by da, they gain a cross moment of L²/12 da
    own = np.diag([2 * along, across, 0.0]) * length / 12
    covariance = covariance_on_axis(own**2, -angle)
    # to first order a streak stays one; across it the moments are uncertain to second order
    covariance += np.eye(3) * ((along**2 + across**2) / 12) ** 2
    locus = Linear.of(length * plate_scale, axis_angle(angle))
    return KernelEstimate(np.asarray(locus.moments()), covariance * plate_scale**4, method, locus=locus)


def apart(length, angle, other_length, other_angle):
    """Distance [pixels] between the ends of two streaks with a common beginning; they have no direction."""
    one = length * np.exp(1j * np.radians(angle))
    two = other_length * np.exp(1j * np.radians(other_angle))
    return np.minimum(np.abs(one - two), np.abs(one + two))
