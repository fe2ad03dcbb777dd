"""The kernel by multiplicative updates (Richardson, Lucy): the star's image is known, not the blur."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from jitterkit.estimators.kernel_problem import KernelProblem, solve_kernel
from jitterkit.forward import Parameters
from jitterkit.kernel_estimate import KernelEstimate
from jitterkit.likelihood import Data
from jitterkit.optics.otf import OTF

_FIRST, _MOST = 64, 2**15
"""Updates before the first look at the deviance, and at most."""

_NOISE = 0.1
"""Deviance that another doubling of the updates must gain; one is a standard error in one direction."""

_LEAST_STEP = 0.1
"""Of a share that an extrapolation may leave: what is at zero never returns."""

_TINY = np.finfo(float).tiny


def estimate_richardson_lucy(
    data: Data, template: Parameters, otf: OTF, *, hold: Collection[str] = ()
) -> KernelEstimate:
    """Estimate the kernel by accelerated Richardson-Lucy updates from a flat one.

    Parameters
    ----------
    data : Data
    template : Parameters
        Scene and aberrations; its locus is ignored.  Its position and flux need not be exact.
    otf : OTF
    hold : collection of str
        For the sake of a common signature: everything but the kernel is held at the template's values.

    Returns
    -------
    estimate : KernelEstimate
        The moments of any motion, without a model of it.

    Raises
    ------
    UndeterminedError
        If the kernel does not fit: a blur of several pixels, or a frame too faint.

    Notes
    -----
    ``k <- k (A'Wd)/(A'WAk)`` with ``W`` the inverse variance of the blurred image, renewed once: where
    ``W`` is that of ``Ak`` itself this is Richardson's and Lucy's update, and it runs on the normal
    equations, in microseconds.  The extrapolation is that of Biggs and Andrews (Appl. Opt. 36, 1766,
    1997).  It ends when twice as many updates gain less deviance than noise does.  An update at the
    usual few dozen is far from the data of a bright star: the kernel is then the flat start, sharpened a
    little.  Moments are biased as those of :func:`estimate_nnls` are.
    """
    return solve_kernel(data, template, otf, _solve, "richardson-lucy")


def _solve(problem: KernelProblem) -> np.ndarray:
    curvature, dark = problem.curvature, problem.dark
    wanted = np.maximum(problem.pull + dark, 0.0)
    shares = np.full(len(wanted), max(problem.pull.sum(), 0.0) / curvature.sum())
    ahead, step, deviance, look = shares, np.zeros_like(shares), np.inf, _FIRST
    for n in range(1, _MOST + 1):
        before, last = shares, step
        shares = ahead * wanted / (curvature @ ahead + dark)
        step = shares - ahead
        pace = min(max(step @ last / (last @ last + _TINY), 0.0), 1.0)
        ahead = np.maximum(shares + pace * (shares - before), _LEAST_STEP * shares)
        if n == look:
            found = problem.deviance(shares)
            if deviance - found < _NOISE:
                break
            deviance, look = found, 2 * look
    return shares
