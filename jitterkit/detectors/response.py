"""How charge is read: each pixel with a share of its neighbours' charge, and not in proportion.

**Inter-pixel coupling.**
:func:`couple` spreads charge as the read-out of a pixel does, :func:`decouple` undoes it exactly.  The
share ``a`` goes to *each* neighbour, and what would leave over an edge stays, so charge is conserved.
On an image continued by reflection this is a filter of transfer function::

    1 - 2a (2 - cos(2πfx) - cos(2πfy))           f in cycles per pixel, between 1 - 8a and 1

which a cosine transform applies and removes to rounding.  Coupling comes after the charge has been
collected: it smooths the photon noise with the image, so that decoupling makes both what they were.

**Brighter-fatter effect.**  Charge that a pixel holds repels what comes after, so that its borders move
inwards: :func:`broaden` moves each border by ``b`` pixels per electron of difference between its two sides,
:func:`narrow` undoes it.  With the mean charge of both sides that is::

    Q - (b/2) sum over neighbours n (Q² - Q_n²)        all charge is kept

It comes before the coupling, and acts on the charge with its noise.

**Non-linearity.**  :func:`measured` says what ``charge`` electrons look like, :func:`collected` goes back::

    measured = charge (1 + c1 charge + c2 charge² + ...)        0 <= charge <= top

with both in electrons and ``ck`` in e-^-k.  Below zero, where only noise goes, the law is the identity;
above ``top`` it goes straight on, so that both directions are smooth and defined everywhere.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.fft import dctn, idctn, ifft2
from scipy.ndimage import convolve

LIMIT = 0.125
"""Shares below this leave something of every frequency; ``1 - 8a`` is left of a chessboard."""

BORDER = LIMIT / 2
"""Pixels by which the brighter-fatter effect may move a border: each step back then halves the error."""

_REACH = 3
"""Pixels from which a decoupled pixel still takes noise; beyond, less than a^8 of the variance."""

_PERIOD = 64
"""Pixels of the torus on which the inverse kernel is computed; it falls by a factor of about a per pixel."""


def couple(charge: np.ndarray, share: float) -> np.ndarray:
    """Spread charge to the neighbours.

    Parameters
    ----------
    charge : (ny, nx) array
    share : float
        Of a pixel's charge that each of its four neighbours is read with; less than :data:`LIMIT`.

    Returns
    -------
    coupled : (ny, nx) array
        The same sum.
    """
    wide = np.pad(charge, 1, mode="edge")
    around = wide[:-2, 1:-1] + wide[2:, 1:-1] + wide[1:-1, :-2] + wide[1:-1, 2:]
    return charge + share * (around - 4 * charge)


def decouple(coupled: np.ndarray, share: float) -> np.ndarray:
    """Undo :func:`couple`.

    Parameters
    ----------
    coupled : (ny, nx) array
    share : float

    Returns
    -------
    charge : (ny, nx) array

    Notes
    -----
    *Assumes* that the image ends where the detector does.  *Fails* at the rim of a region cut out of a
    larger frame: a pixel there is wrong by ``a`` times the step to its missing neighbour, the next one
    inwards by ``a²``.
    """
    ny, nx = coupled.shape
    spectrum = _transfer(np.arange(ny) / (2 * ny), np.arange(nx) / (2 * nx), share)
    return idctn(dctn(coupled, norm="ortho") / spectrum, norm="ortho")


def decoupled_variance(variance: np.ndarray | float, share: float) -> np.ndarray | float:
    """Return the variance of white noise after :func:`decouple`.

    Parameters
    ----------
    variance : (ny, nx) array or float
        Of noise that is added after the coupling, such as read noise, pixel by pixel.
    share : float

    Returns
    -------
    variance : (ny, nx) array or float
        About ``1 + 8a + 60a²`` times as much where it is even; neighbours are then correlated by about
        ``-2a``.

    Notes
    -----
    *Fails* at the edges, where a pixel has fewer neighbours: ``2a`` too much for each that is missing.
    """
    frequencies = np.fft.fftfreq(_PERIOD)
    kernel = ifft2(1 / _transfer(frequencies, frequencies, share)).real ** 2
    if np.ndim(variance) == 0:
        return float(variance * kernel.sum())
    near = np.roll(kernel, (_REACH, _REACH), (0, 1))[: 2 * _REACH + 1, : 2 * _REACH + 1]
    return convolve(variance, near * (kernel.sum() / near.sum()), mode="reflect")


def broaden(charge: np.ndarray, coefficient: float) -> np.ndarray:
    """Let charge repel charge, as the brighter-fatter effect does.

    Parameters
    ----------
    charge : (ny, nx) array
        That pixels of a fixed size would hold, e-.
    coefficient : float
        Pixels by which a border moves for each electron that one side holds more; with the full well, less
        than :data:`BORDER`.

    Returns
    -------
    broadened : (ny, nx) array
        The same sum.

    Notes
    -----
    Nearest neighbours only, along rows as along columns, and the charge at the end of the exposure: what a
    border moves by is half of this on average, which the coefficient holds already.
    """
    return charge + coefficient / 2 * (couple(np.square(charge), 1.0) - np.square(charge))


def narrow(broadened: np.ndarray, coefficient: float) -> np.ndarray:
    """Undo :func:`broaden`, by fixed-point steps, to rounding.

    Notes
    -----
    Each step leaves ``8 b Q`` of the error at most.  *Fails* at the rim of a region cut out of a larger
    frame, as :func:`decouple` does, and beside pixels whose charge is not known.
    """
    charge = broadened
    for _ in range(_STEPS):
        before, charge = charge, broadened - (broaden(charge, coefficient) - charge)
        if np.all(np.abs(charge - before) <= 2 * np.finfo(float).eps * np.abs(charge).max(initial=1.0)):
            break
    return charge


def beside(mask: np.ndarray) -> np.ndarray:
    """Return the four neighbours of the pixels of a mask (ny, nx), and the pixels themselves."""
    wide = np.pad(mask, 1)
    return mask | wide[:-2, 1:-1] | wide[2:, 1:-1] | wide[1:-1, :-2] | wide[1:-1, 2:]


def _transfer(fy: np.ndarray, fx: np.ndarray, share: float) -> np.ndarray:
    around = np.cos(2 * np.pi * fy)[:, None] + np.cos(2 * np.pi * fx)
    return 1 - 2 * share * (2 - around)


_STEPS = 60
"""More than bisection needs to reach rounding (53); Newton's steps end after four or five."""


