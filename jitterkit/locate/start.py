"""From a frame to starting values for a fit.

A faint companion of a bright star hides in the mismatch between the star and its template.  So the
search goes round: candidates are fitted briefly with the jitter and the aberrations free, and if the
best of them does not describe the frame, the template takes its jitter and aberrations and the
search begins anew.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jitterkit.forward import Parameters, expected_image, free_parameters
from jitterkit.likelihood import Data, pearson
from jitterkit.linearisation import SETTLED, climb_and_expand
from jitterkit.locate.pair import FoundPair, find_pairs, find_star, resolution
from jitterkit.loci.base import Locus
from jitterkit.loci.mvn import Mvn
from jitterkit.metric import invert_information
from jitterkit.optics.anchor import AnchoredOptics
from jitterkit.optics.otf import OTF
from jitterkit.optics.system import Optics
from jitterkit.scene import Binary, Scene
from jitterkit.scoring import Prior

__all__ = ["Start", "locate_binary", "locate_star", "polished", "with_best_signs"]

_ROUNDS = 4
_GOOD_ENOUGH = 1.15  # deviance per pixel that no wrong companion reaches in a bright frame
_SURE = 6.0  # spreads that chi-squared may be too large by: a rough start adds two, a faint companion more
_WORTH_IT = 0.97  # a round that improves the deviance by less was the last
_CLOSE, _NEARBY = 0.1, 0.5  # standard errors that a template may be off, and a start: no step more is needed
_ADDED = 0.02  # deviance per pixel that the optics of a start may add by being off
_SQUARED = 0.6  # share of its slope that an aberration has about no aberrations, if it shows by its square
_SHOWING = 3.0  # standard errors from which the sign of an aberration may matter
_LEASH = 30.0  # nm: keeps the aberrations of a wrong candidate from running away

_image = eqx.filter_jit(expected_image)


@dataclass(frozen=True)
class Start:
    """Where a fit begins.

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
        """Of the moments ``(Sxx, Sxy, Syy)``, (3, 3), arcsec⁴; NaN where the frame does not tell them."""
        return self.covariance_of(Mvn.names)

    def covariance_of(self, names: Sequence[str]) -> np.ndarray:
        """Of parameters that were fitted."""
        slots = [self.names.index(name) for name in names]
        return invert_information(self.information)[0][np.ix_(slots, slots)]

    def describes(self, data: Data) -> bool:
        """Whether it leaves no more of a frame than noise and its own haste."""
        misfit = pearson(_image(self.parameters, self.otf), data)
        return misfit.chi2 < misfit.pixels + _SURE * misfit.spread


def locate_star(
    data: Data, optics: Optics, hold: Collection[str] = ("background",), *, rough: bool = False
) -> Start | None:
    """Find a star anywhere in a frame and starting values for all of its parameters.

    Parameters
    ----------
    data, optics, hold, rough
        As for :func:`locate_binary`.

    Returns
    -------
    start : Start or None
        None if no star rises above the noise.
    """
    otf, jitter, best = optics.nominal, None, None
    for _ in range(_ROUNDS):
        star = find_star(data, otf, jitter)
        if star is None:
            break
        trial = polished(data, optics, otf, star, jitter, hold, rough=rough)
        if best is not None and not trial.deviance_dof < _WORTH_IT * best.deviance_dof:
            break
        best = trial
        if best.describes(data):
            break
        otf, jitter = best.otf, best.parameters.locus
    return None if best is None else with_best_signs(best, data, optics, hold, rough=rough)


def locate_binary(
    data: Data, optics: Optics, hold: Collection[str] = ("background",), *, rough: bool = False
) -> Start | None:
    """Find a binary anywhere in a frame and starting values for all of its parameters.

    Parameters
    ----------
    data : Data
    optics : Optics
    hold : collection of str
        Parameters that the fit to come will hold: the background, unless there is sky.
    rough : bool
        Whether to leave the last steps to a fit of everything that is to follow.

    Returns
    -------
    start : Start or None
        None if no star rises above the noise.
    """
    otf: OTF = optics.nominal
    jitter: Locus | None = None
    best: Start | None = None
    tried: list[Binary] = []
    near = 0.1 * resolution(otf)
    for _ in range(_ROUNDS):
        before = np.inf if best is None else best.deviance_dof
        for pair in _candidates(data, otf, jitter, best):
            if not _is_new(pair.scene, tried, near):
                continue
            tried.append(pair.scene)
            trial = polished(data, optics, otf, pair.scene, jitter, hold, rough=rough)
            if best is None or trial.deviance_dof < best.deviance_dof:
                best = trial
            if best.deviance_dof < _GOOD_ENOUGH and best.describes(data):
                return with_best_signs(best, data, optics, hold, rough=rough)
        if best is None or best.deviance_dof > _WORTH_IT * before:
            break
        otf, jitter = best.otf, best.parameters.locus
    return None if best is None else with_best_signs(best, data, optics, hold, rough=rough)


