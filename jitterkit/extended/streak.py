"""How a blind method says what it found: a length and an angle become a :class:`KernelEstimate`.

Reach for :func:`streak_estimate` at the end of a method; :func:`transfer_squared` is the pattern of nulls
that all of them look for, and :func:`apart` the distance between two streaks.
"""

from __future__ import annotations

import numpy as np

from jitterkit.conventions import axis_angle
from jitterkit.extended.spectrum import PowerSpectrum
from jitterkit.kernel_estimate import KernelEstimate
from jitterkit.loci import Linear, covariance_on_axis


def streak_estimate(
    length: float, angle: float, method: str, *, along: float, across: float, plate_scale: float
) -> KernelEstimate:
    """Report a uniform streak.

    Parameters
    ----------
    length : float
        Pixels.
    angle : float
        Degrees counter-clockwise from +x.
    method : str
    along, across : float
        Standard errors of the streak's end along and across it, pixels: of the length, and of the length
        times the angle.
    plate_scale : float
        Arcsec/pixel.

    Returns
    -------
    estimate : KernelEstimate
        The moments and their covariance to first order in the errors.
    """
    # along itself a streak's moments are (L²/12, 0, 0); turned by da, they gain a cross moment of L²/12 da
    own = np.diag([2 * along, across, 0.0]) * length / 12
    covariance = covariance_on_axis(own**2, -angle)
    # to first order a streak stays one; across it the moments are uncertain to second order
    covariance += np.eye(3) * ((along**2 + across**2) / 12) ** 2
    locus = Linear.of(length * plate_scale, axis_angle(angle))
    return KernelEstimate(np.asarray(locus.moments()), covariance * plate_scale**4, method, locus=locus)


def transfer_squared(spectrum: PowerSpectrum, length: float, angle: float) -> np.ndarray:
    """Squared transfer function (ny, nx) of a streak of ``length`` pixels."""
    x, y = length * np.cos(np.radians(angle)), length * np.sin(np.radians(angle))
    return np.sinc(np.float32(x) * spectrum.fx + np.float32(y) * spectrum.fy) ** 2


def apart(length, angle, other_length, other_angle):
    """Distance [pixels] between the ends of two streaks with a common beginning; they have no direction."""
    one = length * np.exp(1j * np.radians(angle))
    two = other_length * np.exp(1j * np.radians(other_angle))
    return np.minimum(np.abs(one - two), np.abs(one + two))
