"""How little padding the derivatives of a frame's image need: light that wraps around must not count."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from jitterkit.forward import Parameters, expected_image
from jitterkit.optics.anchor import on_grid
from jitterkit.optics.grid import Grid
from jitterkit.optics.otf import OTF

MAY_MOVE = 8.0
"""Pixels by which the stars of other frames may be off those that the grid was chosen for."""

_PADDINGS = (16, 24, 32)
"""Fine samples on each side."""

_WORTH = 0.75
"""Share of the samples that a smaller grid may have: making it takes what thirty frames of TOLIMAN save."""

_WRAPPED = 0.1
"""Chi-squared, without read noise, of the light that may wrap around: errors of TOLIMAN, a small and an
18-segment telescope then differ by 2e-4 of themselves at most."""

DARK = 1e-5
"""Share of the brightest pixel that no variance falls below."""


def grid_for_derivatives(parameters: Parameters, otf: OTF) -> Grid | None:
    """Return the grid with the least padding that does for the derivatives of images in frames like one.

    Parameters
    ----------
    parameters : Parameters
        Of that frame.
    otf : OTF
        At its aberrations.

    Returns
    -------
    grid : Grid or None
        None where no grid is much smaller than that of the optics.
    """
    step, whole, shape = MAY_MOVE * otf.grid.plate_scale, on_grid(otf, otf.grid), otf.grid.fine_shape
    moved = [parameters.shifted(x, y) for x in (-step, step) for y in (-step, step)]
    images = [np.asarray(expected_image(one, whole)) for one in moved]
    for samples in _PADDINGS:
        grid = replace(otf.grid, pad=-(-samples // otf.grid.refine))
        centred = all((n - m) % 2 == 0 for n, m in zip(shape, grid.fine_shape, strict=True))
        if not centred or np.prod(grid.fine_shape) > _WORTH * np.prod(shape):
            continue
        cut = on_grid(otf, grid)
        off = [expected_image(one, cut) - image for one, image in zip(moved, images, strict=True)]
        pairs = zip(off, images, strict=True)
        if all(np.sum(by**2 / np.maximum(image, DARK * image.max())) < _WRAPPED for by, image in pairs):
            return grid
    return None
