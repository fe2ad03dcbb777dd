"""Find a star or a pair in a frame, without being told where to look.

The frame is fitted, by linear least squares, with two star templates and a constant.  One template is
held while the other is tried at every pixel, which takes one Fourier transform; then the two change
roles until neither moves.  Nothing is assumed about angle, distance, contrast or place, and a pattern
as wide as that of TOLIMAN's diffractive pupil is no harder than a compact star.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy import fft
from scipy.ndimage import maximum_filter

from jitterkit.conventions import offsets
from jitterkit.likelihood import Data
from jitterkit.loci.base import Locus
from jitterkit.optics.grid import Grid
from jitterkit.optics.otf import OTF
from jitterkit.scene import Binary, Star

__all__ = ["FoundPair", "find_pairs", "find_star", "residual_star", "resolution"]

Place = tuple[float, float]

_FAINTEST = 1 / 1000
"""Faintest companion considered, as a share of the brighter star."""

_ABOVE_NOISE = 6.0**2
"""Chi-squared from which a star is one: the best of some ten thousand places reaches 16 by chance."""


@dataclass(frozen=True)
class FoundPair:
    """A star pair that may be in a frame.

    Attributes
    ----------
    scene : Binary
        Places to about a tenth of a pixel.
    gain : float
        Chi-squared that the two stars explain.
    """

    scene: Binary
    gain: float


def find_star(data: Data, otf: OTF, jitter: Locus | None = None) -> Star | None:
    """Find the place and the light of the brightest star.

    Parameters
    ----------
    data, otf, jitter
        As for :func:`find_pairs`.

    Returns
    -------
    star : Star or None
        Its place to about a tenth of a pixel.  None if no star rises above the noise.
    """
    field = _Field.of(data, otf, jitter)
    single = field.single()
    if not single.max() > _ABOVE_NOISE:
        return None
    flat = int(single.argmax())
    return Star(*field.peak(single, flat), field.match.ravel()[flat] / field.power.ravel()[flat])


def residual_star(data: Data, image: np.ndarray, otf: OTF, jitter: Locus | None = None) -> tuple[Star, float]:
    """Find the star that would mend an expected image most.

    Parameters
    ----------
    data, otf, jitter
        As for :func:`find_pairs`.
    image : (ny, nx) array
        Expected electrons without that star.

    Returns
    -------
    star : Star
    gain : float
        Chi-squared that it would explain if nothing else changed.  What is near a star of the image explains
        less: there the fit that made the image has used it up.
    """
    counts = np.maximum(np.asarray(image) + np.asarray(data.offset), np.finfo(float).tiny)
    weight = np.where(data.used, np.asarray(data.weight) / counts, 0.0)
    grid, optics = otf.grid, _template(otf, jitter)
    match = _correlate(_embed((np.asarray(data.electrons) - image) * weight, grid), optics, grid)
    squares = fft.rfft2(fft.irfft2(optics, s=grid.fine_shape) ** 2)
    power = _correlate(_embed(weight, grid), squares, grid)
    gain = _ratio(np.clip(match, 0, None) ** 2, power)
    row, column = np.unravel_index(int(gain.argmax()), gain.shape)
    y, x = (offsets(n, grid.plate_scale) for n in grid.shape)
    star = Star(x[column], y[row], match[row, column] / max(power[row, column], np.finfo(float).tiny))
    return star, float(gain[row, column])


def find_pairs(
    data: Data, otf: OTF, jitter: Locus | None = None, *, bright: Place | None = None, most: int = 4
) -> list[FoundPair]:
    """Candidate star pairs of a frame, the best first.

    Parameters
    ----------
    data : Data
    otf : OTF
    jitter : Locus, optional
        Blur of the template, where it is known.
    bright : (x, y), optional
        Offset of the brighter star from the frame's centre [arcsec], where it is known: a tenth of a pixel
        off, it leaves more than a companion a hundred times fainter has.
    most : int
        Number of candidates, at most.

    Returns
    -------
    pairs : list of FoundPair
        Empty where no star rises above the noise by six standard errors (the best of some ten
        thousand places reaches four by chance).  A star that is alone comes with a companion a
        thousand times fainter at the resolution limit, for the fit to dismiss.

    Notes
    -----
    Weights are uniform and places are pixels: a start for a fit, not an estimate.
    """
    field = _Field.of(data, otf, jitter)
    single = field.single()
    if not single.max() > _ABOVE_NOISE:
        return []
    first = field.peak(single, single.argmax()) if bright is None else bright
    least = resolution(otf)
    beside = field.companions(first, least, most)
    settled = [field.settle(first, one, least) if bright is None else (first, one) for one in beside]
    pairs = [field.pair(*places) for places in settled or [(first, (first[0] + least, first[1]))]]
    return sorted(pairs, key=lambda pair: -pair.gain)


def resolution(otf: OTF) -> float:
    """Finest detail the optics pass [arcsec]: one over the highest frequency of a hundredth's contrast."""
    fy, fx = otf.grid.frequencies
    passed = np.abs(np.asarray(otf.value)) > 0.01
    return float(1 / max(np.hypot(fy, fx)[passed].max(), 1 / (otf.grid.plate_scale * max(otf.grid.shape))))


