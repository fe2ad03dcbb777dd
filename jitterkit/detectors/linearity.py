"""Non-linearity: charge that is measured as more or less than it is.

:func:`measured` says what ``charge`` electrons look like, :func:`collected` goes back::

    measured = charge (1 + c1 charge + c2 charge² + ...)        0 <= charge <= top

with both in electrons and ``ck`` in e-^-k.  Below zero, where only noise goes, the law is the identity;
above ``top`` it goes straight on, so that both directions are smooth and defined everywhere.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

_STEPS = 60
"""More than bisection needs to reach rounding (53); Newton's steps end after four or five."""


def measured(charge: np.ndarray, coefficients: Sequence[float], top: float) -> np.ndarray:
    """What a charge is measured as.

    Parameters
    ----------
    charge : array
        e-.
    coefficients : sequence of float
        ``c1, c2, ...`` of the module's polynomial.
    top : float
        Charge up to which the polynomial holds, e-: the full well.

    Returns
    -------
    measured : array
        e-; ``c1 = -1e-6`` shows 10,000 e- as 9900.
    """
    inside = np.clip(charge, 0.0, top)
    return _law(coefficients)(inside) + slope(inside, coefficients, top) * (charge - inside)


def slope(charge: np.ndarray, coefficients: Sequence[float], top: float) -> np.ndarray:
    """Derivative of :func:`measured` with respect to the charge; one at zero and below."""
    return _law(coefficients).deriv()(np.clip(charge, 0.0, top))


def collected(measured_as: np.ndarray, coefficients: Sequence[float], top: float) -> np.ndarray:
    """The charge that is measured as given: the inverse of :func:`measured`.

    Parameters
    ----------
    measured_as : array
        e-.
    coefficients, top
        As in :func:`measured`; the law must rise up to ``top``.

    Returns
    -------
    charge : array
        e-, to a few roundings of ``top``.

    Notes
    -----
    Newton's steps, kept inside a bracket that every step narrows; one that leaves it is replaced by
    bisection (Press et al., Numerical Recipes, 9.4).
    """
    law = _law(coefficients)
    inside = np.clip(measured_as, 0.0, law(top))
    low, high = np.zeros_like(inside), np.full_like(inside, top)
    charge = np.minimum(inside, top)
    for _ in range(_STEPS):
        error = law(charge) - inside
        low, high = np.where(error > 0, low, charge), np.where(error > 0, charge, high)
        stepped = charge - error / law.deriv()(charge)
        outside = ~((low <= stepped) & (stepped <= high))
        before, charge = charge, np.where(outside, (low + high) / 2, stepped)
        if np.all(np.abs(charge - before) <= 2 * np.finfo(float).eps * top):
            break
    return charge + (measured_as - inside) / law.deriv()(charge)


def turning_point(coefficients: Sequence[float]) -> float:
    """Lowest charge at which the law no longer rises, e-; infinite where it rises for ever.

    >>> round(turning_point([-1e-5]), 6)
    50000.0
    """
    derivative = _law(coefficients).deriv().trim()
    if derivative.degree() == 0:
        return float("inf")
    roots = derivative.roots()
    rising = roots.real[(np.abs(roots.imag) <= 1e-9 * np.abs(roots)) & (roots.real > 0)]
    return float(rising.min()) if rising.size else float("inf")


def _law(coefficients: Sequence[float]) -> np.polynomial.Polynomial:
    return np.polynomial.Polynomial([0.0, 1.0, *coefficients])
