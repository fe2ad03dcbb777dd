"""The special functions of the loci, written in the square of their argument.

A transfer function depends on the jitter through ``u²``.  Written in ``u`` its derivative at zero size
is 0/0; written in ``u²`` it is a smooth function with finite derivatives everywhere, so that no
derivative is NaN without jitter.

They are :func:`elementwise`: differentiated once, in whatever number of directions they are pushed.

A path that is given in steps of time has a transfer function too, the mean of its phasors:
:func:`mean_phasor`.  ``M(f) = sum_k w_k exp(-2 pi i (fx x_k + fy y_k))`` is the definition itself;
every path without a formula of its own comes through here, with the nodes and weights of a quadrature
in time.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import scipy.special

_LARGE = 25.0  # where Hankel's expansion takes over: its ten terms are then below 1e-16

_J0_SERIES = [(2 if k else 1) * (-1) ** k * float(scipy.special.jv(k, _LARGE / 2)) ** 2 for k in range(32)]
"""Chebyshev coefficients of J0 up to there, by Neumann's addition theorem:
``J0(2a cos(x/2)) = J0(a)² + 2 sum_k (-1)^k J_k(a)² cos kx``."""


def elementwise(function: Callable[..., jax.Array]) -> Callable[..., jax.Array]:
    """A function of arrays, element by element, whose derivative is worked out once for all directions.

    A fit pushes two to five coordinates of a locus through it: each costs a product then, and not the work of
    the function again.
    """
    once = jax.custom_jvp(function)

    @once.defjvp
    def push(values, changes):
        ones = [jnp.ones_like(value) for value in values]
        zeros = [jnp.zeros_like(value) for value in values]
        result, total = function(*values), 0.0
        for n, change in enumerate(changes):
            direction = tuple(zeros[:n] + ones[n : n + 1] + zeros[n + 1 :])
            total = total + jax.jvp(function, values, direction)[1] * change
        return result, total

    return functools.wraps(function)(once)


@elementwise
def sinc_of_square(w):
    """Return ``sin(pi sqrt(w)) / (pi sqrt(w))`` for w >= 0, to rounding, with all derivatives at zero."""
    small = w < 0.05
    z2 = math.pi**2 * w
    series = _horner([(-1) ** k / math.factorial(2 * k + 1) for k in range(10)], jnp.where(small, z2, 0.0))
    z = jnp.sqrt(jnp.where(small, 1.0, z2))
    return jnp.where(small, series, jnp.sin(z) / z)


@elementwise
def j0_of_square(w):
    """Return ``J0(sqrt(w))``, to about 1e-14, with all derivatives at zero.

    Where a fit makes a covariance indefinite, w is negative and this is ``I0(sqrt(-w))``, to 1e-13 of
    itself down to w = -100 (where it is 2816) and finite beyond.

    Notes
    -----
    ``J0(sqrt(w))`` is entire in w: a Chebyshev series up to w = 625 and Hankel's asymptotic
    expansion beyond (Abramowitz & Stegun 9.2.5).  Below zero the terms of that series all have one sign.
    """
    w = jnp.asarray(w)
    small = w < _LARGE**2
    near = _clenshaw(_J0_SERIES, jnp.where(small, w, 0.0) * (2 / _LARGE**2) - 1)
    # a branch, because few frames need the far expansion, which takes twice as long
    return jax.lax.cond(jnp.all(small), lambda w, near: near, _with_far_j0, w, near)


def _with_far_j0(w, near):
    small = w < _LARGE**2
    z = jnp.sqrt(jnp.where(small, _LARGE**2, w))
    terms, inverse = [1.0], 1 / z  # Hankel's, of P and Q in turn
    for k in range(1, 20):
        terms.append(terms[-1] * (2 * k - 1) ** 2 / (8 * k))
    p, q = _horner(terms[0::2], -(inverse**2)), -inverse * _horner(terms[1::2], -(inverse**2))
    phase = z - math.pi / 4
    far = jnp.sqrt(2 / (math.pi * z)) * (p * jnp.cos(phase) - q * jnp.sin(phase))
    return jnp.where(small, near, far)


def normal_transfer(variance):
    """Return the transfer function of a normal density by the variance ``f'Σf`` along a frequency."""
    return jnp.exp(-2 * math.pi**2 * variance)


def uniform_transfer(variance):
    """Return the transfer function of a uniform streak by the variance ``f'Σf`` along a frequency."""
    return sinc_of_square(12 * variance)


def harmonic_transfer(variance):
    """Return the transfer function of harmonic motion by the variance ``f'Σf`` along a frequency."""
    return j0_of_square(8 * math.pi**2 * variance)


@elementwise
def log1p_over(z):
    """Return ``ln(1 + z)/z`` for z > -1, to rounding, with finite derivatives at zero."""
    small = jnp.abs(z) < 0.01
    series = _horner([(-1) ** k / (k + 1) for k in range(9)], jnp.where(small, z, 0.0))
    far = jnp.where(small, 1.0, z)
    return jnp.where(small, series, jnp.log1p(far) / far)


def _horner(coefficients, x):
    total = jnp.zeros_like(x)
    for c in reversed(coefficients):
        total = total * x + c
    return total


def _clenshaw(coefficients, t):
    def step(pair, c):
        ahead, after = pair
        return (2 * t * ahead - after + c, ahead), None

    none, higher = jnp.zeros_like(t), jnp.asarray(coefficients[1:], t.dtype)
    # traced once and written out whole: a loop takes several times as long
    (ahead, after), _ = jax.lax.scan(step, (none, none), higher, reverse=True, unroll=len(higher))
    return t * ahead - after + coefficients[0]


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
