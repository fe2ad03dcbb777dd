"""Search a frame for its stars, and find starting values for everything else.

A faint companion of a bright star hides in the mismatch between the star and its template.  So the
search goes round: candidates are fitted briefly with the jitter and the aberrations free, and if the
best of them does not describe the frame, the template takes its jitter and aberrations and the
search begins again.  What stands out in the end is a further star.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator

import numpy as np

from jitterkit.likelihood import Data
from jitterkit.locate.further import with_further_stars
from jitterkit.locate.matched_filter import resolution
from jitterkit.locate.pair import FoundPair, find_pairs, find_star
from jitterkit.locate.residual import Residual
from jitterkit.locate.start import Start, polished, with_best_signs, with_exact_slopes
from jitterkit.loci.base import Locus
from jitterkit.optics.otf import OTF
from jitterkit.optics.system import Optics
from jitterkit.scene import Binary, FurtherStars, Stars

_ROUNDS = 4
_GOOD_ENOUGH = 1.15  # deviance per pixel that no wrong companion reaches in a bright frame
_FAR_OFF = 30.0  # deviance per pixel from which better derivatives do not bring a candidate to the stars
_APART = 3.0  # resolutions between stars that are distinguished before the blur is known
_IMPROVEMENT = 0.97  # a round that improves the deviance by less was the last


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
    otf, jitter, best = optics.nominal, None, None
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
    otf: OTF = optics.nominal
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
    start = polished(data, optics, optics.nominal, scene, None, hold, rough=rough, slopes=False)
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
