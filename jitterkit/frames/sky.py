"""Where the image plane lies on the sky.

The functions take an ``astropy.wcs.WCS`` of two celestial axes, in any order; this module imports astropy's
coordinates where a position angle needs them.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np


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
        Celestial, for 0-based pixels of the original frame, of either handedness and order of axes.
    x, y : float
        Where the direction starts, 0-based pixel; add a region's ``origin`` first.
    theta_deg : float
        Direction, counter-clockwise from +x [degrees].

    Returns
    -------
    position_angle : float
        From the north of ICRS through east, in [0, 360) [degrees]; NaN where the frame of the coordinates
        is none that astropy can convert.  With north up and east left, theta = 90 gives 0 and theta = 180
        gives 90; with east right, theta = 0 gives 90.

    Notes
    -----
    The angle of the great circle between two points half a pixel to either side, so distortion and
    any projection are taken along, and it is exact at the pole too.
    """
    step = 0.5 * np.array([math.cos(math.radians(theta_deg)), math.sin(math.radians(theta_deg))])
    behind_ahead_here = np.array([-1.0, 1.0, 0.0])
    world = wcs.pixel_to_world_values(x + step[0] * behind_ahead_here, y + step[1] * behind_ahead_here)
    equatorial = _in_icrs(wcs, world[wcs.wcs.lng], world[wcs.wcs.lat])
    if equatorial is None:
        return math.nan
    (ax, bx, cx), (ay, by, cy) = equatorial
    direction = _unit_vector(bx, by) - _unit_vector(ax, ay)
    east = np.array([-math.sin(cx), math.cos(cx), 0.0])
    north = np.array([-math.sin(cy) * math.cos(cx), -math.sin(cy) * math.sin(cx), math.cos(cy)])
    return math.degrees(math.atan2(direction @ east, direction @ north)) % 360.0


def _in_icrs(wcs: Any, lon: np.ndarray, lat: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Right ascension and declination, radian; None where the frame of the coordinates is unknown."""
    from astropy.coordinates import ICRS, SkyCoord

    frame = celestial_frame(wcs)
    if frame is None or isinstance(frame, ICRS):
        return None if frame is None else (np.radians(lon), np.radians(lat))
    place = SkyCoord(lon, lat, unit="deg", frame=frame).icrs
    return place.ra.rad, place.dec.rad


def celestial_frame(wcs: Any) -> Any:
    """Return the frame of astropy in which coordinates are: of the stars, or None for any other.

    Parameters
    ----------
    wcs : astropy.wcs.WCS
        Celestial, two axes.
    """
    from astropy.coordinates import BarycentricMeanEcliptic, Galactic, Supergalactic
    from astropy.coordinates.builtin_frames.baseradec import BaseRADecFrame
    from astropy.wcs.utils import wcs_to_celestial_frame

    kind, equinox = wcs.wcs.ctype[wcs.wcs.lng][:4], wcs.wcs.equinox
    if kind == "ELON":
        return BarycentricMeanEcliptic(equinox=f"J{2000.0 if math.isnan(equinox) else equinox}")
    if kind == "SLON":
        return Supergalactic()
    try:
        frame = wcs_to_celestial_frame(wcs)
    except ValueError:  # a misspelt RADESYS, say
        return None
    return frame if isinstance(frame, BaseRADecFrame | Galactic) else None


def turned_over(wcs: Any, rows: int) -> Any | None:
    """Return the coordinates of an image whose rows have been turned over.

    Parameters
    ----------
    wcs : astropy.wcs.WCS
        Of the image as stored, two axes.
    rows : int
        Number of rows.

    Returns
    -------
    wcs : astropy.wcs.WCS
        A pixel ``(x, rows - 1 - y)`` has the place on the sky that ``(x, y)`` has in the other.  None where
        the coordinates have lookup tables.
    """
    from astropy.wcs import Sip

    if any(table is not None for table in (wcs.cpdis1, wcs.cpdis2, wcs.det2im1, wcs.det2im2)):
        return None
    turned, matrix = wcs.deepcopy(), wcs.pixel_scale_matrix @ np.diag([1.0, -1.0])
    if wcs.wcs.has_cd():
        turned.wcs.cd = matrix
    else:
        turned.wcs.pc, turned.wcs.cdelt = matrix, [1.0, 1.0]
    turned.wcs.crpix = [wcs.wcs.crpix[0], rows + 1 - wcs.wcs.crpix[1]]
    if wcs.sip is not None:
        turned.sip = Sip(*_mirrored(wcs.sip), turned.wcs.crpix)
    turned.wcs.set()
    return turned


def _mirrored(sip: Any) -> list[np.ndarray | None]:
    """Polynomials of a distortion in (u, -v)."""
    found: list[np.ndarray | None] = []
    for name, sign in (("a", 1), ("b", -1), ("ap", 1), ("bp", -1)):
        terms = getattr(sip, name)
        found.append(None if terms is None else sign * terms * (-1.0) ** np.arange(terms.shape[1]))
    return found


def _unit_vector(lon: float, lat: float) -> np.ndarray:
    return np.array([math.cos(lat) * math.cos(lon), math.cos(lat) * math.sin(lon), math.sin(lat)])
