"""Photon transfer: gain, read noise and full well from how the variance rises with the light.

Reach for :func:`photon_transfer`.  Photons come at random, so that the variance of N electrons is N: in ADU
the variance rises by one over the gain for each ADU of signal, and begins at the read noise squared.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from jitterkit.calibration.level import Level
from jitterkit.calibration.linearity import Linearity, fit_linearity
from jitterkit.detectors.response import LIMIT
from jitterkit.errors import ConfigurationError, ErrorCode

_COLLAPSE = 0.9
"""Share of the variance that the dimmer levels foretell below which a level is saturated: real detectors
lose some per cent by non-linearity and coupling before."""

_FLAT_OUT = 0.3
"""Share below which hardly a pixel is left that still follows the light: the signal is the full well."""

_STILL = 0.05
"""ADU²: a variance below that is no read noise, so that the converter has ended."""

_WORSE = 25.0
"""Rise of chi² of the line by a bend that the levels of light are said to have, from which the lamp made the
bend: a detector's own takes the variances along."""

_COUPLED = 4.0
"""Errors from which a coupling is believed."""


@dataclass(frozen=True, eq=False)
class PhotonTransfer:
    """The line that levels of light lie on.

    Parameters
    ----------
    levels : tuple of Level
        The dimmest first, bias frames as the level without light.
    gain, gain_error : float
        e-/ADU.
    read_noise, read_noise_error : float
        e-, without rounding; zero, its error NaN, where the line starts below zero.
    chi2 : float
        Of the straight line; errors are scaled up where it is more than the ``freedom``.
    freedom : int
    linearity : Linearity, optional
    coupling, coupling_error : float
        Share of a pixel's charge that each of its four neighbours is read with; zero where it is not
        significant.
    full_well : float, optional
        e-, where the wells stop to follow the light.
    saturation : float, optional
        Above the bias [ADU], where the converter does.
    """

    levels: tuple[Level, ...]
    gain: float
    gain_error: float
    read_noise: float
    read_noise_error: float
    chi2: float
    freedom: int
    linearity: Linearity | None = None
    coupling: float = 0.0
    coupling_error: float = math.inf
    full_well: float | None = None
    saturation: float | None = None

    @property
    def used(self) -> tuple[Level, ...]:
        """Return the levels fitted."""
        return tuple(level for level in self.levels if not level.saturated)

    @property
    def bend(self) -> float:
        """Relative rise of the summed signal of the levels with the light, over the light's own."""
        law = self.linearity
        if law is None or not law.coefficients:
            return 1.0
        lit = [(level.frames, level.signal) for level in self.used if level.exposure > 0]
        charges = [law.charge(signal) for _, signal in lit]
        rises = [n * q * law.slope(q) for (n, _), q in zip(lit, charges, strict=True)]
        return sum(rises) / sum(n * signal for n, signal in lit)

    def variance(self, signal: np.ndarray) -> np.ndarray:
        """Return the line fitted: variance at a signal above the bias, both in ADU."""
        line = [_abscissa(float(s), self.linearity) for s in np.ravel(signal)]
        slope, read = _kept(self.coupling) / self.gain, self.read_noise / self.gain
        return np.reshape(np.array(line) * slope + read**2, np.shape(signal))


def photon_transfer(levels: Sequence[Level]) -> PhotonTransfer:
    """Fit variance against signal.

    Parameters
    ----------
    levels : sequence of Level
        Bias frames count as the level without light.

    Returns
    -------
    transfer : PhotonTransfer

    Raises
    ------
    ConfigurationError
        If all levels with light are saturated, or one level stands alone, or nothing rises.

    Notes
    -----
    The variance is that of the photons after the coupling to the neighbours and the non-linearity, both
    measured here: coupling of a share ``a`` takes ``8a`` of it, which shows as a correlation of ``2a``
    between neighbours.
    *Fails when* charge moves between pixels in proportion to its square (brighter-fatter): the line bends.
    """
    levels = sorted(levels, key=lambda level: (level.signal, level.exposure))
    levels = mark_saturated(levels)
    used = [level for level in levels if not level.saturated]
    if not any(level.signal > 0 and level.exposure > 0 for level in used):
        worst = next(level for level in levels if level.saturated)
        problem = f"the flats are saturated, the dimmest at {worst.signal:.5g} ADU above the bias"
        raise ConfigurationError(ErrorCode.NO_DATA, f"{problem}; give flats of shorter exposures.")
    y, e = np.array([(level.variance, level.variance_error) for level in used]).T
    linearity, x = fit_linearity(used), np.array([level.signal for level in used])
    if linearity is not None and linearity.coefficients:
        bent = np.array([_abscissa(level.signal, linearity) for level in used])
        if _line(bent, y, e)[2] < _line(x, y, e)[2] + _WORSE:
            x = bent
        else:
            linearity = None
    if len(used) == 1:
        problem = f"one level of light, {used[0].signal:.5g} ADU, does not separate gain from read noise"
        raise ConfigurationError(ErrorCode.TOO_FEW, f"{problem}; give --bias, or flats of another exposure.")
    (slope, start), covariance, chi2, freedom = _line(x, y, e)
    if not slope > 0:
        problem = f"the variance does not rise with the light (by {slope:.3g} ADU for each ADU)"
        remedy = "check that these are flats, as they were read"
        raise ConfigurationError(ErrorCode.IMPLAUSIBLE, f"{problem}; {remedy}.")
    coupling, coupling_error = _coupling(used, x, slope)
    errors = [covariance[0, 0] ** 0.5 / slope, *_of_bends(used, linearity, slope)]
    errors += [8 * coupling_error] if coupling else []
    gain = _kept(coupling) / slope
    gain_error = gain * math.hypot(*errors)
    noise = max(start, 0.0) ** 0.5
    noise_error = gain * covariance[1, 1] ** 0.5 / (2 * noise) if noise else math.nan
    transfer = PhotonTransfer(
        tuple(levels), gain, gain_error, gain * noise, noise_error, chi2, freedom, linearity, coupling,
        coupling_error,
    )  # fmt: skip
    return _with_well(transfer)


