"""How much of a vibration an exposure sees as displacement, as smear and as jitter.

Over one exposure every motion is a sum of Legendre polynomials of time: the zeroth is where the image stands
(displacement), the first a straight smear, the rest jitter.  :func:`part_weights` gives the share of each in
the variance of a tone of random phase, by its cycles ``f T`` in one exposure; :func:`difference_weight` what
moves from one frame to another.
"""

from __future__ import annotations

import numpy as np
from scipy.special import spherical_jn

PARTS = ("displacement", "smear", "jitter")

_LAST = 8
"""Of the terms that make the jitter of a slow tone; at z = 1 what follows is 1e-17 of the sum."""


def legendre_weight(n: int, cycles) -> np.ndarray:
    """Share of a tone's variance in the n-th Legendre term of an exposure.

    Parameters
    ----------
    n : int
    cycles : array
        ``f T``, frequency times exposure.

    Returns
    -------
    weight : array
        ``(2 n + 1) j_n(pi f T)²``; over all n they sum to one.

    Notes
    -----
    The mean over a random phase of the squared projection of ``sqrt(2) cos(2 pi f t + phase)`` on the
    normalised polynomial (Pittelkau & McKinley 2016).

    >>> legendre_weight(0, [0.0, 1.0]).round(12)
    array([1., 0.])
    """
    return (2 * n + 1) * spherical_jn(n, np.pi * np.asarray(cycles, float)) ** 2


def part_weights(cycles) -> np.ndarray:
    """Shares of a tone's variance in displacement, smear and jitter.

    Parameters
    ----------
    cycles : (m,) array
        ``f T``.

    Returns
    -------
    weights : (3, m) array
        In the order of :data:`PARTS`; they sum to one.

    Notes
    -----
    Jitter goes as ``(pi f T)⁴ / 45`` for slow tones.  There it is summed from its own terms: one minus the
    other two would lose it to rounding.
    """
    cycles = np.asarray(cycles, float)
    displacement, smear = legendre_weight(0, cycles), legendre_weight(1, cycles)
    slow = np.where(np.pi * cycles < 1, cycles, 0.0)
    terms = sum(legendre_weight(n, slow) for n in range(2, _LAST + 1))
    jitter = np.where(np.pi * cycles < 1, terms, 1 - displacement - smear)
    return np.stack([displacement, smear, jitter])


def difference_weight(frequencies, exposure: float, cadence: float) -> np.ndarray:
    """Variance of the motion between two frames, per variance of a tone.

    Parameters
    ----------
    frequencies : (m,) array
        Hz.
    exposure, cadence : float
        Of a frame, and from the start of one to the start of the other, s.

    Returns
    -------
    weight : (m,) array
        ``4 sin²(pi f cadence) sinc²(f exposure)``, up to 4: the frames may lie at opposite ends of the swing.
    """
    frequencies = np.asarray(frequencies, float)
    return 4 * np.sin(np.pi * frequencies * cadence) ** 2 * legendre_weight(0, frequencies * exposure)
