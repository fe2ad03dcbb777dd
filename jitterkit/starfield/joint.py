"""One locus for all stars of a field: a fit of every star at once.

Each star has a place, a flux and a sky of its own; the locus is shared.  The normal equations of the stars
add up in the shared coordinates, once each star's own four parameters are eliminated; what is left of
its score says how far it disagrees with the others, and so the errors contain the scatter.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

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


class PsfNoise(NamedTuple):
    """Noise of a measured PSF, which a blur smooths: without it, more blur would fit better.

    Attributes
    ----------
    error : (s, s) array
        Standard error of a PSF of sum one, on the stars' stamps.
    power : (ny, nx) array
        Of this noise in the transfer function, on its frequencies, relative to white noise.
    left : float
        Share of it that the blur leaves, about: so much is taken for noise of the stars.
    """

    error: np.ndarray
    power: np.ndarray
    left: float


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

    def fits_better(self, other: JointFit, by: float = 0.0) -> bool:
        """Return whether its deviance is lower by more than ``by``, of the stars that both use.

        A fit may leave out those that tell.
        """
        both = self.used & other.used
        return bool(self.deviances[both].sum() < other.deviances[both].sum() - by)


@dataclass(frozen=True, eq=False)
class _Point:
    """A place on the way, and each star's equations there."""

    coords: np.ndarray
    own: np.ndarray
    deviance: np.ndarray
    score: np.ndarray
    information: np.ndarray


def left_of(locus: Locus, otf: OTF, power=1.0):
    """Return the share of a noise, of some power by frequency, that a locus leaves."""
    fy, fx = otf.grid.frequencies
    return jnp.mean(jnp.abs(locus.transfer(fx, fy)) ** 2 * power)


class _Excess(NamedTuple):
    """What the noise of the PSF adds to the deviance, of each star for a flux of one (n,).

    It grows with the share of this noise that the blur leaves.
    """

    added: np.ndarray
    power: np.ndarray
    left: float

    def chosen(self, which: np.ndarray) -> _Excess:
        return self._replace(added=self.added[which])

    def of(self, flux, locus: Locus, otf: OTF):
        """Return it; beyond ``left`` by the logarithm, or a fit would sharpen the noise without end."""
        ratio = left_of(locus, otf, self.power) / self.left
        return self.added * flux**2 * (jnp.minimum(ratio, 1) + jnp.log(jnp.maximum(ratio, 1)))


def fit_joint(
    stars: Stars, moments: Moments, otf: OTF, start: Locus, noise: PsfNoise | None = None
) -> JointFit:
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
    noise : PsfNoise, optional
        Of the PSF.

    Returns
    -------
    fit : JointFit

    Notes
    -----
    Shifted Poisson likelihood, damped Fisher scoring.  Errors come from the information, or from the
    scatter of the stars' scores about zero (the sandwich) where that is larger.

    The PSF's noise adds to that of the stars, and what it adds to the deviance on average, in proportion to
    what the blur leaves of white noise, is taken off.
    """
    if noise is None:
        noise = PsfNoise(np.zeros(stars.electrons.shape[1:]), np.ones(1), 1.0)
    variance = noise.left * (moments.flux[:, None, None] * noise.error) ** 2
    stars = replace(stars, sky_variance=stars.sky_variance + variance)
    added = np.sum(np.where(stars.used, variance / stars.variance, 0.0), axis=(1, 2)) / moments.flux**2
    excess = _Excess(added, noise.power, noise.left)
    used = np.ones(len(stars), bool)
    own = np.stack([*moments.centre.T, moments.flux, np.zeros(len(stars))], axis=1)
    coords = np.asarray(start.coords)
    for last in (False, False, True):
        some = stars.chosen(used)
        point = _scoring_loop(some, own[used], coords, otf, start, excess.chosen(used))
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


def _scoring_loop(
    stars: Stars, own: np.ndarray, coords: np.ndarray, otf: OTF, kind: Locus, excess: _Excess
) -> _Point:
    """Maximise the likelihood by damped scoring in all stars' own parameters and the shared ones."""
    here, damping = _evaluate(stars, own, coords, otf, kind, excess), 1e-3
    for _ in range(_STEPS):
        own_step, step, length = _step(here, damping)
        there = _evaluate(stars, here.own + own_step, here.coords + step, otf, kind, excess)
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


def _evaluate(
    stars: Stars, own: np.ndarray, coords: np.ndarray, otf: OTF, kind: Locus, excess: _Excess
) -> _Point:
    """Return each star's deviance, score and information, its own four parameters first."""
    n, parts = len(stars), []
    for first in range(0, n, _CHUNK):
        rows = np.minimum(np.arange(first, first + _CHUNK), n - 1)
        chunk = stars.chosen(rows)
        read = chunk.sky_variance * chunk.response**2  # as of the counts before the division
        data = Data(chunk.electrons, read, chunk.used, response=chunk.response)  # mapped over below
        parts.append(_equations(own[rows], jnp.asarray(coords), otf, kind, data, excess.chosen(rows)))
    deviance, score, information = (np.concatenate([np.asarray(p[i]) for p in parts])[:n] for i in range(3))
    k = len(coords)
    order = [0, 1, 2, 3 + k, *range(3, 3 + k)]
    return _Point(coords, own, deviance, score[:, order], information[:, order][:, :, order])


@eqx.filter_jit
def _equations(own, coords, otf, kind, data, excess):
    """Return the normal equations of stars ``(m, ...)`` in all their parameters."""

    def one(own, data, added):
        x, y, flux, sky = own
        values = jnp.concatenate([flux[None], coords])

        def more(values):
            return excess._replace(added=added).of(values[0], kind.at(values[1:]), otf)

        parameters = Parameters(Star(x, y, flux), kind.at(coords), (), sky)
        deviance, score, information = normal_equations(parameters, otf, data, tuple(range(4 + coords.size)))
        of_noise, slope = jax.value_and_grad(more)(values)
        return deviance - of_noise, score.at[2 : 3 + coords.size].add(slope / 2), information

    return jax.vmap(one)(own, data, excess.added)