def mark_saturated(levels: Sequence[Level]) -> list[Level]:
    """Mark levels whose variance has collapsed, and those after them that are exposed as long or longer.

    Parameters
    ----------
    levels : sequence of Level
        The dimmest first.

    Returns
    -------
    levels : list of Level
    """
    marked: list[Level] = []
    for level in levels:
        before = [other for other in marked if not other.saturated]
        over = any(o.saturated and level.exposure >= o.exposure for o in marked)
        gone = len(before) > 1 and _share(before, level) < _COLLAPSE
        marked.append(replace(level, saturated=level.saturated or over or gone))
    return marked


def _share(before: Sequence[Level], level: Level) -> float:
    """Return the variance over what the line through the levels before predicts, and its errors."""
    x, y, e = np.array([(o.signal, o.variance, o.variance_error) for o in before]).T
    (slope, start), covariance, *_ = _line(x, y, e)
    foretold = slope * level.signal + start
    unsure = 5 * math.hypot((covariance[0, 0] ** 0.5) * level.signal, level.variance_error)
    return math.inf if foretold <= unsure else (level.variance + unsure) / foretold


def _line(x: np.ndarray, y: np.ndarray, e: np.ndarray) -> tuple[tuple[float, float], np.ndarray, float, int]:
    """Weighted straight line: slope and start, their covariance (scaled up where it does not fit), chi2."""
    design = np.stack([x / e, 1 / e], axis=1)
    inverse = np.linalg.pinv(design)
    slope, start = inverse @ (y / e)
    chi2, freedom = float(np.sum(((y - slope * x - start) / e) ** 2)), len(x) - 2
    covariance = inverse @ inverse.T * (max(chi2 / freedom, 1.0) if freedom else 1.0)
    return (float(slope), float(start)), covariance, chi2, freedom


def _abscissa(signal: float, linearity: Linearity | None) -> float:
    """Return what the shot noise is in proportion to: the charge [ADU] times the slope of the law squared."""
    if linearity is None or not linearity.coefficients:
        return signal
    charge = linearity.charge(signal)
    return charge * linearity.slope(charge) ** 2


def _of_bends(used: list[Level], linearity: Linearity | None, slope: float) -> list[float]:
    """Return the relative change of the slope with the error of each coefficient of the law."""
    if linearity is None:
        return []
    y, e = np.array([(level.variance, level.variance_error) for level in used]).T
    turns = []
    for k, error in enumerate(linearity.errors):
        bent = list(linearity.coefficients)
        bent[k] += error
        other = replace(linearity, coefficients=tuple(bent))
        x = np.array([_abscissa(level.signal, other) for level in used])
        turns.append(_line(x, y, e)[0][0] / slope - 1)
    return turns


def _coupling(used: list[Level], x: np.ndarray, slope: float) -> tuple[float, float]:
    """Share that goes to each neighbour, from how the covariance of neighbours rises with the light."""
    c, e = np.array([(level.covariance, level.covariance_error) for level in used]).T
    known = np.isfinite(e)
    if not known.any():
        return 0.0, math.inf
    if known.sum() > 1:
        (rise, _), covariance, *_ = _line(x[known], c[known], e[known])
        error = covariance[0, 0] ** 0.5
    else:
        rise, error = c[known][0] / x[known][0], e[known][0] / x[known][0]
    ratio, ratio_error = rise / slope, error / slope
    if ratio < _COUPLED * ratio_error:
        return 0.0, ratio_error / 2
    # the smaller root of ratio ((1-4a)² + 4a²) = 2a (1-4a)
    b = 2 + 8 * ratio
    share = (b - math.sqrt(max(b**2 - 4 * ratio * (8 + 20 * ratio), 0.0))) / (2 * (8 + 20 * ratio))
    if share >= LIMIT:
        problem = f"the noise of neighbouring pixels of the flats is correlated ({ratio:.2g})"
        remedy = "they were smoothed or resampled: give flats as they were read"
        raise ConfigurationError(ErrorCode.IMPLAUSIBLE, f"{problem}; {remedy}.")
    return share, ratio_error / 2


def _kept(coupling: float) -> float:
    """Return the share of a pixel's shot-noise variance that coupling leaves it."""
    return (1 - 4 * coupling) ** 2 + 4 * coupling**2


def _with_well(transfer: PhotonTransfer) -> PhotonTransfer:
    """Add where the range ends, if the brightest level stands there."""
    full = [level for level in transfer.levels if level.saturated]
    if not full:
        return transfer
    top = max(full, key=lambda level: level.signal)
    if top.variance < _STILL:
        return replace(transfer, saturation=top.signal)
    if top.variance > _FLAT_OUT * float(transfer.variance(np.array(top.signal))):
        return transfer
    charge = top.signal if transfer.linearity is None else transfer.linearity.charge(top.signal)
    return replace(transfer, full_well=charge * transfer.gain)
