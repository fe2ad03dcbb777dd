"""One locus for all stars of a field: a fit of every star at once.

Each star has a place, a flux and a sky of its own; the locus is shared.  The normal equations of the stars
add up in the shared coordinates, once each star's own four parameters are eliminated; what is left of
its score says how far it disagrees with the others, and so the errors contain the scatter.
"""

from __future__ import annotations

from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jitterkit.forward import Parameters
from jitterkit.likelihood import Data, normal_equations
from jitterkit.loci import Locus
from jitterkit.optics import OTF
from jitterkit.scene import Star
from jitterkit.starfield.moments import Moments, Stars

_CHUNK = 32
"""Stars per call, the last call filled up: the number of stars must not cause a new compilation."""

_STEPS = 40
_CONVERGED = 1e-3
"""Length of a step of the shared coordinates, in standard errors, that ends the fit."""

_LEAST = 3
"""Stars from which a scatter can be determined."""

_OUTLIER = 12.0
"""A star is left out whose disagreement, in units of the typical one's, is larger: its neighbours show."""


@dataclass(frozen=True, eq=False)
class JointFit:
    """A locus that all stars share.

    Attributes
    ----------
    locus : Locus
    covariance : (k, k) array
        Of the locus's coordinates, scatter from star to star included where it is larger than the noise.
    deviances : (n,) array
        Of each star; NaN where it is not used.
    pixels : int
        How many count.
    chi2, dof : float, int
        Of one locus for all: whether it varies over the field.
    used : (n,) bool array
    """

    locus: Locus
    covariance: np.ndarray
    deviances: np.ndarray
    pixels: int
    chi2: float
    dof: int
    used: np.ndarray

    def fits_better(self, other: JointFit) -> bool:
        """Return whether it fits the stars better that both use; a fit may leave out those that tell."""
        both = self.used & other.used
        return bool(self.deviances[both].sum() < other.deviances[both].sum())


@dataclass(frozen=True, eq=False)
class _Point:
    """A place on the way, and each star's equations there."""

    coords: np.ndarray
    own: np.ndarray
    deviance: np.ndarray
    score: np.ndarray
    information: np.ndarray


def fit_joint(stars: Stars, moments: Moments, otf: OTF, start: Locus) -> JointFit:
    """Fit one locus to all stars.

    Parameters
    ----------
    stars : Stars
    moments : Moments
        Where each star's position and flux start.
    otf : OTF
        Of the sharp PSF on a stamp's grid, plate scale 1: everything here is in pixels.
    start : Locus
        Its kind and where it starts.

    Returns
    -------
    fit : JointFit

    Notes
    -----
    Shifted Poisson likelihood, damped Fisher scoring.  Errors come from the information, or from the
    scatter of the stars' scores about zero (the sandwich) where that is larger.
    """
    used = np.ones(len(stars), bool)
    own = np.stack([*moments.centre.T, moments.flux, np.zeros(len(stars))], axis=1)
    coords = np.asarray(start.coords)
    for last in (False, False, True):
        some = stars.chosen(used)
        point = _scoring_loop(some, own[used], coords, otf, start)
        own[used], coords = point.own, point.coords
        score, information = _profiled(point)
        disagreement = np.einsum("na,na->n", score, np.linalg.solve(information, score[..., None])[..., 0])
        typical = max(float(np.median(disagreement)) / len(coords), 0.7)
        kept = disagreement < _OUTLIER * typical * len(coords)
        if last or kept.all():
            break
        used[used] = kept
    deviances = np.full(len(stars), np.nan)
    deviances[used] = point.deviance
    return JointFit(
        start.at(jnp.asarray(coords)),
        _covariance(score, information),
        deviances,
        int(some.used.sum()),
        float(disagreement.sum()),
        len(coords) * (len(some) - 1),
        used,
    )


def _scoring_loop(stars: Stars, own: np.ndarray, coords: np.ndarray, otf: OTF, kind: Locus) -> _Point:
    """Maximise the likelihood by damped scoring in all stars' own parameters and the shared ones."""
    here, damping = _evaluate(stars, own, coords, otf, kind), 1e-3
    for _ in range(_STEPS):
        own_step, step, length = _step(here, damping)
        there = _evaluate(stars, here.own + own_step, here.coords + step, otf, kind)
        better = there.deviance.sum() <= here.deviance.sum() + 1e-9 * abs(here.deviance.sum())
        better = better and bool(np.all(there.own[:, 2] > 0))
        here, damping = (there, damping / 10) if better else (here, damping * 10)
        if (better and length < _CONVERGED) or damping > 1e8:
            break
    return here


def _step(point: _Point, damping: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Steps of each star's own parameters (n, 4) and of the shared ones, and the latter's length."""
    damped = point.information * (1 + damping * np.eye(point.information.shape[-1]))
    score, information = _profiled(point, damped)
    total = information.sum(0)
    step = np.linalg.solve(total, score.sum(0))
    left = point.score[:, :4] - damped[:, :4, 4:] @ step
    own = np.linalg.solve(damped[:, :4, :4], left[..., None])[..., 0]
    return own, step, float(np.sqrt(step @ total @ step))


def _profiled(point: _Point, information: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Score (n, k) and information (n, k, k) of the shared coordinates, each star's own eliminated."""
    information = point.information if information is None else information
    mixed = information[:, :4, 4:]
    gain = np.swapaxes(np.linalg.solve(information[:, :4, :4], mixed), 1, 2)
    score = point.score[:, 4:] - (gain @ point.score[:, :4, None])[..., 0]
    return score, information[:, 4:, 4:] - gain @ mixed


def _covariance(score: np.ndarray, information: np.ndarray) -> np.ndarray:
    """Return the covariance by the information or by the scatter of the scores, whichever is larger."""
    noise = np.linalg.inv(information.sum(0))
    if len(score) < _LEAST:
        return noise
    scatter = noise @ (score.T @ score) @ noise * len(score) / (len(score) - 1)
    return scatter if np.trace(np.linalg.solve(noise, scatter)) > len(noise) else noise


def _evaluate(stars: Stars, own: np.ndarray, coords: np.ndarray, otf: OTF, kind: Locus) -> _Point:
    """Return each star's deviance, score and information, its own four parameters first."""
    n, parts = len(stars), []
    for first in range(0, n, _CHUNK):
        rows = np.minimum(np.arange(first, first + _CHUNK), n - 1)
        chunk = stars.chosen(rows)
        read = chunk.sky_variance * chunk.response**2  # as of the counts before the division
        data = Data(chunk.electrons, read, chunk.used, response=chunk.response)  # mapped over below
        parts.append(_equations(own[rows], coords, otf, kind, data))
    deviance, score, information = (np.concatenate([np.asarray(p[i]) for p in parts])[:n] for i in range(3))
    k = len(coords)
    order = [0, 1, 2, 3 + k, *range(3, 3 + k)]
    return _Point(coords, own, deviance, score[:, order], information[:, order][:, :, order])


@eqx.filter_jit
def _equations(own, coords, otf, kind, data):
    """Return the normal equations of stars ``(m, ...)`` in all their parameters."""

    def one(own, data):
        x, y, flux, sky = own
        parameters = Parameters(Star(x, y, flux), kind.at(jnp.asarray(coords)), (), sky)
        return normal_equations(parameters, otf, data, tuple(range(4 + coords.size)))

    return jax.vmap(one)(own, data)
