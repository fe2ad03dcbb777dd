"""Search a frame for its stars, and find starting values for everything else.

A faint companion of a bright star hides in the mismatch between the star and its template.  So the
search goes round: candidates are fitted briefly with the jitter and the aberrations free, and if the
best of them does not describe the frame, the template takes its jitter and aberrations and the
search begins again.  What stands out in the end is a further star.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator

import numpy as np

from jitterkit.forward import expected_image
from jitterkit.likelihood import Data
from jitterkit.linearisation import Stall
from jitterkit.locate.matched_filter import resolution
from jitterkit.locate.pair import FoundPair, find_pairs, find_star
from jitterkit.locate.residual import Residual
from jitterkit.locate.start import Start, polished, with_best_signs, with_exact_slopes
from jitterkit.loci.base import Locus
from jitterkit.optics.anchored import AnchoredOptics
from jitterkit.optics.otf import OTF
from jitterkit.optics.system import OpticalSystem, Optics
from jitterkit.scene import Binary, FurtherStars, Scene, Stars

_ROUNDS = 4
_GOOD_ENOUGH = 1.15  # deviance per pixel that no wrong companion reaches in a bright frame
_FAR_OFF = 30.0  # deviance per pixel from which better derivatives do not bring a candidate to the stars
_APART = 3.0  # resolutions between stars that are distinguished before the blur is known
_UNSEEN = 0.01
"""Effect of a mode about no aberrations (:attr:`~jitterkit.optics.OpticalSystem.mode_effects`) below which a
fit that starts at zero does not find it.  All of 12 fits that started beside zero were right, behind a ring
of which one sample of 64² was changed by 0.001 to 1."""
_OFF_ZERO = 0.1  # rad rms at which such a mode starts: it hardly blurs a template
_IMPROVEMENT = 0.97  # a round that improves the deviance by less was the last


def _starting_optics(optics: Optics, hold: Collection[str]) -> OTF:
    """Return the nominal transfer function, or one beside it where modes to be fitted hardly have an effect.

    A pupil that is its own mirror image has no derivative by focus and astigmatism at zero, where a fit would
    stay whatever they are: 15 nm of focus were taken for jitter, and moments were wrong by seven errors.
    """
    system, nominal = optics.system, optics.nominal
    if isinstance(optics, AnchoredOptics) or not isinstance(system, OpticalSystem):
        return nominal  # about a wavefront that is known
    unseen = [i for i in np.flatnonzero(system.mode_effects < _UNSEEN) if nominal.names[i] not in hold]
    if not unseen:
        return nominal
    state = np.array(nominal.state)
    state[unseen] = _OFF_ZERO / system.mode_phases[unseen]
    return optics.otf(state)


def locate_star(
    data: Data, optics: Optics, hold: Collection[str] = (), *, rough: bool = False
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
    otf, jitter, best = _starting_optics(optics, hold), None, None
    for _ in range(_ROUNDS):
        star = find_star(data, otf, jitter)
        if star is None:
            break
        candidate = polished(data, optics, otf, star, jitter, hold, rough=rough, slopes=False)
        if rough:
            candidate = _renewed(candidate, data, optics, hold)
        if best is not None and not candidate.deviance_dof < _IMPROVEMENT * best.deviance_dof:
            break
        best = candidate
        if best.describes(data):
            break
        otf, jitter = best.otf, best.parameters.locus
    if best is None:
        return None
    return with_best_signs(with_exact_slopes(best, optics), data, optics, hold, rough=rough)


def locate_binary(
    data: Data, optics: Optics, hold: Collection[str] = (), *, rough: bool = False
) -> Start | None:
    """Find a binary anywhere in a frame and starting values for all of its parameters.

    Parameters
    ----------
    data : Data
    optics : Optics
    hold : collection of str
        Parameters that the fit to come will hold.
    rough : bool
        Whether to leave the last steps to a fit of everything that is to follow.

    Returns
    -------
    start : Start or None
        None if no star rises above the noise.
    """
    otf: OTF = _starting_optics(optics, hold)
    jitter: Locus | None = None
    best: Start | None = None
    tried: list[Binary] = []
    near = 0.1 * resolution(otf)
    for _ in range(_ROUNDS):
        before = np.inf if best is None else best.deviance_dof
        for pair in _candidates(data, otf, jitter, best):
            if not all(np.abs(_positions(pair.scene) - _positions(other)).max() > near for other in tried):
                continue
            tried.append(pair.scene)
            where = data, optics, otf, pair.scene, jitter, hold
            candidate = polished(*where, rough=rough, slopes=False)
            if best is None or candidate.deviance_dof < best.deviance_dof:
                best = _renewed(candidate, data, optics, hold) if rough else candidate
            if best.deviance_dof < _GOOD_ENOUGH and best.describes(data):
                return _finished(best, data, optics, hold, rough)
        if best is None or best.deviance_dof > _IMPROVEMENT * before:
            break
        otf, jitter = best.otf, best.parameters.locus
    return None if best is None else _finished(best, data, optics, hold, rough)


def locate_stars(
    data: Data, optics: Optics, hold: Collection[str] = (), *, rough: bool = False
) -> Start | None:
    """Find the stars of a field and starting values for all of its parameters.

    Parameters
    ----------
    data, optics, hold, rough
        As for :func:`locate_binary`.

    Returns
    -------
    start : Start or None
        None if no star rises above the noise.
    """
    found = bright_stars(data, optics.nominal)
    if found is None:
        return None
    scene = Stars.of(found.x, found.y, found.flux)
    start = polished(
        data, optics, _starting_optics(optics, hold), scene, None, hold, rough=rough, slopes=False
    )
    return _finished(start, data, optics, hold, rough)


def bright_stars(data: Data, otf: OTF) -> FurtherStars | None:
    """Find stars that an image shows without a fit, well apart and not much fainter than the brightest."""
    return Residual.of_dark(data, otf).further_stars(apart=_APART)


def _renewed(found: Start, data: Data, optics: Optics, hold: Collection[str]) -> Start:
    """Fit a candidate of a rough search again, with the derivatives of its own optics, if it is near.

    A wavefront of 0.3 rad is not found with the derivatives of a flat one.
    """
    if found.deviance_dof > _FAR_OFF or found.describes(data):
        return found
    otf, p = with_exact_slopes(found, optics).otf, found.parameters
    return polished(data, optics, otf, p.scene, p.locus, hold, rough=True, slopes=False)


def _finished(start: Start, data: Data, optics: Optics, hold: Collection[str], rough: bool) -> Start:
    """With the best signs of its aberrations and the stars that stand out beside it."""
    start = with_best_signs(with_exact_slopes(start, optics), data, optics, hold, rough=rough)
    return with_further_stars(start, data, optics, hold, rough=rough)


def _candidates(data: Data, otf: OTF, jitter: Locus | None, best: Start | None) -> Iterator[FoundPair]:
    """Yield the pairs to try: companions of the star that the best so far has found, then any."""
    if best is not None:
        (x, _), (y, _), _ = best.parameters.scene.sources()
        yield from find_pairs(data, otf, jitter, bright=(float(x), float(y)), most=3)
    yield from find_pairs(data, otf, jitter, most=3)


def _positions(scene: Binary) -> np.ndarray:
    x, y, _ = scene.sources()
    return np.array([x, y])


_FURTHER_ROUNDS = 8
"""Times that further stars are looked for: faint ones show when bright ones are explained."""

_SEEN = 4.0
"""Standard errors of its flux that a further star must keep when everything is fitted."""

_ABOUT, _GHOSTLY, _SEVERAL = 5.0, 0.01, 3
"""Resolutions from a bright star, share of its light, and number of further stars that are none: an error of
the optics of 15 to 18 nm made four to seven of 0.2 to 0.4 %, two to four resolutions from A."""

_MOST = {"binary": 12, "stars": 60}
"""Stars of a scene; what shows more is another, or its optics are not as they are said to be."""


def with_further_stars(
    start: Start, data: Data, optics: Optics, hold: Collection[str], *, rough: bool = False
) -> Start:
    """Add stars that stand out of what a start leaves of a frame.

    Parameters
    ----------
    start : Start
    data, optics, hold, rough
        As for :func:`~jitterkit.locate.locate_binary`.

    Returns
    -------
    start : Start
        The same where nothing stands out; and that of a pair where something does that is no star: dark
        spots, or more than stars explain.  It is the model then that does not describe the frame, and stars
        would hide that.

    Notes
    -----
    *Fails when* a star is nearer to another than the resolution, or as faint as the error of the model.
    """

    def settled(near: Start, scene: Scene) -> Start:
        return polished(data, optics, near.otf, scene.canonical(), near.parameters.locus, hold)

    found, is_field = start, isinstance(start.parameters.scene, Stars)
    stall = Stall(start.deviance_dof)
    for rounds_left in reversed(range(_FURTHER_ROUNDS)):
        scene = found.parameters.scene
        image = np.asarray(expected_image(found.parameters, found.otf))
        left = Residual(data, image, found.otf, found.parameters.locus)
        further = left.further_stars(scene)
        if further is None and found is start:
            return start
        if rough and further is not None:  # what haste has left looks like stars
            rough, found = False, settled(found, scene)
            continue
        if _may_be_speckles(further, scene) and not left.is_all_stars(scene):
            break
        if further is None:
            return found
        scene = scene.joined(further)
        if len(scene.sources()[0]) > _MOST[scene.name]:
            break
        found = settled(found, scene)
        sound = _are_sound(found)
        if not sound.all():
            if not is_field:
                break
            found = settled(found, found.parameters.scene.with_others(sound))
        if stall.is_hopeless(found.deviance_dof, rounds_left):
            break
    return found if is_field else start


def _may_be_speckles(further: FurtherStars | None, scene: Scene) -> bool:
    """Return whether further stars are faint enough, beside the others, to be errors of the optics."""
    _, _, flux = scene.sources()
    return further is None or float(further.flux.max()) < _GHOSTLY * float(flux.max())


def _are_sound(start: Start) -> np.ndarray:
    """Select further stars that shine, lie in the frame, are fainter than a pair, and are not a ring.

    A pair of which one is fainter than a further star may be one star, taken for two.  Several faint stars
    close to a bright one are what an error of the optics looks like.
    """
    scene, grid = start.parameters.scene, start.otf.grid
    assert scene.others is not None
    x, y, flux = (np.asarray(part) for part in (scene.others.x, scene.others.y, scene.others.flux))
    names = [name for name in scene.names if name.startswith("flux_")]
    errors = np.sqrt(np.diag(start.covariance_of(names)))
    height, width = (n * grid.plate_scale / 2 for n in grid.shape)
    xs, ys, lights = (np.asarray(part) for part in scene.stars())
    brightest = np.inf if isinstance(scene, Stars) else lights.min()
    near = np.hypot(x[:, None] - xs, y[:, None] - ys) < _ABOUT * resolution(start.otf)
    ring = np.any(near & (flux[:, None] < _GHOSTLY * lights), axis=1)
    inside = (np.abs(x) < width) & (np.abs(y) < height)
    return inside & (flux > _SEEN * errors) & (flux < brightest) & ~(ring & (ring.sum() >= _SEVERAL))
