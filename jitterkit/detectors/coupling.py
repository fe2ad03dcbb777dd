"""Inter-pixel coupling: every pixel is read with a share of its four neighbours' charge.

:func:`couple` spreads charge as the read-out of a pixel does, :func:`decouple` undoes it exactly.  The
share ``a`` goes to *each* neighbour, and what would leave over an edge stays, so charge is conserved.
On an image continued by reflection this is a filter of transfer function::

    1 - 2a (2 - cos(2πfx) - cos(2πfy))           f in cycles per pixel, between 1 - 8a and 1

which a cosine transform applies and removes to rounding.  Coupling comes after the charge has been
collected: it smooths the photon noise with the image, so that decoupling makes both what they were.
"""

from __future__ import annotations

import numpy as np
from scipy.fft import dctn, idctn, ifft2
from scipy.ndimage import convolve

LIMIT = 0.125
"""Shares below this leave something of every frequency; ``1 - 8a`` is left of a chessboard."""

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
    """Variance of white noise after :func:`decouple`.

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


def beside(mask: np.ndarray) -> np.ndarray:
    """The four neighbours of the pixels of a mask (ny, nx), and the pixels themselves."""
    wide = np.pad(mask, 1)
    return mask | wide[:-2, 1:-1] | wide[2:, 1:-1] | wide[1:-1, :-2] | wide[1:-1, 2:]


def _transfer(fy: np.ndarray, fx: np.ndarray, share: float) -> np.ndarray:
    around = np.cos(2 * np.pi * fy)[:, None] + np.cos(2 * np.pi * fx)
    return 1 - 2 * share * (2 - around)
