"""Cosmic rays, for simulations: straight tracks of charge at a given rate.

:func:`cosmic_rays` draws what one exposure collects.  Nothing here finds or removes them: a filter of the
image that does also eats the tails of a jittered star.  :mod:`jitterkit.refit.outliers` finds them in what
a fit leaves over.
"""

from __future__ import annotations

import numpy as np

__all__ = ["CHARGE", "DEPTH", "cosmic_rays"]

DEPTH = 1.0
"""Depth of the layer that collects charge, pixels: a few um in a thinned sensor whose pixels are as wide."""

CHARGE = 200.0
"""Charge along a track, e- per pixel: 80 e-/um of a fast particle in silicon, in pixels of 2.4 um."""

_STEP = 0.1
"""Pixels between the points in which a track is deposited."""


def cosmic_rays(shape: tuple[int, int], rate: float, exposure: float, rng: np.random.Generator) -> np.ndarray:
    """Draw the charge that cosmic rays leave.

    Parameters
    ----------
    shape : (int, int)
        ``(ny, nx)``.
    rate : float
        Hits per pixel and second.
    exposure : float
        s.
    rng : numpy.random.Generator

    Returns
    -------
    charge : (ny, nx) array
        e-.

    Notes
    -----
    Particles come evenly from a hemisphere, so through a surface as the cosine from its normal: cos² is
    uniform, a path of length ``l`` is longer than the depth by more than a factor ``k`` in ``1/k²`` of all
    cases, and ``2 CHARGE DEPTH`` is deposited on average.  *Assumes* one charge per length (no
    straggling) and that all enter through the frame.  *Fails* where the energy of single hits matters:
    depth and charge per pixel are those of a small thinned pixel.
    """
    ny, nx = shape
    charge = np.zeros(shape)
    hits = rng.poisson(rate * exposure * ny * nx)
    start = rng.uniform(-0.5, 0.5, (hits, 2)) * shape + (np.array(shape) - 1) / 2
    cosine = np.sqrt(1 - rng.random(hits))  # never zero
    azimuth = rng.uniform(0.0, 2 * np.pi, hits)
    along = DEPTH * np.sqrt(1 - cosine**2) / cosine
    for (y, x), cos, length, phi in zip(start, cosine, along, azimuth, strict=True):
        _deposit(charge, (y, x), length, phi, CHARGE * DEPTH / cos)
    return charge


def _deposit(charge: np.ndarray, start: tuple[float, float], length: float, angle: float, total: float):
    """Lay a track's charge down, and lose what passes the frame's edge."""
    seen = min(length, float(sum(charge.shape)))
    points = max(1, int(np.ceil(seen / _STEP)))
    t = (np.arange(points) + 0.5) / points * seen
    y = np.rint(start[0] + t * np.sin(angle)).astype(int)
    x = np.rint(start[1] + t * np.cos(angle)).astype(int)
    inside = (y >= 0) & (y < charge.shape[0]) & (x >= 0) & (x < charge.shape[1])
    share = total * (seen / length if length else 1.0) / points
    np.add.at(charge, (y[inside], x[inside]), share)
