"""Pupils of two space telescopes, drawn from published dimensions.

``docs/instruments.md`` gives the place that each number comes from.  Both have no wavefront error.  Nearly
symmetric pupils show focus and astigmatism only to second order about perfect focus, where both signs look
the same, so that only coma and trefoil (Noll's 7 to 10) vary.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from jitterkit.conventions import offsets
from jitterkit.optics.pupil import Pupil, open_pupil

_NOLL = (7, 8, 9, 10)
_SAMPLES = 256

_SEGMENT, _GAP = 1.309, 0.007
"""m: a segment from flat to flat, and the gap between two."""

_JWST_WIDTH = 6.62
"""m: the array; the outer corners lie on a circle of 6.616 m."""

_JWST_STRUT = 0.12
"""m: width of the three supports of the secondary mirror."""

_HST_RADIUS = 1.2
"""m."""

_HST_SECONDARY, _HST_VANE, _HST_PAD = 0.330, 0.022, 0.065
"""Radius of the secondary's baffle, width of a vane and radius of a pad, in units of the pupil's radius."""

_HST_PADS = ((0.0, 0.8921), (0.7555, -0.4615), (-0.7606, -0.4564))
"""Centres (x, y) of the three pads that hold the primary mirror, likewise; +y is V3."""


def jwst_pupil() -> Pupil:
    """Return a pupil like JWST's: 18 hexagons in two rings, 6.6 m wide, behind three struts.

    Returns
    -------
    pupil : Pupil
        256 x 256 samples; clear over 25.8 m².
    """
    spacing = _SEGMENT + _GAP
    lattice = [
        (i * np.sqrt(3) / 2 * spacing, (j + i / 2) * spacing)
        for i in range(-2, 3)
        for j in range(-2, 3)
        if abs(i + j) <= 2 and (i, j) != (0, 0)
    ]

    def clear(x, y):
        open_ = np.zeros(np.broadcast(x, y).shape, bool)
        for x0, y0 in lattice:
            sides = [np.abs(_along(x - x0, y - y0, angle)) for angle in (30.0, 90.0, 150.0)]
            open_ |= np.maximum.reduce(sides) < _SEGMENT / 2
        return open_ & ~_behind_struts(x, y, (90.0, 240.0, 300.0), _JWST_STRUT)

    return _drawn(_JWST_WIDTH, clear)


def hst_pupil() -> Pupil:
    """Return a pupil like Hubble's: 2.4 m, a third of it obscured, four vanes and three pads.

    Returns
    -------
    pupil : Pupil
        256 x 256 samples; clear over 3.88 m².
    """
    radius = _HST_RADIUS

    def clear(x, y):
        distance = np.hypot(x, y)
        open_ = (distance < radius) & (distance > _HST_SECONDARY * radius)
        for x0, y0 in _HST_PADS:
            open_ &= np.hypot(x - x0 * radius, y - y0 * radius) > _HST_PAD * radius
        return open_ & ~_behind_struts(x, y, (0.0, 90.0, 180.0, 270.0), _HST_VANE * radius)

    return _drawn(2 * radius, clear)


def _along(x, y, angle: float):
    """Return the coordinate along a direction [degrees, counter-clockwise from +x]."""
    return x * np.cos(np.radians(angle)) + y * np.sin(np.radians(angle))


def _behind_struts(x, y, angles: tuple[float, ...], width: float):
    """Return whether points lie behind struts that run from the centre outwards."""
    behind = [(_along(x, y, angle) > 0) & (np.abs(_along(x, y, angle + 90)) < width / 2) for angle in angles]
    return np.logical_or.reduce(behind)


def _drawn(width: float, clear: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> Pupil:
    """Return a pupil whose samples are the clear share of 8 x 8 points; modes on the circle in its square."""
    fine = offsets(8 * _SAMPLES, width / (8 * _SAMPLES))
    transmission = np.empty((_SAMPLES, _SAMPLES))
    for k, rows in enumerate(fine.reshape(_SAMPLES, 8)):
        open_ = clear(fine[None, :], rows[:, None])
        transmission[k] = open_.reshape(8, _SAMPLES, 8).mean(axis=(0, 2))
    return open_pupil(transmission, width, _NOLL)
