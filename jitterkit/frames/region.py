"""Find the stars in a full camera frame and cut them out.

The pattern of a diffractive pupil is spread over some 100 pixels and its peak holds a thousandth of
the light, so no peak finder sees it.  :func:`find_region` looks for the largest *concentration of
light* at the scale of the region instead, which finds an ordinary star as well.
"""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import numpy as np
from scipy.special import ndtri
from scipy.stats import median_abs_deviation

from jitterkit.errors import ErrorCode, FrameError
from jitterkit.frames.frame import RawFrame
from jitterkit.vision import bin_mean, box_mean, median_filter

#: Chance that pure noise is taken for a star, over the whole frame.
FALSE_ALARM = 1e-3
#: Side of a background tile in regions: large enough that its median is sky.
TILE = 3
#: A pixel this many times the noise from the median of its neighbours is no light.
OUTLIER = 5.0


def find_region(raw: RawFrame, shape: tuple[int, int] = (128, 128)) -> RawFrame:
    """Cut out the region that holds the most light.

    Parameters
    ----------
    raw : RawFrame
        Sky, bias and hot pixels included.
    shape : (int, int)
        ``(ny, nx)`` of the region [pixels].

    Returns
    -------
    region : RawFrame
        The light is at its centre, or as near to it as the border allows; ``origin`` says where it
        lay.  A frame no larger than ``shape`` is returned as it is.

    Raises
    ------
    FrameError
        If nothing rises above the noise: its code is ``NO_STAR``.

    Notes
    -----
    Pixels unlike their neighbours are replaced and the frame is binned to a sixteenth of the region;
    the median of tiles three regions wide is taken as the sky; then the mean over half a region is
    maximised and the position refined by the centroid of the light within the region.

    *Assumes* a sky that changes little over three regions.  The threshold is the level that noise
    exceeds anywhere in the frame with a chance of 1e-3, the noise measured from the differences of
    pixels and, where there are enough, from the boxes themselves.

    *Fails when* a star is so undersampled (FWHM below about 1.2 pixels) that it looks like a hot
    pixel, or a brighter star than the one wanted is in the frame.  Where a cosmic ray
    crosses a bad column the two hang together like a faint star: mask what is known to be bad.
    """
    ny, nx = (min(a, b) for a, b in zip(raw.shape, shape, strict=True))
    if (ny, nx) == raw.shape:
        return raw
    step = max(1, min(ny, nx) // 16)
    # between every other pixel, so that a colour mosaic is not noise
    rows = slice(None, None, max(1, raw.shape[0] // 500))
    steps = (raw.data[rows, 2:] - raw.data[rows, :-2])[~(raw.mask[rows, 2:] | raw.mask[rows, :-2])]
    noise = _spread(steps) / math.sqrt(2)
    light = _light(raw, noise, step, TILE * max(ny, nx) // step)
    x, y = _brightest(light, (ny, nx), step, noise, raw.path or Path(raw.name))
    x, y = _centred(light, x, y, (ny / step, nx / step))
    x0 = min(max(round((x + 0.5) * step - nx / 2), 0), raw.shape[1] - nx)
    y0 = min(max(round((y + 0.5) * step - ny / 2), 0), raw.shape[0] - ny)
    return raw.region(x0, y0, nx, ny)


def _light(raw: RawFrame, noise: float, step: int, tile: int) -> np.ndarray:
    """Return the binned frame above its sky."""
    data = raw.data.astype(np.float32)
    good = data[~raw.mask] if raw.mask.any() else data
    level = float(np.median(good.ravel()[:: max(1, good.size // 100_000)])) if good.size else 0.0
    data[raw.mask] = level
    binned = bin_mean(_without_outliers(data, noise, level), step).astype(np.float64)
    # the sky: medians of tiles, bilinearly between their centres
    rows, columns = (_edges(n, tile) for n in binned.shape)
    medians = [[np.median(binned[a:b, c:d]) for c, d in itertools.pairwise(columns)]
               for a, b in itertools.pairwise(rows)]  # fmt: skip
    up, across = (_weights(n, edges) for n, edges in zip(binned.shape, (rows, columns), strict=True))
    return binned - up @ np.asarray(medians) @ across.T


def _without_outliers(data: np.ndarray, noise: float, level: float) -> np.ndarray:
    """Replace pixels unlike their neighbours by the median of those further out.

    Only they are replaced: filtering every pixel would lift the two columns beside a bad one, whose
    medians are taken among fewer good pixels.  A star's own peak is less than twice the median about it.
    """
    around = median_filter(data, 3)
    odd = np.abs(data - around) > OUTLIER * noise + np.maximum(around - level, 0)
    return np.where(odd, median_filter(data, 5), data)


def _edges(length: int, tile: int) -> list[int]:
    count = max(1, round(length / tile))
    return [round(length * n / count) for n in range(count + 1)]


def _weights(length: int, edges: list[int]) -> np.ndarray:
    """Return the (length, tiles) matrix that interpolates between tile centres."""
    centres = (np.asarray(edges[1:]) + np.asarray(edges[:-1]) - 1) / 2
    unit = np.eye(len(centres))
    return np.stack([np.interp(np.arange(length), centres, row) for row in unit], axis=1)


def _brightest(
    light: np.ndarray, shape: tuple[int, int], step: int, noise: float, path: Path
) -> tuple[float, float]:
    """Return the bin ``(x, y)`` whose surroundings of half a region are brightest."""
    box = max(1, min(shape) // 2 // step)
    means, before, after = box_mean(light, box), box // 2, (box - 1) // 2
    # the mirrored boxes at the border of the frame average fewer pixels
    means = means[before : means.shape[0] - after, before : means.shape[1] - after]
    y, x = np.unravel_index(int(np.argmax(means)), means.shape)
    boxes = means[::box, ::box]  # their own noise, where there are enough for that
    sigma = max(noise / (box * step), _spread(boxes) if boxes.size >= 50 else 0.0)
    threshold = sigma * -ndtri(FALSE_ALARM / means.size)
    if not means[y, x] > threshold:
        problem = (
            f"nothing rises above the noise: the brightest {box * step} pixels square have a mean of "
            f"{means[y, x]:.3g} above the sky and {threshold:.3g} would be needed"
        )
        remedy = "check that the frame holds a star, or name the region"
        raise FrameError(ErrorCode.NO_STAR, path, problem, remedy)
    return x + (box - 1) / 2, y + (box - 1) / 2


def _spread(values: np.ndarray) -> float:
    """Return a standard deviation that outliers hardly change."""
    if not values.size:
        return 0.0
    # half of the values are equal where the noise is below the rounding
    away = math.sqrt(math.pi / 2) * float(np.abs(values - np.median(values)).mean())
    return float(median_abs_deviation(values, axis=None, scale="normal")) or away


def _centred(light: np.ndarray, x: float, y: float, size: tuple[float, float]) -> tuple[float, float]:
    """Move to the centroid of the light within a region, a few times."""
    rows, columns = (np.arange(n, dtype=float) for n in light.shape)
    floor = 3 * _spread(np.diff(light, axis=1)) / math.sqrt(2)
    for _ in range(4):
        near = (np.abs(rows - y) <= size[0] / 2)[:, None] & (np.abs(columns - x) <= size[1] / 2)
        weight = np.where(near & (light > floor), light, 0.0)
        total = weight.sum()
        if total <= 0:
            break
        x, y = float(weight.sum(axis=0) @ columns / total), float(weight.sum(axis=1) @ rows / total)
    return x, y
