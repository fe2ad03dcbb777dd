"""Bias frames: the level of an unexposed pixel, and the noise of reading it.

Reach for :func:`bias_map` and :func:`read_noise_map`.
"""

from __future__ import annotations

import numpy as np

from jitterkit.calibration.master import Master
from jitterkit.calibration.measured_map import MeasuredMap

NOISY = 5.0
"""Times the usual read noise from which a pixel is called noisy: one of 25 times the variance."""


def bias_map(master: Master, good: np.ndarray) -> MeasuredMap:
    """The mean reading of each pixel.

    Parameters
    ----------
    master : Master
        Of bias frames.
    good : (ny, nx) bool array

    Returns
    -------
    bias : MeasuredMap
        ADU.
    """
    variance, _ = master.typical_variance(good)
    values = master.mean[good]
    error = (max(variance + master.rounding, 0.0) / master.frames) ** 0.5
    return MeasuredMap(
        "bias",
        "ADU",
        master.mean,
        error,
        float(values.mean()),
        error / values.size**0.5,
        float(values.std()),
        master.frames,
    )


def noisy_pixels(master: Master, times: float = NOISY) -> np.ndarray:
    """Pixels whose noise is several times that of the pixels around them.

    Parameters
    ----------
    master : Master
    times : float

    Returns
    -------
    noisy : (ny, nx) bool array
    """
    noisy: np.ndarray = master.variance > times**2 * master.usual
    return noisy


def read_noise_map(master: Master, good: np.ndarray, gain: float, gain_error: float = 0.0) -> MeasuredMap:
    """The noise of reading each pixel.

    Parameters
    ----------
    master : Master
        Of bias frames.
    good : (ny, nx) bool array
    gain, gain_error : float
        e-/ADU.

    Returns
    -------
    read_noise : MeasuredMap
        e-, without the rounding to whole ADU.  The square of a pixel is unbiased, and zero where it would be
        negative; the number is the root of the mean square.

    Notes
    -----
    *Fails when* the noise is less than 0.5 ADU and all pixels have one bias: readings then go in steps.
    """
    variance, variance_error = master.typical_variance(good)
    variance, usual = max(variance, 0.0), max(variance, 1e-12)
    squares = np.maximum(master.variance - master.rounding, 0.0) * gain**2
    number = variance**0.5 * gain
    relative = float(np.hypot(variance_error / usual / 2, gain_error / gain))
    # of one pixel: what chi square does to a root, rounding's share of the variance included
    error = number * (variance + master.rounding) / usual / (2 * (master.frames - 1)) ** 0.5
    spread = float(np.std(squares[good], dtype=float)) / max(2 * number, 1e-12)
    values = np.sqrt(squares)
    return MeasuredMap("read_noise", "e-", values, error, number, number * relative, spread, master.frames)
