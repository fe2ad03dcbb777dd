"""Where the image plane lies on the sky.

The functions take an ``astropy.wcs.WCS`` of two celestial axes, in any order; this module imports astropy's
coordinates where a position angle needs them.
"""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np

_SAME, _VARIES, _FAR = 1e-6, 1e-3, 1e-2
"""Relative differences: below the first the scale of the matrix is that of the middle; beyond the second the
scale changes over the frame; beyond the third a pixel far from the reference pixel is another one there."""

_NEARLY_CELESTIAL = re.compile(r"(RA|DEC|[GE]L(ON|AT)|AZ|ALT)\b|(RA|DEC)_", re.I)


def plate_scale(wcs: Any, shape: tuple[int, int] | None = None) -> tuple[float, list[str]]:
    """Return the side of a pixel, and warnings where pixels are not square or not alike on the sky.

    Parameters
    ----------
    wcs : astropy.wcs.WCS
        Celestial, two axes.
    shape : (int, int), optional
        ``(ny, nx)`` of the frame; without one, the scale is that of the reference pixel.

    Returns
    -------
    scale : float
        Square root of the pixel's area in the middle of the frame, distortion included [arcsec/pixel].
    warnings : list of str
        Name the two sides where the scale differs with the direction by more than 0.1 %, and the scales over
        the frame where these do by as much.  Name the reference pixel where it lies more than a field outside
        of the frame and the frame's pixels differ from it by more than 1 %: a projection alone does so at
        several degrees only, and a distortion is then extended over more than a field.
    """
    matrix = np.asarray(wcs.pixel_scale_matrix, dtype=float) * 3600.0
    scale, warnings = math.sqrt(abs(np.linalg.det(matrix))), []
    middle = matrix
    even = shape is None or not scale > 0 or _is_even(wcs, shape)
    local = None if shape is None or even else local_pixels(wcs, shape)
    if local is not None:
        scales = np.sqrt(np.abs(np.linalg.det(local)))
        middle = local[0]
        scale = float(scales[0]) if abs(scales[0] / scale - 1) > _SAME else scale
        if np.ptp(scales) > _VARIES * scale:
            found = (
                f"the scale runs from {scales.min():.5g} to {scales.max():.5g} arcsec/pixel over the frame"
            )
            warnings.append(f"{found}; that of its middle is used: give --plate-scale for another position")
    far = 0.0  # outside of the frame the reference pixel lies, in the frame's sides
    if shape is not None and not even:
        beyond = np.asarray(wcs.wcs.crpix) - (np.array(shape[::-1]) + 1) / 2
        far = float(np.max(np.abs(beyond / shape[::-1]))) - 0.5
    if far > 1:
        off = np.inf if local is None else np.linalg.norm(local[0] - matrix) / np.linalg.norm(matrix)
        if off > _FAR:
            differ = f"differ by {off:.2g} from those of" if off < np.inf else "are off the sky of"
            found = f"pixels {differ} the WCS's reference pixel, {far:.3g} fields outside of the frame"
            warnings.append(f"{found}: scale and position angle are right only if the WCS holds so far out")
    sides = np.linalg.norm(middle, axis=0)
    longest, shortest = np.linalg.svd(middle, compute_uv=False) if scale > 0 else (0.0, 0.0)
    if longest - shortest > _VARIES * scale:
        found = f"pixels are {sides[0]:.5g} x {sides[1]:.5g} arcsec, not square"
        if abs(sides[0] - sides[1]) < 0.5 * (longest - shortest):
            found = f"pixels are not square, but {longest:.5g} x {shortest:.5g} arcsec along oblique axes"
        warnings.append(f"{found}; {scale:.5g} arcsec is used in all directions")
    return scale, warnings


def _is_even(wcs: Any, shape: tuple[int, int]) -> bool:
    """Return whether the scale of the reference pixel is that of the whole frame to one part in a million.

    Then the farthest corner is as far from it on the sky as in the image.
    """
    reference = np.asarray(wcs.wcs.crpix) - 1
    corner = np.where(reference > np.array(shape[::-1]) / 2, 0, shape[::-1])
    far = math.radians(np.linalg.norm(np.asarray(wcs.pixel_scale_matrix) @ (corner - reference)))
    if wcs.has_distortion or far**2 > _SAME:
        return False
    world = np.radians(wcs.pixel_to_world_values(*np.stack([reference, corner], axis=1)))
    apart = np.diff([_unit_vector(*one) for one in world[[wcs.wcs.lng, wcs.wcs.lat]].T], axis=0)
    return abs(float(np.linalg.norm(apart)) - far) <= _SAME * far


