"""Integrals of a spectrum against weights that oscillate many times between its rows.

The range is cut into panels over which neither weights nor densities change much: at every row, every octave
and every cycle of the weights.  In each, Gauss and Legendre's rule.  :func:`panel_integrals` is all there is.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from jitterkit.motion.spectrum import PowerSpectrum

_NODES = 12
"""A panel: over an octave of f^-4, or a cycle of sinc², exact to 1e-12."""

_OCTAVES = 60
"""Below the last row; a first row at zero is straight, and what is left of it is 1e-18 of the range."""

_MOST = 1e5
"""Cycles with panels of their own; beyond, displacement and smear are below 1e-10 of a tone."""

_BLOCK = 1 << 16
"""Panels at a time, to bound the memory."""


def panel_integrals(
    spectrum: PowerSpectrum,
    weights: Callable[[np.ndarray], np.ndarray] | None = None,
    period: float = 0.0,
    edges=(),
) -> tuple[np.ndarray, np.ndarray]:
    """Integrate the densities of a spectrum, weighted, piece by piece.

    Parameters
    ----------
    spectrum : PowerSpectrum
        Its lines have no part in this.
    weights : callable, optional
        From frequencies (m,) to weights (k, m); by default one.
    period : float
        In time, of the fastest oscillation of the weights, s: the exposure, or the cadence.
    edges : (e,) array, optional
        Frequencies where a panel shall end, Hz.

    Returns
    -------
    ends : (p + 1,) array
        Of the panels, Hz.
    integrals : (p, k, 3) array
        Over each panel, of x, xy and y; arcsec².

    Notes
    -----
    For the interpolated spectrum this is exact to about 1e-11 up to 1e5 cycles an exposure; what is faster is
    jitter, to 1e-10 of itself.  What a coarse table leaves open is the interpolation.
    """
    ends = _panels(spectrum.frequencies, period, np.asarray(edges, float))
    nodes, weight = np.polynomial.legendre.leggauss(_NODES)
    blocks = []
    for start in range(0, len(ends) - 1, _BLOCK):
        low, high = ends[:-1][start : start + _BLOCK], ends[1:][start : start + _BLOCK]
        f = (low + high)[:, None] / 2 + (high - low)[:, None] / 2 * nodes
        share = np.ones((1, f.size)) if weights is None else weights(f.ravel())
        share = share.reshape(len(share), *f.shape) * (weight * (high - low)[:, None] / 2)
        blocks.append(np.einsum("kpn,pnc->pkc", share, spectrum.at(f)))
    return ends, np.concatenate(blocks) if blocks else np.zeros((0, 1, 3))


def _panels(rows: np.ndarray, period: float, edges: np.ndarray) -> np.ndarray:
    """Ends of panels: rows, octaves, cycles, and what else is asked for within the rows."""
    if not len(rows):
        return np.zeros(0)
    low, high = rows[[0, -1]]
    octaves = high * 2.0 ** -np.arange(_OCTAVES)
    last = min(high * period, _MOST)
    cycles = np.arange(np.ceil(low * period), last + 1) / period if period > 0 else np.zeros(0)
    ends = np.unique(np.concatenate([rows, octaves, cycles, edges]))
    return ends[(ends >= low) & (ends <= high)]
