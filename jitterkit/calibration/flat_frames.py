"""Flat frames: the response of each pixel, and the pixels that have none.

Reach for :class:`Response`: give it the masters one after the other, and ask it for the map.
"""

from __future__ import annotations

import numpy as np

from jitterkit.calibration.master import Master, MeasuredMap
from jitterkit.errors import ConfigurationError, ErrorCode

DEAD = 0.5
"""Share of the usual response below which a pixel is dead."""

_ORDER = 3
"""Of the polynomial in x and y that stands for the illumination: falls, tilts, and a lamp off the axis."""

_TILES = 48
"""Medians along either side from which it is fitted; 10 terms of 2304 medians."""


class Response:
    """The sum of flats of all levels: of photon noise nothing tells more.

    Parameters
    ----------
    bias : Master or float
        The reading without exposure [ADU].
    dark_rate : (ny, nx) array or float
        ADU/s.
    """

    def __init__(self, bias: Master | float, dark_rate: np.ndarray | float = 0.0) -> None:
        self._bias = bias
        self._dark_rate = dark_rate
        self._sum: np.ndarray | float = 0.0
        self._variance: np.ndarray | float = 0.0
        self.frames = 0

    def add(self, master: Master) -> None:
        """Add the flats of an exposure time."""
        n = master.frames
        level = self._bias.mean if isinstance(self._bias, Master) else self._bias
        self._sum = self._sum + n * (master.mean - level - self._dark_rate * (master.exposure or 0.0))
        self._variance = self._variance + n**2 * master.variance / master.kept
        self.frames += n

    @property
    def sums(self) -> np.ndarray:
        """Light of each pixel in all frames together [ADU]."""
        return np.asarray(self._sum)

    def map(
        self, good: np.ndarray, *, smooth: bool = False, bend: float = 1.0
    ) -> tuple[MeasuredMap, MeasuredMap]:
        """Return the response of each pixel, one on average over good pixels.

        Parameters
        ----------
        good : (ny, nx) bool array
        smooth : bool
            Whether to divide by :func:`surface`: the lamp's light then does not count as the detector's
            response, and neither does the telescope's vignetting.
        bend : float
            Relative rise of a reading over that of its light; not one where the detector is not linear.

        Returns
        -------
        flat : MeasuredMap
            Relative response; zero at pixels that are not good.
        local : MeasuredMap
            The same over the smooth surface, whose true spread is the PRNU.
        """
        sums = np.where(good, self._sum, 0.0)
        variance = np.asarray(self._variance)
        if isinstance(self._bias, Master):
            variance = variance + self.frames**2 * self._bias.variance / self._bias.kept
        level = surface(sums, good)
        whole = _normalised(sums, variance, good, self.frames, bend)
        local = _normalised(np.where(good, sums / level, 0.0), variance / level**2, good, self.frames, bend)
        return (local if smooth else whole), local


def lamp(levels: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """Return how bright the lamp was in each frame of a stack, one on average.

    Parameters
    ----------
    levels : (n,) array
        Above bias and dark [ADU].
    errors : (n,) array
        Of the levels: a frame whose level is not ten times that is left as it is.

    Returns
    -------
    scales : (n,) array
    """
    if not np.all(levels > 10 * errors):
        return np.ones(len(levels))
    return levels / levels.mean()


def surface(image: np.ndarray, good: np.ndarray) -> np.ndarray:
    """Return a smooth surface through an image: a polynomial of the third order in x and y.

    Parameters
    ----------
    image : (ny, nx) array
    good : (ny, nx) bool array
        Pixels that count.

    Returns
    -------
    surface : (ny, nx) array
        Fitted to the medians of tiles; where there are too few of them, the median of all.

    Raises
    ------
    ConfigurationError
        If it is not positive everywhere, so that nothing can be divided by it.
    """
    x, y, z = _medians(image, good)
    terms = [(i, j) for i in range(_ORDER + 1) for j in range(_ORDER + 1 - i)]
    if len(z) < 4 * len(terms):
        terms = [(0, 0)]
    design = np.stack([x**i * y**j for i, j in terms], axis=1)
    fit = np.linalg.lstsq(design, z, rcond=None)[0]
    coefficients = np.zeros((_ORDER + 1, _ORDER + 1))
    for (i, j), value in zip(terms, fit, strict=True):
        coefficients[i, j] = value
    ny, nx = image.shape
    sides = np.linspace(-1, 1, nx), np.linspace(-1, 1, ny)
    found = np.polynomial.polynomial.polygrid2d(*sides, coefficients).T
    if not np.all(found > 0):
        problem = f"the flats fall to {found.min():.3g} ADU above the bias in places"
        raise ConfigurationError(ErrorCode.NO_SIGNAL, f"{problem}; give flats that are lit all over.")
    return found


def _medians(image: np.ndarray, good: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the median of each tile of an image at its position, -1 to 1 along either axis."""
    ny, nx = image.shape
    rows, columns = (np.array_split(np.arange(n), min(_TILES, max(n // 8, 1))) for n in (ny, nx))
    found = []
    for row in rows:
        for column in columns:
            at = np.s_[row[0] : row[-1] + 1, column[0] : column[-1] + 1]
            if 2 * good[at].sum() > good[at].size:
                middle = (column.mean() * 2 / max(nx - 1, 1) - 1, row.mean() * 2 / max(ny - 1, 1) - 1)
                found.append((*middle, float(np.median(image[at][good[at]]))))
    x, y, z = np.array(found or [(0.0, 0.0, float(np.median(image)))]).T
    return x, y, z


def _normalised(
    image: np.ndarray, variance: np.ndarray, good: np.ndarray, frames: int, bend: float
) -> MeasuredMap:
    mean = float(image[good].mean())
    values = np.where(image > 0, 1 + (image / mean - 1) / bend, 0.0)
    error = float(np.sqrt(np.mean(variance[good]))) / mean / bend
    number_error, spread = error / float(good.sum()) ** 0.5, float(values[good].std())
    return MeasuredMap("flat", "", values, error, 1.0, number_error, spread, frames)
