"""Many frames into one: the mean of a stack and the variance of a frame, cosmic rays left out.

Reach for :func:`combine`.  A value is left out if it lies further from the middle of its pixel than
``clip`` times the noise of a frame.  That noise is not read off the few values of the pixel, which would
cut tails by the noise of the noise, but off the pixels around it; only a pixel that is noisier than they
are is measured by its own values, extremes left out.  So almost nothing is cut where there is nothing to
cut, and what is cut is known.

A :class:`MeasuredMap` is what is made of masters: a map with its error.  One number for all pixels may serve
better.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from jitterkit.calibration.stack import Stack

CLIP = 5.0
"""Noises of a frame beyond which a value is left out: one of two million of a normal."""

MEMORY = 1.2e9
"""Bytes that the pixels of a band may take; some 1.5 GB come on top for 20 megapixels."""

_TILE = 64
"""Pixels along a side of the tiles in which the usual noise is read: good to 4 % with two frames."""

_NOISY = 2.0
"""Times the usual variance from which a pixel's own counts; one in 20 reaches it by chance with ten frames,
which at worst lets a ray of 7 usual noises pass."""

_LEFT_OUT = 8
"""One in so many values is left out at either end for a pixel's own noise; at least one."""

_SURELY_KEPT = 1.5
"""A pixel without a value further than ``clip`` over this from its mean is not examined: the middle lies
within one noise of the mean."""

_ONE_IN_A_MILLION = 1e-6
_LEAST_VARIANCE = 0.25
"""ADU²: less than that whole numbers do not show."""


@dataclass(frozen=True, eq=False)
class Master:
    """A stack as one frame.

    Parameters
    ----------
    mean : (ny, nx) array
        ADU.
    variance : (ny, nx) array
        Of one frame, ADU², with the rounding of the converter; unbiased.
    kept : (ny, nx) int array
        How many values made each pixel.
    frames : int
        How many there were.
    exposure : float, optional
        s.
    unusable : (ny, nx) bool array
        Where there is no value at all.
    usual : (ny, nx) array
        Variance of a frame that the pixels around have [ADU²].
    neighbours : float
        Mean correlation of the noise of a pixel with that of its nearest neighbours.
    rounding : float
        Variance that whole numbers add [ADU²].
    """

    mean: np.ndarray
    variance: np.ndarray
    kept: np.ndarray
    frames: int
    exposure: float | None
    unusable: np.ndarray
    usual: np.ndarray
    neighbours: float
    rounding: float

    @property
    def error(self) -> np.ndarray:
        """Return the standard error of the mean of each pixel [ADU], from its own scatter."""
        return np.sqrt(self.variance / self.kept)

    @property
    def rejected(self) -> int:
        """Return how many values were left out."""
        return int(self.frames * self.kept.size - self.kept.sum())

    def typical_variance(self, good: np.ndarray) -> tuple[float, float]:
        """Mean variance of a frame over good pixels, less the rounding's 1/12, and its error [ADU²].

        Pixels beyond one in a million are left out: they are noisier than their neighbours.
        """
        variance = self.variance[good]
        limit = stats.chi2.isf(_ONE_IN_A_MILLION, self.frames - 1) / (self.frames - 1)
        within = variance <= limit * np.broadcast_to(self.usual, self.variance.shape)[good]
        value = float(np.mean(variance[within], dtype=float))
        error = value * (2 / ((self.frames - 1) * max(int(within.sum()), 1))) ** 0.5
        return value - self.rounding, error


