"""Where the image plane lies on the sky.

Both functions take any object with the low-level interface of ``astropy.wcs.WCS``; this module
imports numpy only.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

__all__ = ["plate_scale", "sky_position_angle"]


def plate_scale(wcs: Any) -> tuple[float, str | None]:
    """Return the side of a pixel, and a warning where pixels are not square on the sky.

    Parameters
    ----------
    wcs : astropy.wcs.WCS
        Celestial, two axes.

    Returns
    -------
    scale : float
        Square root of the pixel's area [arcsec/pixel].
    warning : str or None
        Says the two sides where they differ by more than 1 %.
    """
    matrix = np.asarray(wcs.pixel_scale_matrix, dtype=float) * 3600.0
    scale = math.sqrt(abs(np.linalg.det(matrix)))
    across, up = np.linalg.norm(matrix, axis=0)
    if abs(across - up) <= 0.01 * scale:
        return scale, None
    return scale, f"pixels are {across:g} x {up:g} arcsec, not square; {scale:g} arcsec is used"


def sky_position_angle(wcs: Any, x: float, y: float, theta_deg: float) -> float:
    """Turn a direction in the image into a position angle on the sky.

    Parameters
    ----------
    wcs : astropy.wcs.WCS
        Celestial, for 0-based pixels of the original frame, of either handedness.
    x, y : float
        Where the direction starts, 0-based pixel; add a region's ``origin`` first.
    theta_deg : float
        Direction, counter-clockwise from +x [degrees].

    Returns
    -------
    position_angle : float
        From north through east, in [0, 360) [degrees].  With north up and east left, theta = 90
        gives 0 and theta = 180 gives 90; with east right, theta = 0 gives 90.

    Notes
    -----
    The angle of the great circle between two points half a pixel to either side, so distortion and
    any projection are taken along, and it is exact at the pole too.
    """
    step = 0.5 * np.array([math.cos(math.radians(theta_deg)), math.sin(math.radians(theta_deg))])
    behind_ahead_here = np.array([-1.0, 1.0, 0.0])
    lon, lat = wcs.pixel_to_world_values(x + step[0] * behind_ahead_here, y + step[1] * behind_ahead_here)
    (ax, bx, cx), (ay, by, cy) = np.radians(lon), np.radians(lat)
    direction = _unit_vector(bx, by) - _unit_vector(ax, ay)
    east = np.array([-math.sin(cx), math.cos(cx), 0.0])
    north = np.array([-math.sin(cy) * math.cos(cx), -math.sin(cy) * math.sin(cx), math.cos(cy)])
    return math.degrees(math.atan2(direction @ east, direction @ north)) % 360.0


def _unit_vector(lon: float, lat: float) -> np.ndarray:
    return np.array([math.cos(lat) * math.cos(lon), math.cos(lat) * math.sin(lon), math.sin(lat)])