def with_best_signs(
    start: Start, data: Data, optics: Optics, hold: Collection[str], *, rough: bool = False
) -> Start:
    """Try the other sign of aberrations that a frame shows to second order first.

    Parameters
    ----------
    start : Start
    data, optics, hold, rough
        As for :func:`locate_binary`.

    Returns
    -------
    start : Start
        The same where no other sign fits better.

    Notes
    -----
    A pupil that is nearly its own mirror image shows focus and astigmatism by their squares and by their
    products.  So there are several hills, on which the sign of one differs, or of all, and a jitter stands in
    for what that leaves: of 30 frames with aberrations of 10 nm three climbed a wrong one, 300 lower in
    deviance, which chi-squared did not show.
    """
    value = start.parameters.aberrations
    known = [name for name in start.otf.names if name in start.names]
    if not known:
        return start
    sizes = np.sqrt(np.diag(start.covariance_of(known)))
    flat = optics.system.nominal if isinstance(optics, AnchoredOptics) else optics.nominal
    first, here = (np.linalg.norm(np.asarray(one.jacobian), axis=(1, 2)) for one in (flat, start.otf))
    places = [start.otf.names.index(name) for name in known]
    turned = [
        i
        for i, size in zip(places, sizes, strict=True)
        if first[i] < _SQUARED * here[i] and abs(value[i]) > _SHOWING * size
    ]
    is_rough = False
    for turning in [[i] for i in turned] + [turned] * (len(turned) > 1):
        state = np.array(start.parameters.aberrations)
        state[turning] *= -1
        where = optics.otf(state), start.parameters.scene, start.parameters.locus
        trial = polished(data, optics, *where, hold, rough=True)
        if trial.deviance_dof < start.deviance_dof:
            start, is_rough = trial, True
    if rough or not is_rough:
        return start
    p = start.parameters
    return polished(data, optics, start.otf, p.scene, p.locus, hold)


def _candidates(data: Data, otf: OTF, jitter: Locus | None, best: Start | None) -> Iterator[FoundPair]:
    """Pairs to try: companions of the star that the best so far has found, then any."""
    if best is not None:
        (x, _), (y, _), _ = best.parameters.scene.sources()
        yield from find_pairs(data, otf, jitter, bright=(float(x), float(y)), most=3)
    yield from find_pairs(data, otf, jitter, most=3)


def _is_new(scene: Binary, tried: list[Binary], near: float) -> bool:
    """Whether a pair lies further [arcsec] from those already tried."""
    return all(np.abs(_places(scene) - _places(other)).max() > near for other in tried)


def _places(scene: Binary) -> np.ndarray:
    x, y, _ = scene.sources()
    return np.array([x, y])


def polished(
    data: Data,
    optics: Optics,
    otf: OTF,
    scene: Scene,
    jitter: Locus | None,
    hold: Collection[str],
    *,
    rough: bool = False,
) -> Start:
    """Fit a candidate briefly with everything free, about ``otf`` and then about where that led.

    Parameters
    ----------
    data, optics, hold, rough
        As for :func:`locate_binary`.
    otf : OTF
        Optics to begin with, about any state.
    scene : Scene
    jitter : Locus or None
        To begin with; None for none.
    """
    locus = Mvn.near(jnp.zeros(3)) if jitter is None else jitter
    here = Parameters(scene, locus, otf.state)
    names, free = free_parameters(here, otf, hold)
    leash = Prior(jnp.zeros(len(free)), jnp.diag(jnp.array([_LEASH**-2 * (n in otf.names) for n in names])))
    used = max(int(np.sum(np.asarray(data.used))), 1)
    end, otf, _ = climb_and_expand(
        here,
        otf,
        optics,
        data,
        free,
        leash,
        enough=float(np.sqrt(_ADDED * used)) if rough else SETTLED,
        expansions=2 if rough else 5,
        steps=15,
        tolerance=_NEARBY if rough else _CLOSE,
    )
    if otf.names:
        otf = optics.otf(end.parameters.aberrations)
    return Start(end.parameters, otf, float(end.objective) / used, np.asarray(end.information), names)