@dataclass(frozen=True)
class _Field:
    """Inner products of a frame, a constant and the template at every pixel.

    On the frame's pixels: ``match`` is data with template, ``power`` template with itself, both with
    the constant projected out; ``light`` is the template's sum over the used pixels.  On the fine
    array: ``used`` and ``data``.  ``seen`` holds what :meth:`beside` has told.
    """

    grid: Grid
    optics: np.ndarray
    used: np.ndarray
    data: np.ndarray
    match: np.ndarray
    power: np.ndarray
    light: np.ndarray
    noise: float
    seen: dict[Place, tuple[np.ndarray, ...]] = field(default_factory=dict)

    @classmethod
    def of(cls, data: Data, otf: OTF, jitter: Locus | None) -> _Field:
        grid, optics = otf.grid, _template(otf, jitter)
        frame_used = np.asarray(data.used, float)
        count = max(frame_used.sum(), 1.0)
        electrons = np.asarray(data.electrons) * frame_used
        level = electrons.sum() / count
        variance = np.asarray((np.clip(electrons, 0, None) + data.offset) / data.weight)
        noise = (variance * frame_used).sum() / count
        used = _embed(frame_used, grid)
        squares = fft.rfft2(fft.irfft2(optics, s=grid.fine_shape) ** 2)
        light = _correlate(used, optics, grid)
        power = _correlate(used, squares, grid) - light**2 / count
        varied = _embed((electrons - level) * frame_used, grid)
        match = _correlate(varied, optics, grid)
        return cls(grid, optics, used, varied, match, power, light, noise)

    def single(self) -> np.ndarray:
        """Chi-squared explained by one star at each place."""
        return _ratio(np.clip(self.match, 0, None) ** 2, self.power * self.noise)

    def beside(self, first: Place):
        """Chi-squared explained by a star at ``first`` and another at each pixel, and both fluxes."""
        if first not in self.seen:
            self.seen[first] = self._beside(first)
        return self.seen[first]

    def _beside(self, first: Place):
        count = max(self.used.sum(), 1.0)
        star = self._star(first) * self.used
        light = star.sum()
        cross = _correlate(star, self.optics, self.grid) - light * self.light / count
        a, u = (star**2).sum() - light**2 / count, (star * self.data).sum()
        b, v = self.power, self.match
        determinant = a * b - cross**2
        sound = determinant > 1e-4 * a * b
        determinant = np.where(sound, determinant, 1.0)
        flux_one, flux_two = (b * u - cross * v) / determinant, (a * v - cross * u) / determinant
        lawful = sound & (flux_one > _FAINTEST * flux_two) & (flux_two > _FAINTEST * flux_one)
        gain = np.where(lawful, flux_one * u + flux_two * v, 0.0) / max(self.noise, 1e-300)
        return gain, flux_one, flux_two

    def companions(self, first: Place, least: float, most: int) -> list[Place]:
        """The best places for a second star, each the best within ``least`` of itself."""
        gain, _, _ = self.beside(first)
        y, x = np.meshgrid(*self._axes(), indexing="ij")
        gain = np.where(np.hypot(x - first[0], y - first[1]) >= least, gain, 0.0)
        reach = max(3, 2 * int(np.ceil(least / 2 / self.grid.plate_scale)) + 1)
        peaks = np.flatnonzero((gain == maximum_filter(gain, size=reach)) & (gain > 0))
        best = peaks[np.argsort(gain.ravel()[peaks])[::-1][:most]]
        return [self.peak(gain, i) for i in best]

    def settle(self, first: Place, second: Place, least: float) -> tuple[Place, Place]:
        """Let the two places change roles until neither moves."""
        for _ in range(6):
            best = self.companions(second, least, 1)
            if not best:
                break
            moved = np.hypot(best[0][0] - first[0], best[0][1] - first[1])
            first, second = second, best[0]
            if moved < 0.1 * self.grid.plate_scale:
                break
        return first, second

    def pair(self, first: Place, second: Place) -> FoundPair:
        """Describe two places as a binary."""
        ny, nx = self.grid.shape
        row, column = (
            int(np.clip(round(v / self.grid.plate_scale + (n - 1) / 2), 0, n - 1))
            for v, n in ((second[1], ny), (second[0], nx))
        )
        gain, flux_one, flux_two = (part[row, column] for part in self.beside(first))
        if min(flux_one, flux_two) <= _FAINTEST * max(flux_one, flux_two):
            flux_one, flux_two = max(flux_one, flux_two), _FAINTEST * max(flux_one, flux_two)
        if flux_two > flux_one:
            first, second, flux_one, flux_two = second, first, flux_two, flux_one
        dx, dy = second[0] - first[0], second[1] - first[1]
        scene = Binary(
            separation=np.hypot(dx, dy),
            theta=np.degrees(np.arctan2(dy, dx)) % 360.0,
            x=(first[0] + second[0]) / 2,
            y=(first[1] + second[1]) / 2,
            flux=flux_one + flux_two,
            contrast=np.clip(flux_one / flux_two, 1.0, 1 / _FAINTEST),
        )
        return FoundPair(scene, float(gain))

    def peak(self, values: np.ndarray, flat) -> Place:
        """Place ``(x, y)`` [arcsec] of a maximum, by a parabola through its neighbours."""
        row, column = np.unravel_index(int(flat), values.shape)
        y, x = self._axes()
        scale = self.grid.plate_scale
        return (
            float(x[column] + scale * _vertex(values[row, :], int(column))),
            float(y[row] + scale * _vertex(values[:, column], int(row))),
        )

    def _axes(self) -> tuple[np.ndarray, np.ndarray]:
        y, x = (offsets(n, self.grid.plate_scale) for n in self.grid.shape)
        return y, x

    def _star(self, place: Place) -> np.ndarray:
        """The template at an offset from the frame's centre, on the fine array."""
        fy, fx = self.grid.frequencies
        cy, cx = self.grid.centre
        ramp = np.exp(-2j * np.pi * fx * (place[0] + cx)) * np.exp(-2j * np.pi * fy * (place[1] + cy))
        return fft.irfft2(self.optics * ramp, s=self.grid.fine_shape)


