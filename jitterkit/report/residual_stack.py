"""The residuals of a run's frames, added about their stars, and a test for structure that frames share.

Reach for :func:`stack_residuals`, which a run calls for the frames of a batch, and :func:`join_stacks`.  A
misfit that is the same in ``N`` frames is ``sqrt(N)`` times as significant in their sum as in their mean
chi-squared.
"""

from __future__ import annotations

import io
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np
from scipy import ndimage, special

if TYPE_CHECKING:  # at run time a table is read without JAX
    from jitterkit.frames import Frame
    from jitterkit.refit import FitResult

_STEPS = 256
"""Steps of a sigma to which residuals are rounded.  Sums of integers do not depend on their order, so that
threads, workers and resumed runs give one stack; rounding adds 1e-6 of a pixel's variance."""

_FINE = 1 << 16
"""Steps to which read variances [electrons²] and positions [pixels] are rounded, likewise."""

_KERNELS = (np.ones((1, 1), np.int64), np.ones((3, 3), np.int64))
"""What a stack is smoothed with before its structure is tested: nothing, and a box.  Speckles are as wide as
the resolution, 2 to 3 pixels of a camera that samples it."""

FEWEST = 8
"""Frames from which their scatter tells the error of their mean, and what they have in common is tested."""


class Structure(NamedTuple):
    """Hold the structure common to the frames of a stack.

    Attributes
    ----------
    chi2_dof : float
        Chi-squared of the stack over that of a single frame: one if frames have nothing in common.
    sigmas : float
        Significance, of the more significant of the tests and for their number.
    excess : float
        Chi-squared that the common part adds to each frame.
    """

    chi2_dof: float
    sigmas: float
    excess: float

    @classmethod
    def unknown(cls) -> Self:
        """Return what is said of too few frames."""
        return cls(math.nan, math.nan, math.nan)


