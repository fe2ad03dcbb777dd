"""Zernike polynomials in Noll's order, normalised to unit rms over the full unit disc.

Noll, J. Opt. Soc. Am. 66, 207 (1976).
"""

from __future__ import annotations

import math

import numpy as np

from jitterkit.errors import ConfigurationError, ErrorCode


def noll_to_nm(index: int) -> tuple[int, int]:
    """Radial and azimuthal order of Noll's polynomial; ``m < 0`` marks the sine.

    >>> [noll_to_nm(j) for j in (1, 4, 7, 10)]
    [(0, 0), (2, 0), (3, -1), (3, 3)]
    """
    if index < 1:
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, f"Noll's indices start at 1, got {index}.")
    n = int((math.sqrt(8 * index - 7) - 1) / 2)
    rank = index - n * (n + 1) // 2 - 1
    m = 2 * ((rank + 1) // 2) if n % 2 == 0 else 2 * (rank // 2) + 1
    return n, m if index % 2 == 0 else -m


def zernike(index: int, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Noll's polynomial at points of the plane; it continues beyond the disc, where a pupil is dark.

    Parameters
    ----------
    index : int
        Noll index, from 1 (piston); 4 is defocus, 5-6 astigmatism, 7-8 coma, 9-10 trefoil.
    x, y : arrays
        Coordinates in units of the disc's radius; the azimuth runs counter-clockwise from +x.

    Returns
    -------
    values : array
        Unit rms over the disc.
    """
    n, m = noll_to_nm(index)
    order = abs(m)
    rho, azimuth = np.hypot(x, y), np.arctan2(y, x)
    radial = sum(
        (-1) ** k
        * math.factorial(n - k)
        / (math.factorial(k) * math.factorial((n + order) // 2 - k) * math.factorial((n - order) // 2 - k))
        * rho ** (n - 2 * k)
        for k in range((n - order) // 2 + 1)
    )
    angular = np.cos(order * azimuth) if m >= 0 else np.sin(order * azimuth)
    scale = math.sqrt(n + 1) * (1.0 if m == 0 else math.sqrt(2.0))
    return scale * radial * angular