def combine(
    stack: Stack,
    *,
    clip: float = CLIP,
    memory: float = MEMORY,
    scales: np.ndarray | None = None,
    pedestal: float = 0.0,
) -> Master:
    """Average a stack pixel by pixel, without cosmic rays.

    Parameters
    ----------
    stack : Stack
        Of two frames or more.
    clip : float
        Noises of a frame beyond which a value is left out.
    memory : float
        Bytes that the pixels read at a time may take; the result does not depend on it.
    scales : (n,) array, optional
        What each frame's signal above ``pedestal`` is divided by: the lamp's brightness.
    pedestal : float
        ADU.

    Returns
    -------
    master : Master
        Its variance is corrected for what the clipping takes from a normal (:func:`kept_variance`): 15 in a
        million at 5 sigma.

    Notes
    -----
    *Assumes* noise that changes little over 64 pixels but for single pixels of their own.
    *Fails when* a ray hits one pixel in an eighth of the frames or more, or only two frames are given and
    the ray adds less than 7 noises of their difference.
    """
    ny, nx = stack.shape
    mean = np.empty((ny, nx))
    variance, usual = np.empty((ny, nx), np.float32), np.empty((ny, nx), np.float32)
    kept = np.full((ny, nx), len(stack), dtype=np.int32)
    products = np.zeros(2)
    factors = np.ones(len(stack)) if scales is None else np.asarray(scales, dtype=float)
    for first, band in stack.bands(memory, _TILE):
        for top in range(0, band.shape[1], _TILE):
            strip = band[:, top : top + _TILE]
            at = slice(first + top, first + top + strip.shape[1])
            origin = (strip[0] - pedestal) / factors[0]
            # of the first frame's values, so that single precision loses nothing
            deviations = np.empty(strip.shape, dtype=np.float32)
            for index, (plane, factor) in enumerate(zip(strip, factors, strict=True)):
                deviations[index] = (plane - pedestal) / factor - origin
            centre, scatter = _moments(deviations)
            usual[at] = _tiles(scatter, len(stack))
            _clip(deviations, centre, scatter, kept[at], usual[at], clip)
            variance[at] = scatter / kept_variance(clip, len(stack))
            mean[at] = pedestal + origin + centre
            products += _neighbours(deviations)
    together = float(products[0] / products[1]) if products[1] else 0.0
    about = (len(stack), stack.exposure, stack.unusable)
    return Master(mean, variance, kept, *about, usual, together, stack.rounding)


def kept_variance(clip: float, frames: int) -> float:
    """Share of the variance of a normal that is left within ``clip`` sigma of the mean of so many frames.

    >>> round(kept_variance(3.0, 1000), 4)
    0.9734
    """
    reach = clip / (1 - 1 / frames) ** 0.5
    return float(1 - 2 * reach * stats.norm.pdf(reach) / (1 - 2 * stats.norm.sf(reach)))


