"""The transfer function of a path given in steps of time: the mean of its phasors.

``M(f) = sum_k w_k exp(-2 pi i (fx x_k + fy y_k))`` is the definition itself; every path without a
formula of its own comes through here, with the nodes and weights of a quadrature in time.
"""

from __future__ import annotations

import functools
import math

import jax.numpy as jnp
import numpy as np

_EXACT = 1e-4


def mean_phasor(x, y, weights, fx, fy):
    """Return the mean phasor of weighted offsets.

    Parameters
    ----------
    x, y : (n,) array
        arcsec.
    weights : (n,) array
        Shares of the time; they sum to one.
    fx, fy : array
        cycles/arcsec, of shapes that broadcast.

    Returns
    -------
    mean : complex array of their common shape
        On an open grid, ``fx`` (1, nx) and ``fy`` (ny, 1), the phasors factor into one of each axis and
        the sum is a product of matrices: the same terms, without an exponential for each.
    """
    fx, fy = jnp.asarray(fx), jnp.asarray(fy)
    if fx.ndim == fy.ndim == 2 and fx.shape[0] == fy.shape[1] == 1:
        along_x = jnp.exp(-2j * jnp.pi * x[:, None] * fx[0])
        along_y = jnp.exp(-2j * jnp.pi * y[:, None] * fy[:, 0])
        return (weights[:, None] * along_y).T @ along_x
    return jnp.exp(-2j * jnp.pi * (fx[..., None] * x + fy[..., None] * y)) @ weights.astype(complex)


@functools.cache
def gauss_legendre(nodes: int, panels: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Return the times in (-1/2, 1/2) and weights that sum to one; ``nodes`` in each of equal panels."""
    t, w = np.polynomial.legendre.leggauss(nodes)
    starts = np.arange(panels)[:, None] - panels / 2
    return ((starts + (t + 1) / 2) / panels).ravel(), np.tile(w / (2 * panels), panels)


def exact_to(longest: float, nodes: int) -> float:
    """Return the frequency up to which a mean phasor by quadrature is good to 1e-4.

    Parameters
    ----------
    longest : float
        The most that the path covers in one panel, arcsec: its greatest speed times the panel's time.
    nodes : int
        Of Gauss and Legendre's rule in a panel.

    Returns
    -------
    frequency : float
        cycles/arcsec, at which a phase that runs by ``d`` in a panel makes the rule's error,
        ``d^(2n) n!^4 / ((2n + 1) (2n)!^3)`` (Abramowitz & Stegun 25.4.30), a ten-thousandth.

    >>> round(exact_to(1.0, 3), 3)
    0.385
    """
    factorials = math.log(2 * nodes + 1) + 3 * math.lgamma(2 * nodes + 1) - 4 * math.lgamma(nodes + 1)
    turn = math.exp((math.log(_EXACT) + factorials) / (2 * nodes))
    return turn / (2 * math.pi * longest) if longest > 0 else math.inf


def greatest_speed(positions) -> float:
    """Return the greatest speed on a path of positions (n, 2) at equal times, arcsec an exposure."""
    return len(positions) * float(np.hypot(*np.diff(positions, axis=0).T).max())
