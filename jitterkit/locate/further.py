"""Stars beside those that were searched for, and fields of several stars."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from jitterkit.forward import expected_image
from jitterkit.likelihood import Data
from jitterkit.locate.residual import Residual
from jitterkit.locate.start import Start, polished
from jitterkit.loci.base import Locus
from jitterkit.optics.otf import OTF
from jitterkit.optics.system import Optics
from jitterkit.scene import Scene

__all__ = ["with_further_stars"]

_ROUNDS = 4
"""Times that further stars are looked for: faint ones show when bright ones are explained."""

_SEEN = 4.0
"""Standard errors of its flux that a further star must keep when everything is fitted."""

_MOST = 12
"""Further stars beside a pair; what leaves more is no pair, or its optics are not as they are said to be."""


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
        The same where nothing stands out; and where, all further stars taken away, something still does: it
        is the model then that does not describe the frame, and stars would hide that.

    Notes
    -----
    *Fails when* a star is nearer to another than the resolution, or as faint as the error of the model.
    """

    def settled(otf: OTF, scene: Scene, jitter: Locus) -> Start:
        return polished(data, optics, otf, scene, jitter, hold)

    found = start
    for _ in range(_ROUNDS):
        scene = found.parameters.scene
        image = np.asarray(expected_image(found.parameters, found.otf))
        left = Residual(data, image, found.otf, found.parameters.locus)
        further = left.further_stars(scene)
        if further is None:
            return found if found is start or left.is_all_stars(scene) else start
        if rough:  # what haste has left looks like stars
            rough, found = False, settled(found.otf, scene, found.parameters.locus)
            continue
        scene = scene.joined(further)
        if len(scene.sources()[0]) > _MOST:
            break
        found = settled(found.otf, scene, found.parameters.locus)
        if not _is_sound(found):
            break
    return start


def _is_sound(start: Start) -> bool:
    """Whether the further stars shine, stand in the frame, and outshine no star of the pair itself.

    A pair of which one is fainter than a further star may be one star, taken for two.
    """
    scene, grid = start.parameters.scene, start.otf.grid
    assert scene.others is not None
    x, y, flux = (np.asarray(part) for part in (scene.others.x, scene.others.y, scene.others.flux))
    names = [name for name in scene.names if name.startswith("flux_")]
    errors = np.sqrt(np.diag(start.covariance_of(names)))
    height, width = (n * grid.plate_scale / 2 for n in grid.shape)
    _, _, own = scene.stars()
    inside = (np.abs(x) < width) & (np.abs(y) < height)
    return bool(np.all(inside & (flux > _SEEN * errors) & (flux < np.min(np.asarray(own)))))
