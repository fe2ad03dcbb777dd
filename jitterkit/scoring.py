"""Damped Fisher scoring: the one way in which jitterkit maximises a likelihood.

The step is ``(F + λ diag F)⁻¹ g`` with the expected information F and the score g (Levenberg and
Marquardt's damping of what the paper calls natural gradient descent).  It is invariant to the units
of the parameters, and the loop is a single compiled program: no Python between its steps.
"""

from __future__ import annotations

from collections.abc import Collection
from itertools import pairwise

import jax
import numpy as np
from jaxtyping import Array, Float

from jitterkit.errors import ErrorCode, refuse_if
from jitterkit.forward import Parameters, free_parameters
from jitterkit.likelihood import Data
from jitterkit.loci.simple import AnySimple
from jitterkit.metric import Prior, invert_information
from jitterkit.optics.otf import OTF
from jitterkit.scoring_loop import FINAL_ERROR, ScoringResult, scoring_loop


def fisher_scoring(
    start: Parameters,
    otf: OTF,
    data: Data,
    free: tuple[int, ...],
    prior: Prior,
    *,
    max_steps: int = 50,
    tolerance: float = 1e-4,
    known: Float[Array | np.ndarray, "p p"] | None = None,
    errors: bool = True,
) -> ScoringResult:
    """Maximise the posterior from a starting point.

    Parameters
    ----------
    start : Parameters
    otf : OTF
        Aberrations enter to first order about its state.
    data : Data
    free : tuple of int
        Positions in the parameter vector that vary, ascending.
    prior : Prior
    max_steps : int
        Largest number of evaluations, rejected ones included.
    tolerance : float
        Length of a step, in standard errors, below which the iteration has converged.
    known : (p, p) array, optional
        Information near the start, to begin with: it is renewed where it turns out to be wrong.  Not used
        where the derivatives that belong to it are needed too.
    errors : bool
        Whether errors at the end are wanted; otherwise the information is the last that served for a step.

    Returns
    -------
    result : ScoringResult

    Raises
    ------
    ConfigurationError
        If the positions do not ascend.
    """
    problem = f"The positions of free parameters must ascend, and {free} do not; sort them."
    refuse_if(any(one >= other for one, other in pairwise(free)), ErrorCode.MALFORMED, problem)
    known = np.zeros((len(free), len(free))) if known is None else known
    # as arrays, so that another number of steps is not another program
    limits = np.asarray(max_steps), np.asarray(tolerance), np.asarray(FINAL_ERROR if errors else np.inf)
    # nor is a ceiling that the likelihood does not ask for, nor another simple locus
    data, simple = data.for_likelihood, AnySimple.instead_of(start.locus)
    if simple is None:
        return _in_numpy(scoring_loop(start, otf, data, free, prior, known, *limits))
    filled, own = _filled_up(start, simple, free)
    places, square = np.eye(len(filled))[:, own], np.ix_(own, own)
    prior, known = _in_numpy((prior, known))
    precision = places @ prior.precision @ places.T + np.diag(1 - places.sum(axis=1))
    wider = Prior(places @ prior.mean, precision, prior.moments, prior.moments_precision)
    known = places @ known @ places.T
    end = _in_numpy(scoring_loop(start.with_locus(simple), otf, data, filled, wider, known, *limits))
    coords = end.parameters.locus.coords[: len(start.locus.names)]
    return end._replace(
        parameters=end.parameters.with_locus(start.locus.at(coords)),
        information=end.information[square],
        curvature=end.curvature[square],
        score=end.score[own],
    )


def _filled_up(
    start: Parameters, simple: AnySimple, free: tuple[int, ...]
) -> tuple[tuple[int, ...], np.ndarray]:
    """Return the positions of what varies with a locus in its common form, and which of these are its own."""
    size = len(start.locus.names)
    first = sum(np.size(leaf) for leaf in jax.tree.leaves(start.scene)) + size
    lacking = range(first, first + len(simple.names) - size)
    before = sum(index < first for index in free)
    filled = (*free[:before], *lacking, *(index + len(lacking) for index in free[before:]))
    own = np.delete(np.arange(len(filled)), range(before, before + len(lacking)))
    return filled, own


def _in_numpy(tree):
    """Return a tree with arrays of NumPy, with which small sums are fast, but for what a program traces."""
    return jax.tree.map(lambda a: a if isinstance(a, jax.core.Tracer) else np.asarray(a), tree)


def fisher_scoring_without_prior(
    start: Parameters,
    otf: OTF,
    data: Data,
    hold: Collection[str],
    max_steps: int,
    known: Float[Array | np.ndarray, "p p"] | None = None,
) -> tuple[ScoringResult, np.ndarray]:
    """Take a few steps of Fisher scoring without a prior.

    Parameters
    ----------
    start : Parameters
    otf : OTF
    data : Data
    hold : collection of str
        Parameters to keep as they are.
    max_steps : int
        Largest number of evaluations, rejected ones included.
    known : (p, p) array, optional
        Information near the start.

    Returns
    -------
    end : ScoringResult
    covariance : (k, k) array
        Of the locus's free coordinates there; NaN where the frame does not determine the parameters.
    """
    names, free = free_parameters(start, otf, hold)
    end = fisher_scoring(start, otf, data, free, Prior.none(len(free)), max_steps=max_steps, known=known)
    index = [names.index(name) for name in start.locus.names if name in names]
    covariance, _ = invert_information(end.information)
    return end, covariance[np.ix_(index, index)]