@dataclass(frozen=True, eq=False)
class ResidualStack:
    """Sum of the residuals of frames, with their stars at one place.

    Attributes
    ----------
    plate_scale : float
        arcsec per pixel.
    frames : int
    total : (ny, nx) int array
        In 1/256 sigma; the position of the scene, ``(x, y)``, is within half a pixel of the centre.
    counts : (ny, nx) int array
        Frames that use a pixel.
    squares : (2,) int array
        Sums, over frames and pixels, of the squared residual before and after smoothing.
    beside : (2,) int array
        Sums of the positions ``(y, x)`` of the scenes from the centre, in 1/65536 pixel.
    read_variance : int
        Sum of the frames' mean variances that no light makes, in 1/65536 electron².
    """

    plate_scale: float
    frames: int
    total: np.ndarray
    counts: np.ndarray
    squares: np.ndarray
    beside: np.ndarray = field(default_factory=lambda: np.zeros(2, np.int64))
    read_variance: int = 0

    @classmethod
    def of(cls, result: FitResult, plate_scale: float, read_variance: float, shape: tuple[int, int]) -> Self:
        """Make the stack of one frame; what it has outside of a stack's ``shape`` (ny, nx) is left out."""
        assert result.residual is not None
        assert result.parameters is not None
        residual, scene = np.asarray(result.residual), result.parameters.scene
        moved = np.full(shape, np.nan)
        positions = float(scene.y) / plate_scale, float(scene.x) / plate_scale
        overlaps = map(_overlap, residual.shape, shape, positions)
        source, target, beside = zip(*overlaps, strict=True)
        moved[target] = residual[source]
        used = np.isfinite(moved)
        total = np.rint(np.where(used, moved, 0.0) * _STEPS).astype(np.int64)
        squares = np.array([np.sum(_smoothed(total, kernel) ** 2) for kernel in _KERNELS])
        beside, variance = np.rint(np.array(beside) * _FINE).astype(np.int64), round(read_variance * _FINE)
        return cls(plate_scale, 1, total, used.astype(np.int64), squares, beside, variance)

    @property
    def position(self) -> np.ndarray:
        """Return the mean position ``(y, x)`` of the scenes from the centre, pixels."""
        return self.beside / _FINE / self.frames

    @property
    def read_noise(self) -> float:
        """Root of the mean variance that no light makes, electrons."""
        return math.sqrt(self.read_variance / _FINE / self.frames)

    def __add__(self, other: Self) -> Self:
        sums = {name: getattr(self, name) + getattr(other, name) for name in _SUMMED}
        return type(self)(min(self.plate_scale, other.plate_scale), **sums)  # alike, in any order the same

    def pack(self) -> bytes:
        """Return the stack as bytes: 16 a pixel."""
        buffer = io.BytesIO()
        np.savez(buffer, **{one.name: getattr(self, one.name) for one in fields(self)})
        return buffer.getvalue()

    @classmethod
    def unpack(cls, packed: bytes) -> Self:
        """Return the stack that :meth:`pack` packed."""
        with np.load(io.BytesIO(packed), allow_pickle=False) as arrays:
            found = {name: arrays[name] for name in arrays.files}
        scale, frames, variance = (found.pop(name) for name in ("plate_scale", "frames", "read_variance"))
        return cls(float(scale), int(frames), read_variance=int(variance), **found)

    def sigmas(self, copies: float = 1.0) -> np.ndarray:
        """Return the stack (ny, nx) in units of its noise; NaN where no frame uses a pixel."""
        noise = np.sqrt(copies * np.where(self.counts > 0, self.counts, np.nan))
        return self.total / _STEPS / noise

    def structure(self, copies: float = 1.0) -> Structure:
        """Test whether frames have a residual in common.

        Parameters
        ----------
        copies : float
            How often a frame is in the stack, from :func:`count_copies`.

        Returns
        -------
        structure : Structure
            NaN of fewer than eight frames.

        Notes
        -----
        Chi-squared of the sum, less that of the frames, is the sum of products of different frames.  Its
        mean is zero if their noise is independent, whatever the noise and whatever each fit has taken.  Its
        law is that of a weighted sum of squares, of which three moments are used.
        *Fails when* structure is fixed to the detector and the stars move over it by more than a pixel.
        """
        if self.frames < FEWEST * copies or not self.squares.all():
            return Structure.unknown()
        tests = [self._common(*pair, copies) for pair in zip(_KERNELS, self.squares, strict=True)]
        chance = special.log_ndtr(-max(score for _, score, _ in tests))
        several = chance + np.log(2 - np.exp(chance))  # 1 - (1 - p)²
        excess = max(0.0, *(excess for _, _, excess in tests))
        return Structure(tests[0][0], float(-special.ndtri_exp(several)), excess)

    def _common(self, kernel: np.ndarray, square: int, copies: float) -> tuple[float, float, float]:
        """Return chi-squared per degree of freedom, its significance, and the excess per frame, at least."""
        frames, counts = self.frames, self.counts.astype(float)
        own = copies * float(square)
        common = float(np.sum(_smoothed(self.total, kernel).astype(float) ** 2)) - own
        variance = float(square) / _smoothed(counts, kernel**2).sum()  # of a pixel of a frame
        overlap = ndimage.convolve(np.pad(kernel, kernel.shape[0] - 1), kernel, mode="constant")
        pairs = (1 - copies / frames) * np.sum(counts * _smoothed(counts, overlap**2))
        deviation = copies * variance * math.sqrt(2 * pairs)
        power = np.abs(np.fft.fft2(kernel, counts.shape)) ** 2
        freedom = np.mean(power**2) ** 3 / np.mean(power**3) ** 2 * np.count_nonzero(counts)
        most = float(kernel.sum() * _STEPS * frames) ** 2  # no structure gains more by smoothing
        excess = common / most / (1 - copies / frames)
        return 1 + common / own, _normal_score(common / deviation, freedom), excess


_SUMMED = ("frames", "total", "counts", "squares", "beside", "read_variance")