def local_pixels(wcs: Any, shape: tuple[int, int]) -> np.ndarray | None:
    """Measure the pixels in the middle, in the corners and half-way along the edges of a frame.

    Parameters
    ----------
    wcs : astropy.wcs.WCS
    shape : (int, int)
        ``(ny, nx)``.

    Returns
    -------
    pixels : (9, 2, 2) array or None
        Of each pixel, the middle's first, its sides along x and y on the sky as columns [arcsec].  None where
        one is off the sky.

    Notes
    -----
    By steps of a pixel, with the reference moved to the origin of the sky: coordinates near zero have no
    rounding to speak of, and every pointing has the same scale.
    """
    moved = wcs.deepcopy()
    moved.wcs.crval = [0.0, 0.0]
    grid = np.array([(0, 0), (-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1)])
    positions = (grid + 1) * ((np.array(shape) - 1) / 2)
    steps = np.array([(0.0, -0.5), (0.0, 0.5), (-0.5, 0.0), (0.5, 0.0)])
    y, x = (positions[:, None] + steps).reshape(-1, 2).T
    with np.errstate(invalid="ignore"):
        world = moved.pixel_to_world_values(x, y)
    lon, lat = (np.reshape(world[axis], (9, 2, 2)) for axis in (wcs.wcs.lng, wcs.wcs.lat))
    across = ((np.diff(lon, axis=2) + 180) % 360 - 180) * np.cos(np.radians(lat.mean(axis=2, keepdims=True)))
    pixels = 3600.0 * np.concatenate([across, np.diff(lat, axis=2)], axis=2).transpose(0, 2, 1)
    return pixels if np.isfinite(pixels).all() and np.all(np.linalg.det(pixels) != 0) else None


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
    from astropy.coordinates import ICRS, SkyCoord

    step = 0.5 * np.array([math.cos(math.radians(theta_deg)), math.sin(math.radians(theta_deg))])
    behind_ahead_here = np.array([-1.0, 1.0, 0.0])
    world = wcs.pixel_to_world_values(x + step[0] * behind_ahead_here, y + step[1] * behind_ahead_here)
    lon, lat, frame = world[wcs.wcs.lng], world[wcs.wcs.lat], celestial_frame(wcs)
    if frame is None:
        return math.nan
    equatorial = np.radians(lon), np.radians(lat)
    if not isinstance(frame, ICRS):
        position = SkyCoord(lon, lat, unit="deg", frame=frame).icrs
        equatorial = position.ra.rad, position.dec.rad
    (ax, bx, cx), (ay, by, cy) = equatorial
    direction = _unit_vector(bx, by) - _unit_vector(ax, ay)
    east = np.array([-math.sin(cx), math.cos(cx), 0.0])
    north = np.array([-math.sin(cy) * math.cos(cx), -math.sin(cy) * math.sin(cx), math.cos(cy)])
    return math.degrees(math.atan2(direction @ east, direction @ north)) % 360.0


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


def usable_part(whole: Any) -> tuple[Any | None, tuple[str, ...]]:
    """Return the celestial part of a WCS where it can be used, and why it cannot, or what it does not give.

    Parameters
    ----------
    whole : astropy.wcs.WCS
        Of any axes.

    Returns
    -------
    wcs : astropy.wcs.WCS or None
    warnings : tuple of str
    """
    if not whole.has_celestial:
        kinds = [kind for kind in whole.wcs.ctype if _NEARLY_CELESTIAL.match(kind)]
        return None, tuple(f"the WCS is ignored: {kind!r} is no celestial axis" for kind in kinds[:1])
    celestial = whole.celestial
    celestial.wcs.radesys = celestial.wcs.radesys.upper()  # astropy knows no fk5
    if {whole.wcs.lng, whole.wcs.lat} != {0, 1}:
        return None, ("the WCS has the sky along other axes than those of the image and is ignored",)
    matrix = celestial.pixel_scale_matrix
    if not 0 < abs(np.linalg.det(matrix)) < np.inf:
        return None, ("the WCS cannot be inverted and is ignored",)
    if np.any(np.linalg.norm(matrix, axis=0) == 1):
        return None, ("the WCS has the default scale of 1 degree a pixel, so it says none and is ignored",)
    if celestial_frame(celestial) is None:
        frame = " ".join(filter(None, (*celestial.wcs.ctype, celestial.wcs.radesys)))
        return celestial, (f"the WCS's frame ({frame}) is not converted: no position angle is given",)
    return celestial, ()


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
        A pixel ``(x, rows - 1 - y)`` has the position on the sky that ``(x, y)`` has in the other.  None
        where the coordinates have lookup tables.
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