def _moments(deviations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the mean and unbiased variance along the stack; the mean is taken off in place."""
    centre = deviations.mean(axis=0, dtype=np.float64)
    deviations -= centre
    return centre, np.einsum("ijk,ijk->jk", deviations, deviations) / (len(deviations) - 1.0)


def _clip(
    deviations: np.ndarray,
    centre: np.ndarray,
    variance: np.ndarray,
    kept: np.ndarray,
    usual: np.ndarray,
    clip: float,
) -> None:
    """Correct mean, variance and count, in place, where a value lies too far from the others."""
    far = np.maximum(deviations.max(axis=0), -deviations.min(axis=0))
    suspects = far > clip / _SURELY_KEPT * np.sqrt(usual)
    if not suspects.any():
        return
    values = np.sort(deviations[:, suspects].astype(np.float64), axis=0)
    own = _own_variance(values)
    noise = np.where(own > _NOISY * usual[suspects], own, usual[suspects])
    # the mean of the middle half: as robust as the median, but no whole number
    outer = len(values) // 4 if len(values) > 3 else (len(values) - 1) // 2
    middle = values[outer : len(values) - outer].mean(axis=0)
    keep = np.abs(values - middle) <= clip * np.sqrt(noise)
    keep[: len(values) // 2] |= ~keep.any(axis=0)  # of two that differ, the lower: a ray only adds
    count = keep.sum(axis=0)
    mean = np.where(keep, values, 0.0).sum(axis=0) / count
    square = np.where(keep, (values - mean) ** 2, 0.0).sum(axis=0)
    deviations[:, suspects] = np.where(keep.all(axis=0), deviations[:, suspects], 0.0)
    centre[suspects] += mean
    variance[suspects] = np.where(count > 1, square / np.maximum(count - 1, 1), usual[suspects])
    kept[suspects] = count


def _tiles(variance: np.ndarray, frames: int) -> np.ndarray:
    """Return the usual variance around each pixel of a strip: the median of chi square is not its mean."""
    usual = np.empty_like(variance)
    for left in range(0, variance.shape[1], _TILE):
        median = float(np.median(variance[:, left : left + _TILE]))
        typical = median * (frames - 1) / stats.chi2.median(frames - 1)
        usual[:, left : left + _TILE] = max(typical, _LEAST_VARIANCE)
    return usual


def _own_variance(values: np.ndarray) -> np.ndarray:
    """Variance of each pixel from its sorted values, the extremes left out; zero of less than three."""
    left_out = max(1, len(values) // _LEFT_OUT)
    core = values[left_out : len(values) - left_out]
    if len(core) < 2:
        return np.zeros(values.shape[1])
    reach = stats.norm.isf(left_out / len(values))
    share = 1 - 2 * reach * stats.norm.pdf(reach) / (1 - 2 * left_out / len(values))
    return core.var(axis=0, ddof=1) / share


def _neighbours(deviations: np.ndarray) -> np.ndarray:
    """Sums of products of the noise with that of the next pixel, both ways, and of its squares."""
    squares = np.einsum("ijk,ijk->jk", deviations, deviations)
    limit = 10 * float(np.median(squares))
    quiet = np.where(squares <= limit, deviations, 0.0).astype(np.float32)
    across = np.vdot(quiet[:, :, 1:], quiet[:, :, :-1]) / max(quiet.shape[2] - 1, 1) * quiet.shape[2]
    along = np.vdot(quiet[:, 1:], quiet[:, :-1]) / max(quiet.shape[1] - 1, 1) * quiet.shape[1]
    return np.array([(across + along) / 2, np.vdot(quiet, quiet)])


_MANY = 10_000
"""Frames that nobody takes."""


@dataclass(frozen=True, eq=False)
class MeasuredMap:
    """A map with its error.

    Parameters
    ----------
    name : str
        As the detector calls it: ``"bias"``, ``"read_noise"``, ``"dark_current"``, ``"flat"``.
    unit : str
    values : (ny, nx) array
    error : float
        Standard error of a typical pixel.
    number, number_error : float
        That of all good pixels, and its standard error.
    spread : float
        Standard deviation over the good pixels.
    frames : int
        How many frames it was made of.
    """

    name: str
    unit: str
    values: np.ndarray
    error: float
    number: float
    number_error: float
    spread: float
    frames: int

    @property
    def true_spread(self) -> float:
        """Return the spread less what the errors make of it; zero where they make all of it."""
        return max(self.spread**2 - self.error**2, 0.0) ** 0.5

    @property
    def serves(self) -> bool:
        """Return whether pixels differ by more than the map's error: else a number is nearer to the truth."""
        return self.true_spread > self.error

    def sentence(self) -> str:
        """Say whether the frames were enough."""
        unit = f" {self.unit}" if self.unit else ""
        ratio = f"pixels differ by {self.true_spread:.3g}{unit}, a pixel is known to {self.error:.3g}{unit}"
        conclusion = "the map serves" if self.serves else "one number serves better than the map"
        more = ""
        if 0 < self.true_spread <= self.error:
            wanted = int(np.ceil(self.frames * (self.error / self.true_spread) ** 2 * 2))
            more = f", until there are some {wanted} frames" if wanted < _MANY else ""
        return f"{self.name.replace('_', ' ')} of {self.frames} frames: {ratio}; {conclusion}{more}."