def stack_residuals(
    fitted: Iterable[tuple[FitResult, float, float]], shape: tuple[int, int]
) -> dict[str, ResidualStack]:
    """Stack the residuals of usable frames.

    Parameters
    ----------
    fitted : iterable of (FitResult, float, float)
        With the plate scale of each, arcsec per pixel, and its mean variance that no light makes, electrons².
    shape : (int, int)
        ``(ny, nx)`` of a stack.  Frames of any shape are stacked.

    Returns
    -------
    stacks : dict
        By scene, with or without further stars, and by plate scale to three digits: over a few hundred
        pixels, frames that differ by less have the same image to a fraction of a pixel.
    """
    stacks: dict[str, ResidualStack] = {}
    for result, scale, variance in fitted:
        if result.status.usable and result.residual is not None and result.parameters is not None:
            scene = result.parameters.scene
            name = f"{scene.name}{' and others' * (scene.others is not None)} at {scale:.3g} arcsec"
            stacks = join_stacks(stacks, {name: ResidualStack.of(result, scale, variance, shape)})
    return stacks


def to_stack(frame: Frame, result: FitResult, plate_scale: float) -> tuple[FitResult, float, float]:
    """Return a fit as :func:`stack_residuals` takes it; its frame may lack the plate scale [arcsec]."""
    variance = float(np.mean(frame.read_variance, where=~frame.mask))
    return result, frame.plate_scale or plate_scale, variance


class LatestPass:
    """Stack the residuals of frames that are fitted several times, of their latest fits.

    Parameters
    ----------
    plate_scale : float
        The instrument's, arcsec per pixel.

    Attributes
    ----------
    stacks : dict
        As :func:`stack_residuals` returns them.
    """

    def __init__(self, plate_scale: float) -> None:
        self.stacks: dict[str, ResidualStack] = {}
        self._plate_scale, self._number = plate_scale, 0

    def add(self, number: int, frame: Frame, result: FitResult) -> None:
        """Add a frame's fit in a pass; the first of a later pass removes those of the one before."""
        before = self.stacks if number == self._number else {}
        fitted = [to_stack(frame, result, self._plate_scale)]
        self.stacks, self._number = join_stacks(before, stack_residuals(fitted, frame.shape)), number


def join_stacks(
    some: Mapping[str, ResidualStack], others: Mapping[str, ResidualStack]
) -> dict[str, ResidualStack]:
    """Add up stacks of the same name."""
    return {**some, **{name: some[name] + one if name in some else one for name, one in others.items()}}


def most_stacked(stacks: Mapping[str, ResidualStack]) -> ResidualStack | None:
    """Return the stack with most frames; None if there is none."""
    return min(stacks.items(), key=lambda named: (-named[1].frames, named[0]), default=("", None))[1]


def count_copies(table: Mapping[str, Any]) -> float:
    """Return how often the frames of a results table are in its stack, where duplicates are stacked too.

    It is the mean square of the numbers of copies over their mean: one without duplicates, two if every frame
    is there twice.
    """
    status, digests = (np.asarray(table[name], str) for name in ("status", "digest"))
    stacked = np.isin(status, ("ok", "duplicate")) & (digests != "")
    _, numbers = np.unique(digests[stacked], return_counts=True)
    return float(np.sum(numbers**2) / np.sum(numbers)) if len(numbers) else 1.0


def _overlap(n: int, size: int, position: float) -> tuple[slice, slice, float]:
    """Return which pixels of ``n`` are which of ``size``, by the star's position, and its offset."""
    shift = round((size - n) / 2 - position)
    first, last = max(0, -shift), min(n, size - shift)
    beside = (n - size) / 2 + position + shift
    return slice(first, max(first, last)), slice(first + shift, max(first, last) + shift), beside


def _smoothed(image: np.ndarray, kernel: np.ndarray) -> np.ndarray:
    return ndimage.convolve(image, kernel, mode="constant") if kernel.size > 1 else image * kernel[0, 0]


def _normal_score(z: float, freedom: float) -> float:
    """Return the normal deviate that is as unlikely as one of chi-squared, of mean 0 and variance 1.

    By Wilson and Hilferty (1931), which is right to 0.01 at 5 sigma of 100 degrees of freedom.
    """
    width = 2 / (9 * freedom)
    return float((np.cbrt(1 + z * math.sqrt(2 / freedom)) - (1 - width)) / math.sqrt(width))
