"""Frames without light: level and noise of the bias, and the dark current with its hot pixels.

Reach for :func:`bias_map` and :func:`read_noise_map`, and for the dark current for :class:`DarkSlope`: give
it the masters one after the other, and ask it for the map.  It keeps sums only, so any number of exposure
times fits into memory.
"""

from __future__ import annotations

import numpy as np

from jitterkit.calibration.master import Master, MeasuredMap
from jitterkit.errors import ConfigurationError, ErrorCode

NOISY = 5.0
"""Times the usual read noise from which a pixel is called noisy: one of 25 times the variance."""


def bias_map(master: Master, good: np.ndarray) -> MeasuredMap:
    """Return the mean reading of each pixel.

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
    number, number_error, spread = float(values.mean()), error / values.size**0.5, float(values.std())
    return MeasuredMap("bias", "ADU", master.mean, error, number, number_error, spread, master.frames)


def read_noise_map(master: Master, good: np.ndarray, gain: float, gain_error: float = 0.0) -> MeasuredMap:
    """Return the noise of reading each pixel.

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


HOT = 10.0
"""Robust standard deviations over the median from which a pixel is hot."""


class DarkSlope:
    """The straight line through what each pixel reads against the exposure time.

    A weighted least-squares fit, the weights those of the stacks' typical pixel, the same for all pixels.

    Parameters
    ----------
    bias : Master or float, optional
        The reading without exposure: of frames, with their noise, or a level [ADU] taken as exact; None
        where the line is to find it.
    """

    def __init__(self, bias: Master | float | None) -> None:
        self._points: list[tuple[float, float]] = []
        self._sums: list[np.ndarray] = []
        self.frames = 0
        self._fixed = bias if isinstance(bias, int | float) else None
        if isinstance(bias, Master):
            self._add(bias, 0.0)

    def add(self, master: Master) -> None:
        """Add the dark frames of an exposure time."""
        self.frames += master.frames
        self._add(master, float(master.exposure or 0.0))

    def _add(self, master: Master, seconds: float) -> None:
        weight = master.frames / float(np.median(master.usual))
        mean, noise = master.mean, master.variance / master.kept
        factors = (weight, weight * seconds, weight**2, weight**2 * seconds, weight**2 * seconds**2)
        self._sums = self._sums or [np.zeros(mean.shape) for _ in factors]
        for total, factor, value in zip(self._sums, factors, (mean, mean, *[noise] * 3), strict=True):
            total += factor * value
        self._points.append((seconds, weight))

    def rate(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the slope of each pixel and its standard error [ADU/s].

        Raises
        ------
        ConfigurationError
            If there is only one exposure time and no bias, or every exposure time is zero.
        """
        seconds, weights = np.array(self._points).T
        ones, times, v0, v1, v2 = self._sums
        if self._fixed is not None:
            square = float(np.sum(weights * seconds**2))
            if not square > 0:
                raise self._no_time()
            return (times - self._fixed * float(weights @ seconds)) / square, np.sqrt(v2) / square
        middle = float(np.average(seconds, weights=weights))
        square = float(np.sum(weights * (seconds - middle) ** 2))
        if not square > 0:
            raise self._no_time()
        variance = np.maximum(v2 - 2 * middle * v1 + middle**2 * v0, 0.0)
        return (times - middle * ones) / square, np.sqrt(variance) / square

    def _no_time(self) -> ConfigurationError:
        longest = max(seconds for seconds, _ in self._points)
        if not longest > 0:
            problem = f"the dark frames have an exposure of {longest:g} s"
            remedy = "give longer ones, or their time by --exposure"
            return ConfigurationError(ErrorCode.OUT_OF_RANGE, f"{problem}; {remedy}.")
        problem = f"the dark frames have one exposure time only, {longest:g} s, and there is no bias"
        remedy = "give --bias, --bias-level, or darks of several exposure times"
        return ConfigurationError(ErrorCode.TOO_FEW, f"{problem}; {remedy}.")

    def map(self, good: np.ndarray, gain: float, gain_error: float = 0.0) -> MeasuredMap:
        """Return the dark current of each pixel [e-/s].

        Parameters
        ----------
        good : (ny, nx) bool array
        gain, gain_error : float
            e-/ADU.

        Returns
        -------
        dark_current : MeasuredMap
            Negative where noise makes it so.
        """
        rate, error = (array * gain for array in self.rate())
        values, typical = rate[good], float(np.sqrt(np.mean(error[good] ** 2)))
        number = float(values.mean())
        number_error = float(np.hypot(typical / values.size**0.5, number * gain_error / gain))
        spread = float(values.std())
        return MeasuredMap("dark_current", "e-/s", rate, typical, number, number_error, spread, self.frames)


def hot_pixels(rate: np.ndarray, usable: np.ndarray, times: float = HOT) -> tuple[np.ndarray, float]:
    """Return the pixels whose dark current lies far above that of the others.

    Parameters
    ----------
    rate : (ny, nx) array
        Dark current, in any unit.
    usable : (ny, nx) bool array
        Pixels to look at.
    times : float
        Robust standard deviations over the median.

    Returns
    -------
    hot : (ny, nx) bool array
    limit : float
        In the unit of ``rate``.

    Notes
    -----
    The standard deviation is 1.4826 times the median deviation: what noise and the usual spread of the
    pixels make together.
    """
    values = rate[usable]
    middle = float(np.median(values))
    limit = middle + times * 1.4826 * float(np.median(np.abs(values - middle)))
    return usable & (rate > limit), limit
