"""One point of the photon-transfer curve: how much light, and how much it varies from frame to frame.

Reach for :func:`measure_level`, and for :func:`unlit_level`, which is that of bias frames.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from jitterkit.calibration.flat_frames import surface
from jitterkit.calibration.master import Master

_LIT = 0.5
"""Share of the usual signal below which a pixel is left out: it is dead, or in the dark."""


@dataclass(frozen=True)
class Level:
    """Signal and variance of the frames of one exposure.

    Parameters
    ----------
    exposure : float
        s; zero of bias frames.
    frames : int
    signal, signal_error : float
        Mean over good pixels above the bias [ADU], dark current included; the error holds the lamp's changes
        from frame to frame.
    variance, variance_error : float
        Of one frame from frame to frame [ADU²], without rounding: the response of the pixels is not in it.
    covariance : float
        Of a pixel's noise with that of a nearest neighbour [ADU²].
    covariance_error : float
    spatial_variance : float
        Of one frame over its pixels, a smooth surface taken out [ADU²], without rounding: the response of
        the pixels is in it.
    saturated : bool
        Whether the converter or the wells end here.
    """

    exposure: float
    frames: int
    signal: float
    signal_error: float
    variance: float
    variance_error: float
    covariance: float = 0.0
    covariance_error: float = np.inf
    spatial_variance: float = np.nan
    saturated: bool = False

    @property
    def prnu(self) -> float:
        """Spread of the pixels' response, relative; zero where noise makes all of it."""
        if not self.signal > 0:
            return float("nan")
        return max(self.spatial_variance - self.variance, 0.0) ** 0.5 / self.signal


def measure_level(
    master: Master,
    bias: Master | float,
    good: np.ndarray,
    *,
    scales: np.ndarray | None = None,
    saturated: bool = False,
) -> Level:
    """Measure signal and variance of a stack.

    Parameters
    ----------
    master : Master
        Of flats of one exposure.
    bias : Master or float
        ADU.
    good : (ny, nx) bool array
        Pixels that count.
    scales : (n,) array, optional
        How bright the lamp was in each frame.
    saturated : bool

    Returns
    -------
    level : Level

    Notes
    -----
    The variance is the mean over pixels of each pixel's variance from frame to frame.  Of two frames it is
    half the variance of their difference, one scaled to the other's brightness; of more it is that of all
    pairs, and knows more than pairs of neighbours do.
    """
    light = master.mean - (bias.mean if isinstance(bias, Master) else bias)
    lit = good & (light > _LIT * float(np.median(light[good])))
    signal, pixels = float(light[lit].mean()), float(lit.sum())
    level = _noise_of(master, lit)
    drift = 0.0 if scales is None else signal * float(np.std(scales, ddof=1)) / len(scales) ** 0.5
    statistical = (level.variance + master.rounding) / (master.frames * pixels)
    spatial = float("nan")
    if isinstance(bias, Master):
        of_bias = float(np.mean(bias.variance[lit], dtype=float)) / bias.frames
        statistical += of_bias / pixels
        of_mean = (level.variance + master.rounding) / master.frames + of_bias
        # of the mean frame over its pixels, a smooth surface taken out
        even = (light / surface(np.where(lit, light, 0.0), lit))[lit]
        spatial = float(np.var(even) * np.mean(light[lit]) ** 2 / np.mean(even) ** 2)
        spatial = spatial - of_mean + level.variance
    return replace(
        level,
        signal=signal,
        signal_error=float(np.hypot(max(statistical, 0.0) ** 0.5, drift)),
        spatial_variance=spatial,
        saturated=saturated,
    )


def unlit_level(bias: Master, good: np.ndarray) -> Level:
    """Return the level without light: the noise of bias frames.

    Parameters
    ----------
    bias : Master
    good : (ny, nx) bool array

    Returns
    -------
    level : Level
        Of signal zero.
    """
    return replace(_noise_of(bias, good), exposure=0.0)


def _noise_of(master: Master, pixels: np.ndarray) -> Level:
    variance, error = master.typical_variance(pixels)
    whole = variance + master.rounding
    pairs = 2 * (master.frames - 1) * float(pixels.sum())
    return Level(
        exposure=float(master.exposure or 0.0),
        frames=master.frames,
        signal=0.0,
        signal_error=0.0,
        variance=variance,
        variance_error=error,
        covariance=master.neighbours * whole,
        covariance_error=whole / pairs**0.5,
    )
