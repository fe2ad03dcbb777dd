"""One point of the photon-transfer curve: how much light, and how much it varies from frame to frame.

Reach for :func:`measure_level`, and for :func:`unlit_level`, which is that of bias frames.
:func:`fit_linearity` fits the signals of several against exposure time.  The law is that of
:class:`~jitterkit.detectors.Detector`: charge that is measured as
``charge (1 + c1 charge + c2 charge² + ...)``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from jitterkit.calibration.flat_frames import surface
from jitterkit.calibration.master import Master
from jitterkit.detectors.response import response_law

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


_SIGNIFICANT = 4.0
"""Errors from which a coefficient is believed."""

_MOST = 2
"""Coefficients that are tried."""

_LEAST = 1e-4
"""Relative deviation at the brightest level below which nobody cares, and lamps are not to be trusted."""


@dataclass(frozen=True, eq=False)
class Linearity:
    """A straight line with its bend.

    Parameters
    ----------
    rate : float
        Signal for each second where there is little of it [ADU/s].
    coefficients, errors : tuple of float
        ``c1, c2, ...`` of the law with the charge in ADU; empty where no bend is significant.
    residuals : (n,) array
        Of the levels fitted, against the straight line of ``rate``, relative.
    residual_errors : (n,) array
    chi2 : float
    freedom : int
    """

    rate: float
    coefficients: tuple[float, ...]
    errors: tuple[float, ...]
    exposures: np.ndarray
    signals: np.ndarray
    residuals: np.ndarray
    residual_errors: np.ndarray
    chi2: float
    freedom: int

    def in_electrons(self, gain: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return the coefficients and their errors with the charge in electrons [e-^-k]."""
        factors = [gain ** -(k + 1) for k in range(len(self.coefficients))]
        pairs = [(c * f, e * f) for c, e, f in zip(self.coefficients, self.errors, factors, strict=True)]
        return tuple(value for value, _ in pairs), tuple(error for _, error in pairs)

    def measured(self, charge: np.ndarray) -> np.ndarray:
        """Return what a charge [ADU] is measured as [ADU]."""
        return response_law(self.coefficients)(charge)

    def charge(self, signal: float) -> float:
        """Return the charge that is measured as a signal [ADU]."""
        law, charge = response_law(self.coefficients), signal
        for _ in range(30):
            charge -= (law(charge) - signal) / law.deriv()(charge)
        return float(charge)

    def slope(self, charge: float) -> float:
        """Return the slope of the signal with the charge; one where there is little."""
        return float(response_law(self.coefficients).deriv()(charge))


def fit_linearity(levels: Sequence[Level]) -> Linearity | None:
    """Fit signal against exposure time, with as many coefficients as are significant.

    Parameters
    ----------
    levels : sequence of Level
        Flats; saturated ones are left out.

    Returns
    -------
    linearity : Linearity or None
        None with less than three exposure times, or where flats of one exposure differ in brightness: the
        lamp was turned.

    Notes
    -----
    *Assumes* a lamp whose changes show within the frames of an exposure, and exposure times without a
    constant error: a shutter that opens late looks like a bend at short exposures.  So does a lamp that is
    turned up with the exposure, which :func:`~jitterkit.calibration.transfer.photon_transfer` sees by the
    variances.  Errors are scaled up where the levels scatter by more than theirs.  Uneven light makes ``c1``
    too large by the variance of the light over its square.
    """
    used = [level for level in levels if not level.saturated and level.exposure > 0 and level.signal > 0]
    exposures = {level.exposure for level in used}
    if len(exposures) < 3 or len(exposures) < len(used):  # two levels of one exposure: the lamp was turned
        return None
    t, s, e = np.array([(level.exposure, level.signal, level.signal_error) for level in used]).T
    best = _fit(t, s, e, 0)
    for order in range(1, min(_MOST, len(used) - 2) + 1):
        tried = _fit(t, s, e, order)
        last, error = tried.coefficients[-1], tried.errors[-1]
        bend = abs(tried.measured(s.max()) / s.max() - 1)
        if abs(last) > _SIGNIFICANT * error and bend > _LEAST and tried.slope(s.max()) > 0:
            best = tried
    return best


def _fit(t: np.ndarray, s: np.ndarray, e: np.ndarray, order: int) -> Linearity:
    scale = t.max()
    design = np.stack([(t / scale) ** (k + 1) for k in range(order + 1)], axis=1) / e[:, None]
    inverse = np.linalg.pinv(design)
    found, covariance = inverse @ (s / e), inverse @ inverse.T
    chi2, freedom = float(np.sum((s / e - design @ found) ** 2)), len(t) - order - 1
    covariance *= max(chi2 / freedom, 1.0)
    coefficients, errors = [], []
    for k in range(1, order + 1):
        factor = found[0] ** -(k + 1)
        # derivatives of found[k]/found[0]^(k+1)
        turn = np.zeros(order + 1)
        turn[0], turn[k] = -(k + 1) * found[k] * factor / found[0], factor
        coefficients.append(float(found[k] * factor))
        errors.append(float(np.sqrt(turn @ covariance @ turn)))
    line = found[0] * t / scale
    law = float(found[0] / scale), tuple(coefficients), tuple(errors)
    return Linearity(*law, t, s, s / line - 1, e / line, chi2, freedom)
