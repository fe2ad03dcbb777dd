"""The agreement of a frame with its prior: reach for :func:`prior_chance`.

A fit with a prior always ends somewhere between the two, and says nothing of how far they lay apart.
"""

from __future__ import annotations

import jax
import numpy as np
import scipy.linalg
import scipy.stats

from jitterkit.forward import Parameters, to_vector
from jitterkit.refit.priors import Priors

CONTRADICTED = 1e-3
"""Chance below which frame and prior contradict each other."""

_LEAST_SHARE = 1e-9
"""Share of the prior's variance below which the frame is ignored: it knows 30 000 times less there, and
``P - C`` is lost in the rounding of C."""


def prior_chance(
    priors: Priors,
    parameters: Parameters,
    names: tuple[str, ...],
    free: tuple[int, ...],
    covariance: np.ndarray,
    score: np.ndarray | None,
) -> float:
    """Chance that frame and prior lie as far apart as they do, or farther, if both are right.

    Parameters
    ----------
    priors : Priors
        The priors given; the regularizing priors of a locus are not counted.
    parameters : Parameters
        Where the fit ended.
    names : tuple of str
        Of the free parameters.
    free : tuple of int
        Their positions in :func:`jitterkit.forward.to_vector`.
    covariance : (p, p) array
        Of the free parameters, the prior included.
    score : (p,) array or None
        Slope of the log-posterior where the fit ended: the step that remains to the maximum is counted as
        done.  None where it ended at a streak of zero length, which is no maximum.  There the prior's own
        width is all that is counted, so that the chance is too large rather than too small.

    Returns
    -------
    chance : float
        0 to 1, of chi-squared with a degree of freedom for each number that the priors are about; 1 where
        they are about none.

    Notes
    -----
    Let ``P`` be the prior's covariance of those numbers and ``C`` that of the fit.  The fit's end is the mean
    of prior and frame by information, so that its distance from the prior's mean has the covariance ``P - C``
    if both are right.  Where the prior is much the tighter, the 1e-4 standard errors that a fit may leave
    undone, or 0.03 with regularizing priors, are sigmas of that.

    *Assumes* a likelihood that is normal between the two: far apart the chance is not exact, but small.
    *Fails when* a prior was learnt from few frames and so has wide wings: learnt from 6, one in 40
    contradicts its frame by chance; from 12, one in 100.
    """
    slope, off, whiten = _prior_terms(priors, parameters, names, free)
    if score is not None:
        off = off + slope @ covariance @ score
    slope, off = whiten @ slope, whiten @ off
    share, axes = np.linalg.eigh(slope @ covariance @ slope.T)
    spread = np.ones_like(share) if score is None else 1 - share
    informed = spread > _LEAST_SHARE
    chi2 = np.sum((axes.T @ off)[informed] ** 2 / spread[informed])
    return float(scipy.stats.chi2.sf(chi2, informed.sum())) if informed.any() else 1.0


def _prior_terms(
    priors: Priors, parameters: Parameters, names, free
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the terms of the n numbers that have priors.

    They are slopes (n, p), distances from the means (n,), and a matrix that whitens these (n, n).
    """
    values = np.asarray(to_vector(parameters)[0])[list(free)]
    known = priors.on(names)
    rows, terms = [names.index(name) for name in known], np.reshape([*known.values()], (-1, 2))
    slope, off, whiten = np.eye(len(names))[rows], values[rows] - terms[:, 0], np.diag(1 / terms[:, 1])
    if priors.moments is None:
        return slope, off, whiten
    locus, (mean, covariance) = parameters.locus, priors.moments
    turn, varied = np.zeros((3, len(names))), [name in names for name in locus.names]
    columns = [names.index(name) for name in locus.names if name in names]
    turn[:, columns] = jax.jacfwd(lambda c: locus.at(c).moments())(locus.coords)[:, varied]
    slope, off = np.vstack([slope, turn]), np.concatenate([off, np.asarray(locus.moments()) - mean])
    return slope, off, scipy.linalg.block_diag(whiten, np.linalg.inv(np.linalg.cholesky(covariance)))
