"""A locus for other tools and for pictures: drawn on the pixels, and as header cards.

The cards are poppy's and stpsf's ``JITR*`` and Roman's ``JITTER_*``.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from jitterkit.conventions import axis_angle
from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.loci.base import Locus, principal_axes

_POINTS = 65536


def rasterise(
    locus: Locus,
    plate_scale: float,
    shape: tuple[int, int] | None = None,
    centre: tuple[float, float] = (0.0, 0.0),
) -> np.ndarray:
    """Deposit a jitter locus on the pixel grid as a kernel.

    Parameters
    ----------
    locus : Locus
    plate_scale : float
        arcsec per pixel.
    shape : (int, int), optional
        ``(ny, nx)``, both odd, so that the centre is a pixel.  By default the smallest square that
        holds the locus.
    centre : (float, float)
        Offset ``(x, y)`` of the locus from the centre of the middle pixel, arcsec.

    Returns
    -------
    kernel : (ny, nx) array
        Share of the time spent on each pixel; sums to one.  Over all positions of ``centre`` within a
        pixel its covariance is, on average, the locus's plus the pixel's own p²/12 (Sheppard).

    Raises
    ------
    ConfigurationError
        If a side is even, or the locus does not fit; the message gives the size it needs.

    Notes
    -----
    The forward model never uses this: it has the transfer function.
    """
    x, y = (locus.points(_POINTS) + np.asarray(centre)).T / plate_scale
    reach = int(np.floor(max(np.abs(x).max(), np.abs(y).max()) + 0.5))
    if shape is None:
        shape = (2 * reach + 1, 2 * reach + 1)
    ny, nx = shape
    if ny % 2 == 0 or nx % 2 == 0:
        problem = f"A kernel's sides must be odd, so that its centre is a pixel; got {shape}."
        raise ConfigurationError(ErrorCode.WRONG_SHAPE, problem)
    columns = np.floor(x + nx / 2).astype(int)
    rows = np.floor(y + ny / 2).astype(int)
    if columns.min() < 0 or rows.min() < 0 or columns.max() >= nx or rows.max() >= ny:
        problem = f"The locus does not fit into {shape}; it needs {(2 * reach + 1, 2 * reach + 1)}."
        raise ConfigurationError(ErrorCode.WRONG_SHAPE, problem)
    counts = np.bincount(rows * nx + columns, minlength=ny * nx).reshape(ny, nx)
    return counts / counts.sum()


_ROUND = 0.01
"""Share by which the axes of a normal may differ that is called round."""


def jitter_cards(moments, *, normal: bool = False) -> dict[str, tuple[Any, str]]:
    """Cards for a blur of given second moments.

    Parameters
    ----------
    moments : (3,) array
        ``(Sxx, Sxy, Syy)``, arcsec².
    normal : bool
        Whether it is a normal density.

    Returns
    -------
    cards : dict
        Keyword to ``(value, comment)``.

    Notes
    -----
    ``JITRTYPE`` and ``JITRSIGM`` [arcsec, per axis] are poppy's: its Gaussian is round, so every other blur
    is stpsf's "Custom jitter kernel" and has no ``JITRSIGM``.  ``JITTER_MAJOR``, ``JITTER_MINOR`` [mas, 1
    sigma] and ``JITTER_POSITION_ANGLE`` are Roman's.  Its pipeline (romancal, ``psf.add_jitter``) turns that
    angle from +y towards +x of the detector: 90 degrees less ours, which stands in ``JTRANGLE``.
    """
    major, minor, angle = principal_axes(moments)
    cards: dict[str, tuple[Any, str]] = {"JITRTYPE": ("Custom jitter kernel", "type of jitter")}
    if normal and minor > (1 - _ROUND) * major:
        sigma = math.hypot(major, minor) / math.sqrt(2)
        cards["JITRTYPE"] = ("Gaussian convolution", "type of jitter")
        cards["JITRSIGM"] = (sigma, "[arcsec] sigma of the jitter, per axis")
    cards["JITTER_MAJOR"] = (1e3 * major, "[mas] 1 sigma, major axis")
    cards["JITTER_MINOR"] = (1e3 * minor, "[mas] 1 sigma, minor axis")
    cards["JITTER_POSITION_ANGLE"] = (axis_angle(90 - angle), "[deg] from +y to +x")
    cards["JTRANGLE"] = (angle, "[deg] major axis, ccw from +x")
    return cards
