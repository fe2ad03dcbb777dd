"""Maxima of the likelihood that are not regular: no slope, a kink at zero length, an impossible blur."""

from __future__ import annotations

import math
from collections.abc import Collection

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jitterkit.forward import parameter_names, to_vector
from jitterkit.likelihood import normal_equations
from jitterkit.loci import (
    Locus,
    Mvn,
    PartialShm,
    Path,
    Product,
    Shaped,
    Streak,
    axis_variances,
    covariance_on_axis,
)
from jitterkit.metric import invert_information
from jitterkit.optics.otf import OTF
from jitterkit.scoring_loop import ScoringResult

_SIGMAS = 3.0
"""Standard errors from zero below which a streak's length cannot be distinguished from zero."""

_HIDDEN = 2.0
"""Standard errors from zero below which a mode that shows by its square may be none: 1 of 20 by chance."""

_SETTLED, _SETTLED_IN_VALLEY = 0.01, 0.1
"""Largest step that is left, in standard errors, where the steps of a fit ran out: in a faint frame, or at
zero length of all but a streak's length; and of all but the parameters of a valley (1 of 100 frames)."""

_IMPOSSIBLE = 2.0
"""Standard errors by which a variance of the pointing is below zero where its own error may be too small."""


def at_zero_length(locus: Locus, names: tuple[str, ...], covariance: np.ndarray) -> set[str]:
    """Return the names of the coordinates of streaks whose length cannot be distinguished from zero.

    Parameters
    ----------
    locus : Locus
        A streak, or a product with streaks among its parts.
    names : tuple of str
        Of the free parameters.
    covariance : (p, p) array
        Of the free parameters.
    """
    variance = dict(zip(names, np.diag(covariance), strict=True))
    found: set[str] = set()
    of_parts = iter(locus.names)
    for part in locus.factors() if isinstance(locus, Product) else (locus,):
        own = [next(of_parts) for _ in part.coords]
        if isinstance(part, Streak):
            square, spread = float(np.sum(np.square(part.coords))), max(variance.get(n, 0.0) for n in own)
            found |= set(own) if square < _SIGMAS**2 * spread else set()
    return found


def regularizing_priors(locus: Locus) -> dict[str, tuple[float, float]]:
    """Return weak priors, mean and sigma by name, on what a small blur does not show of a locus.

    Without them a fit would run off along a direction in which the image does not change.

    Parameters
    ----------
    locus : Locus
        Where the fit starts.

    Returns
    -------
    priors : dict
        For a partial vibration the square of its cycles, 1 ± 2, and its even share, 0 ± 0.6; for a shaped
        blur its kurtosis, 0 ± 2; for a path of four knots its steps, 0 ± 1.5 times the rms of the whole, and
        shorter ones for more, as of a random walk.  Empty for all other loci.
    """
    if isinstance(locus, Path):
        sxx, _, syy = np.asarray(locus.moments())
        return dict.fromkeys(locus.names, (0.0, step_of_path(locus.knots) * float(np.sqrt(sxx + syy))))
    if isinstance(locus, PartialShm):
        return dict(zip(locus.names[2:], ((1.0, 2.0), (0.0, 0.6)), strict=True))
    return {locus.names[3]: (0.0, 2.0)} if isinstance(locus, Shaped) else {}


def step_of_path(knots: int) -> float:
    """Return the sigma of a path's steps along an axis, in units of the rms of the whole.

    1.5 for four knots; of more, shorter steps, as the whole of a random walk is as large then.
    """
    return 1.5 * math.sqrt(3 / (knots - 1))


def minor_variance(moments, covariance) -> tuple[float, float]:
    """Variance along the minor axis of second moments and its error, arcsec²; noise may make it negative."""
    _, minor, angle = axis_variances(moments)
    variance = covariance_on_axis(covariance, angle)[2, 2]  # a straight locus has none but for rounding
    return minor, float(np.sqrt(np.maximum(variance, 0.0)))


def hidden_squares(
    end: ScoringResult, names: tuple[str, ...], unseen: Collection[str], aberrations, covariance
) -> set[str]:
    """Return the modes of a mirror-symmetric pupil whose squares noise hides: steps to zero do not settle.

    Parameters
    ----------
    end : ScoringResult
    names : tuple of str
        Of the free parameters.
    unseen : collection of str
        Modes that a symmetric pupil shows by their squares only.
    aberrations : tuple of str
        Names of all aberrations of the parameters.
    covariance : (p, p) array
        Of the free parameters.
    """
    modes = [(i, name) for i, name in enumerate(names) if name in unseen]
    vector = np.asarray(to_vector(end.parameters)[0])
    every = parameter_names(end.parameters, aberrations)
    value = {name: vector[every.index(name)] for _, name in modes}
    return {name for i, name in modes if abs(value[name]) < _HIDDEN * np.sqrt(covariance[i, i])}


def convergence(
    end: ScoringResult, names: tuple[str, ...], unseen: Collection[str], aberrations, exact: bool
) -> tuple[bool, bool]:
    """Return whether a fit has converged, but for what need not, and whether a streak ended at zero length.

    Parameters
    ----------
    end, names, unseen, aberrations
        As for :func:`hidden_squares`.
    exact : bool
        Whether the optics are exact where it ended; if not, a short step says nothing.
    """
    covariance, sound = invert_information(end.curvature)
    converged, locus = bool(end.converged), end.parameters.locus
    if converged or not sound:
        return converged, False
    zero_length, regularized = at_zero_length(locus, names, covariance), set(regularizing_priors(locus))
    exempt = zero_length | regularized | hidden_squares(end, names, unseen, aberrations, covariance)
    if exact or exempt:
        others = [i for i, name in enumerate(names) if name not in exempt]
        score, curvature = np.asarray(end.score)[others], np.asarray(end.curvature)[np.ix_(others, others)]
        tolerance = _SETTLED_IN_VALLEY if regularized else _SETTLED
        converged = bool(score @ np.linalg.solve(curvature, score) < tolerance**2)
    return converged, converged and bool(zero_length)


def with_possible_errors(end: ScoringResult, data, otf: OTF, names: tuple[str, ...]) -> ScoringResult:
    """Return the end of a fit with the information of the nearest blur that is possible.

    A variance that noise makes negative sharpens the modelled stars.  Where pixels undersample them, a faint
    star ends so near the limit, minus the pixel's own variance, that errors of its place and blur are up to
    seven times too small there.
    """
    locus = end.parameters.locus
    if not isinstance(locus, Mvn) or not set(Mvn.names) <= set(names):
        return end
    covariance, sound = invert_information(end.curvature)
    index = [names.index(name) for name in Mvn.names]
    moments = np.asarray(locus.moments())
    minor, error = minor_variance(moments, covariance[np.ix_(index, index)])
    if not sound or not minor < -_IMPOSSIBLE * error:
        return end
    values, axes = np.linalg.eigh(moments[[0, 1, 1, 2]].reshape(2, 2))
    possible = ((axes * np.maximum(values, 0.0)) @ axes.T)[[0, 0, 1], [0, 1, 1]]
    near = eqx.tree_at(lambda p: p.locus, end.parameters, Mvn.near(jnp.asarray(possible)))
    every = parameter_names(near, otf.names)
    free = tuple(i for i, name in enumerate(every) if name in names)
    information = normal_equations(near, otf, data, free, exact=False).information
    return end._replace(information=information, curvature=information + end.curvature - end.information)