def measured(charge: np.ndarray, coefficients: Sequence[float], top: float) -> np.ndarray:
    """Return what a charge is measured as.

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
    return response_law(coefficients)(inside) + slope(inside, coefficients, top) * (charge - inside)


def slope(charge: np.ndarray, coefficients: Sequence[float], top: float) -> np.ndarray:
    """Return the derivative of :func:`measured` with respect to the charge; one at zero and below."""
    return response_law(coefficients).deriv()(np.clip(charge, 0.0, top))


def collected(signal: np.ndarray, coefficients: Sequence[float], top: float) -> np.ndarray:
    """Return the charge that is measured as given: the inverse of :func:`measured`.

    Parameters
    ----------
    signal : array
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
    law = response_law(coefficients)
    inside = np.clip(signal, 0.0, law(top))
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
    return charge + (signal - inside) / law.deriv()(charge)


def turning_point(coefficients: Sequence[float]) -> float:
    """Lowest charge at which the law no longer rises, e-; infinite where it rises for ever.

    >>> round(turning_point([-1e-5]), 6)
    50000.0
    """
    derivative = response_law(coefficients).deriv().trim()
    if derivative.degree() == 0:
        return float("inf")
    roots = derivative.roots()
    rising = roots.real[(np.abs(roots.imag) <= 1e-9 * np.abs(roots)) & (roots.real > 0)]
    return float(rising.min()) if rising.size else float("inf")


def response_law(coefficients: Sequence[float]) -> np.polynomial.Polynomial:
    """Return what a charge is measured as, by ``c1, c2, ...``: the polynomial."""
    return np.polynomial.Polynomial([0.0, 1.0, *coefficients])
