"""Linearity: signal against exposure time.

Reach for :func:`fit_linearity`.  The law is that of :class:`~jitterkit.detectors.Detector`: charge that is
measured as ``charge (1 + c1 charge + c2 charge² + ...)``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jitterkit.calibration.level import Level
from jitterkit.detectors.response import response_law

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