def _template(otf: OTF, jitter: Locus | None) -> np.ndarray:
    """Transfer function of a star on the frame's pixels."""
    fy, fx = otf.grid.frequencies
    optics = np.asarray(otf.value) * otf.grid.refine**2
    if not otf.pixel_included:
        optics = optics * np.sinc(otf.grid.plate_scale * fx) * np.sinc(otf.grid.plate_scale * fy)
    return optics if jitter is None else optics * np.asarray(jitter.transfer(fx, fy))


def _vertex(values: np.ndarray, i: int) -> float:
    """Offset of a parabola's vertex from sample ``i``, within half a sample."""
    if not 0 < i < len(values) - 1:
        return 0.0
    left, middle, right = values[i - 1 : i + 2]
    bend = left - 2 * middle + right
    if bend >= 0 or min(left, right) <= 0:
        return 0.0
    return float(np.clip(0.5 * (left - right) / bend, -0.5, 0.5))


def _embed(frame: np.ndarray, grid: Grid) -> np.ndarray:
    """A frame on the fine array, zero outside and between its pixels."""
    fine = np.zeros(grid.fine_shape)
    grid.crop(fine)[...] = frame
    return fine


def _correlate(fine: np.ndarray, spectrum: np.ndarray, grid: Grid) -> np.ndarray:
    """Inner product of an array with a pattern centred on each pixel of the frame."""
    return grid.crop(fft.irfft2(fft.rfft2(fine) * np.conj(spectrum), s=grid.fine_shape))


def _ratio(numerator: np.ndarray, denominator: np.ndarray) -> np.ndarray:
    positive = denominator > 0
    return np.where(positive, numerator / np.where(positive, denominator, 1.0), 0.0)
