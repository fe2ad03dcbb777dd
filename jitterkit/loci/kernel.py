"""A locus drawn on the pixels: for pictures, and for tools that convolve."""

from __future__ import annotations

import numpy as np

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.loci.base import Locus

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
