"""The starting point of a fit: a scene that was found, fitted briefly with everything free."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jitterkit.forward import Parameters, expected_image, free_parameters
from jitterkit.likelihood import Data, pearson
from jitterkit.linearisation import LINEARISATION_TOLERANCE, linearisation_error, relinearised_scoring
from jitterkit.loci.base import Locus
from jitterkit.loci.elliptic import Mvn
from jitterkit.metric import invert_information
from jitterkit.optics.otf import OTF
from jitterkit.optics.system import Optics
from jitterkit.scene import Scene
from jitterkit.scoring import Prior

_SURE = 6.0  # spreads that chi-squared may be too large by: a rough start adds two, a faint companion more
_CLOSE, _NEARBY = 0.1, 0.5  # standard errors that a template may be off, and a start: no step more is needed
_ADDED = 0.02  # deviance per pixel that the optics of a start may add by being off
_EXACT = 0.1 * LINEARISATION_TOLERANCE  # sigmas of the whole image that the optics of a start may be off by
_SQUARED = 0.6  # share of its slope that an aberration has about no aberrations, if it shows by its square
_SHOWING = 3.0  # standard errors from which the sign of an aberration may matter
_ABERRATION_PRIOR = 30.0  # nm: a regularizing prior, which bounds the aberrations of a wrong candidate

_image = eqx.filter_jit(expected_image)


@dataclass(frozen=True)
class Start:
    """Hold the starting point of a fit.

    Attributes
    ----------
    parameters : Parameters
        With a normal locus, fitted briefly.
    otf : OTF
        About aberrations very near theirs.
    deviance_dof : float
        Deviance a pixel; about one if all is well.
    information : (p, p) array
    names : tuple of str
        Of what was fitted.
    """

    parameters: Parameters
    otf: OTF
    deviance_dof: float
    information: np.ndarray
    names: tuple[str, ...]

    @property
    def covariance(self) -> np.ndarray:
        """Return the covariance (3, 3) of the moments ``(Sxx, Sxy, Syy)``, arcsec⁴; NaN if undetermined."""
        return self.covariance_of(Mvn.names)

    def covariance_of(self, names: Sequence[str]) -> np.ndarray:
        """Return the covariance of parameters that were fitted."""
        index = [self.names.index(name) for name in names]
        return invert_information(self.information)[0][np.ix_(index, index)]

    def describes(self, data: Data) -> bool:
        """Return True if the residual is no larger than noise and the briefness of the fit explain."""
        misfit = pearson(_image(self.parameters, self.otf), data)
        return misfit.chi2 < misfit.pixels + _SURE * misfit.spread


def with_best_signs(
    start: Start, data: Data, optics: Optics, hold: Collection[str], *, rough: bool = False
) -> Start:
    """Try the other sign of aberrations that a frame shows to second order first.

    Parameters
    ----------
    start : Start
    data, optics, hold, rough
        As for :func:`~jitterkit.locate.locate_binary`.

    Returns
    -------
    start : Start
        The same where no other sign fits better.

    Notes
    -----
    A pupil that is nearly its own mirror image shows focus and astigmatism by their squares and by their
    products.  So the likelihood has several maxima, at which the sign of one differs, or of all, and a jitter
    makes up for the difference: of 30 frames with aberrations of 10 nm three ended at a wrong one, 300 lower
    in deviance, which chi-squared did not show.
    """
    value = start.parameters.aberrations
    known = [name for name in start.otf.modes if name in start.names]
    if not known:
        return start
    sizes = np.sqrt(np.diag(start.covariance_of(known)))
    both = optics.system.nominal, start.otf
    first, here = (np.linalg.norm(np.asarray(one.jacobian), axis=(1, 2)) for one in both)
    positions = [start.otf.names.index(name) for name in known]
    turned = [
        i
        for i, size in zip(positions, sizes, strict=True)
        if first[i] < _SQUARED * here[i] and abs(value[i]) > _SHOWING * size
    ]
    given = start
    for turning in [[i] for i in turned] + [turned] * (len(turned) > 1):
        state = np.array(start.parameters.aberrations)
        state[turning] *= -1
        where = optics.otf(state), start.parameters.scene, start.parameters.locus
        candidate = _fitted_briefly(data, optics, *where, hold, rough=True)
        if candidate.deviance_dof < start.deviance_dof:
            start = candidate
    if start is given:
        return start
    start = with_exact_slopes(start, optics)
    return start if rough else settled(start, data, optics, hold)


def polished(
    data: Data,
    optics: Optics,
    otf: OTF,
    scene: Scene,
    jitter: Locus | None,
    hold: Collection[str],
    *,
    rough: bool = False,
    slopes: bool = True,
) -> Start:
    """Fit a candidate briefly with everything free, about ``otf`` and then about its maximum.

    Parameters
    ----------
    data, optics, hold, rough
        As for :func:`~jitterkit.locate.locate_binary`.
    otf : OTF
        Optics to begin with, about any state.
    scene : Scene
    jitter : Locus or None
        To begin with; None for none.
    slopes : bool
        Whether to renew the derivatives of the optics too: nine tenths of the work, which a candidate that
        may be discarded does not need (:func:`with_exact_slopes`).
    """
    start = _fitted_briefly(data, optics, otf, scene, jitter, hold, rough=rough)
    if linearisation_error(optics, start.parameters, start.otf) < _EXACT:
        return start
    state = start.parameters.aberrations
    return replace(start, otf=optics.otf(state) if slopes else optics.near(state, start.otf))


def settled(start: Start, data: Data, optics: Optics, hold: Collection[str]) -> Start:
    """Fit a start of a rough search until its optics are exact."""
    p = start.parameters
    return polished(data, optics, start.otf, p.scene, p.locus, hold)


def with_exact_slopes(start: Start, optics: Optics) -> Start:
    """Expand the optics of a start about its own aberrations."""
    return replace(start, otf=optics.otf(start.parameters.aberrations)) if start.otf.names else start


def _fitted_briefly(
    data: Data,
    optics: Optics,
    otf: OTF,
    scene: Scene,
    jitter: Locus | None,
    hold: Collection[str],
    *,
    rough: bool,
) -> Start:
    """Return the fit with the optics of its last expansion, which are about a state less near its own."""
    locus = Mvn.near(jnp.zeros(3)) if jitter is None else jitter
    here = Parameters(otf.with_colours(scene), locus, otf.state)
    names, free = free_parameters(here, otf, hold)
    prior = Prior(
        jnp.zeros(len(free)), jnp.diag(jnp.array([_ABERRATION_PRIOR**-2 * (n in otf.names) for n in names]))
    )
    used = max(int(np.sum(np.asarray(data.used))), 1)
    end, otf, *_ = relinearised_scoring(
        here,
        otf,
        optics,
        data,
        free,
        prior,
        max_error=float(np.sqrt(_ADDED * used)) if rough else LINEARISATION_TOLERANCE,
        max_expansions=5,
        max_steps=15,
        tolerance=_NEARBY if rough else _CLOSE,
        keep_slopes=rough,
    )
    return Start(end.parameters, otf, float(end.objective) / used, np.asarray(end.information), names)
