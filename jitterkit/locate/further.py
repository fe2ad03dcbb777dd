"""Stars beside those that were searched for, and fields of several stars."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from jitterkit.forward import expected_image
from jitterkit.likelihood import Data
from jitterkit.locate.residual import Residual
from jitterkit.locate.start import Start, polished
from jitterkit.optics.system import Optics
from jitterkit.scene import Scene, Stars

__all__ = ["with_further_stars"]

_ROUNDS = 8
"""Times that further stars are looked for: faint ones show when bright ones are explained."""

_SEEN = 4.0
"""Standard errors of its flux that a further star must keep when everything is fitted."""

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
        The same where nothing stands out; and that of a pair where, all further stars taken away, something
        still does: it is the model then that does not describe the frame, and stars would hide that.

    Notes
    -----
    *Fails when* a star is nearer to another than the resolution, or as faint as the error of the model.
    """

    def settled(near: Start, scene: Scene) -> Start:
        return polished(data, optics, near.otf, scene.tidied(), near.parameters.locus, hold)

    found, is_field = start, isinstance(start.parameters.scene, Stars)
    for _ in range(_ROUNDS):
        scene = found.parameters.scene
        image = np.asarray(expected_image(found.parameters, found.otf))
        left = Residual(data, image, found.otf, found.parameters.locus)
        further = left.further_stars(scene)
        if further is None:
            return found if found is start or is_field or left.is_all_stars(scene) else start
        if rough:  # what haste has left looks like stars
            rough, found = False, settled(found, scene)
            continue
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


def _are_sound(start: Start) -> np.ndarray:
    """Which further stars shine, stand in the frame, and outshine no star of a pair.

    A pair of which one is fainter than a further star may be one star, taken for two.
    """
    scene, grid = start.parameters.scene, start.otf.grid
    assert scene.others is not None
    x, y, flux = (np.asarray(part) for part in (scene.others.x, scene.others.y, scene.others.flux))
    names = [name for name in scene.names if name.startswith("flux_")]
    errors = np.sqrt(np.diag(start.covariance_of(names)))
    height, width = (n * grid.plate_scale / 2 for n in grid.shape)
    _, _, own = scene.stars()
    brightest = np.inf if isinstance(scene, Stars) else np.min(np.asarray(own))
    return (np.abs(x) < width) & (np.abs(y) < height) & (flux > _SEEN * errors) & (flux < brightest)
