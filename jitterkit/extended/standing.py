"""Hot and dead pixels, columns and rows, which stand still while the scene moves.

:func:`standing_pixels` tells them from the scene by their sharpness, as optics spread the light of a
point over neighbouring pixels; :func:`fill` puts something else in their place.
"""

from __future__ import annotations

import numpy as np
from scipy import ndimage
from scipy.stats import median_abs_deviation

from jitterkit.vision import median_filter

_STRIKING = 8.0
"""Standard deviations of all pixels' excess: neither chance nor texture makes so many."""

_LONELY = 0.15
"""Third highest of the eight neighbours, as a share of a pixel, up to which no optics made it: a normal star
of FWHM 1.4 pixels has 0.24 or more.  The same for the second highest of four neighbouring lines."""

_STUCK = 0.9
"""Share of equal values in a dead line; noise makes them differ elsewhere."""

_ALIKE = 0.5
"""Difference of the excesses in both frames, as a share of the larger, of what stands still."""

_AROUND = np.array([[1, 1, 1], [1, 0, 1], [1, 1, 1]], bool)

_BESIDE = np.array([1, 1, 0, 1, 1], bool)


def standing_pixels(one: np.ndarray, two: np.ndarray) -> np.ndarray:
    """Find pixels that stand out in two frames alike, and more sharply than optics allow.

    Parameters
    ----------
    one, two : (ny, nx) arrays
        Finite.

    Returns
    -------
    standing : (ny, nx) bool array
    """
    excess = [frame - median_filter(frame, 5) for frame in (one, two)]
    spread = [float(median_abs_deviation(part, axis=None, scale="normal")) for part in excess]
    standing = _alike(excess, spread) & np.all([_is_lonely(part, _AROUND, 3) for part in excess], axis=0)
    for axis in (0, 1):
        lines = [np.median(part, axis=axis) for part in excess]
        odd = _alike(lines, spread) & np.all([_is_lonely(line, _BESIDE, 2) for line in lines], axis=0)
        # the same values in both frames, where most other lines have not
        equal = one == two
        stuck = (equal.mean(axis) > _STUCK) & (equal.mean() < 1 - _STUCK)
        standing |= np.expand_dims(odd | stuck, axis)
    return standing


def fill(frame: np.ndarray, bad: np.ndarray) -> np.ndarray:
    """Give bad pixels the value of the nearest good one."""
    if not bad.any():
        return frame
    nearest = ndimage.distance_transform_edt(bad, return_distances=False, return_indices=True)
    return frame[tuple(nearest)]


def _alike(excess: list[np.ndarray], spread: list[float]) -> np.ndarray:
    """Return which excesses are striking, and alike in two frames."""
    one, two = excess
    striking = (np.abs(one) > _STRIKING * spread[0]) & (np.abs(two) > _STRIKING * spread[1])
    return striking & (np.abs(one - two) < _ALIKE * np.maximum(np.abs(one), np.abs(two)))


def _is_lonely(excess: np.ndarray, footprint: np.ndarray, rank: int) -> np.ndarray:
    """Return which values stand out from their neighbours but for the ``rank - 1`` most alike."""
    up = ndimage.rank_filter(excess, -rank, footprint=footprint)
    down = ndimage.rank_filter(excess, rank - 1, footprint=footprint)
    return np.where(excess > 0, up, -down) < _LONELY * np.abs(excess)
