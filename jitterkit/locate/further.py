"""Stars beside those that were searched for, and fields of several stars."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from jitterkit.forward import expected_image
from jitterkit.likelihood import Data
from jitterkit.locate.matched_filter import resolution
from jitterkit.locate.residual import Residual
from jitterkit.locate.start import Start, polished
from jitterkit.optics.system import Optics
from jitterkit.scene import FurtherStars, Scene, Stars

_ROUNDS = 8
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
    for _ in range(_ROUNDS):
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
