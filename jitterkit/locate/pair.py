"""Find a star or a pair in a frame, without a given position.

The frame is fitted, by linear least squares, with two star templates and a constant.  One template is
held while the other is tried at every pixel, which takes one Fourier transform; then the two change
roles until neither moves.  Nothing is assumed about angle, distance, contrast or position, and a pattern
as wide as that of TOLIMAN's diffractive pupil is no harder than a compact star.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy import fft
from scipy.ndimage import maximum_filter

from jitterkit.likelihood import Data
from jitterkit.locate.matched_filter import (
    correlate,
    embed,
    ratio,
    resolution,
    spectrum_of_star,
    star_at,
    vertex,
)
from jitterkit.loci.base import Locus
from jitterkit.optics.grid import Grid
from jitterkit.optics.otf import OTF
from jitterkit.scene import Binary, Star

Position = tuple[float, float]

_FAINTEST = 1 / 1000
"""Faintest companion considered, as a share of the brighter star."""

_ABOVE_NOISE = 6.0**2
"""Chi-squared from which a star is one: the best of some ten thousand positions reaches 16 by chance."""


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
    """Find the position and the light of the brightest star.

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
    single = field.single
    if not single.max() > _ABOVE_NOISE:
        return None
    flat = int(single.argmax())
    return Star(*field.peak(single, flat), field.match.ravel()[flat] / field.power.ravel()[flat])


def find_pairs(
    data: Data, otf: OTF, jitter: Locus | None = None, *, bright: Position | None = None, most: int = 4
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
        thousand positions reaches four by chance).  A star that is alone comes with a companion a
        thousand times fainter at the resolution limit, for the fit to dismiss.

    Notes
    -----
    Weights are uniform and positions are pixels: a start for a fit, not an estimate.
    """
    field = _Field.of(data, otf, jitter)
    single = field.single
    if not single.max() > _ABOVE_NOISE:
        return []
    first = field.peak(single, single.argmax()) if bright is None else bright
    least = resolution(otf)
    beside = field.companions(first, least, most)
    settled = [field.settle(first, one, least) if bright is None else (first, one) for one in beside]
    pairs = [field.pair(*positions) for positions in settled or [(first, (first[0] + least, first[1]))]]
    return sorted(pairs, key=lambda pair: -pair.gain)


@dataclass(frozen=True)
class _Field:
    """Inner products of a frame, a constant and the template at every pixel.

    On the frame's pixels: ``match`` is data with template, ``power`` template with itself, both with
    the constant projected out; ``light`` is the template's sum over the used pixels.  On the fine
    array: ``used`` and ``data``.  ``single`` is chi-squared explained by one star at each pixel, and ``seen``
    holds the results of :meth:`beside`.
    """

    grid: Grid
    optics: np.ndarray
    used: np.ndarray
    data: np.ndarray
    match: np.ndarray
    power: np.ndarray
    light: np.ndarray
    single: np.ndarray
    noise: float
    seen: dict[Position, tuple[np.ndarray, ...]] = field(default_factory=dict)

    @classmethod
    def of(cls, data: Data, otf: OTF, jitter: Locus | None) -> _Field:
        grid, optics = otf.grid, spectrum_of_star(otf, jitter)
        frame_used = np.asarray(data.used, float)
        count = max(frame_used.sum(), 1.0)
        electrons = np.asarray(data.electrons) * frame_used
        level = electrons.sum() / count
        variance = np.asarray((np.clip(electrons, 0, None) + data.offset) / data.weight)
        noise = (variance * frame_used).sum() / count
        used = embed(frame_used, grid)
        squares = fft.rfft2(fft.irfft2(optics, s=grid.fine_shape) ** 2)
        light = correlate(used, optics, grid)
        power = correlate(used, squares, grid) - light**2 / count
        varied = embed((electrons - level) * frame_used, grid)
        match = correlate(varied, optics, grid)
        single = ratio(np.clip(match, 0, None) ** 2, power * noise)
        return cls(grid, optics, used, varied, match, power, light, single, noise)

    def beside(self, first: Position):
        """Return chi-squared explained by a star at ``first`` and another at each pixel, and both fluxes."""
        if first in self.seen:
            return self.seen[first]
        count = max(self.used.sum(), 1.0)
        star = star_at(first, self.optics, self.grid) * self.used
        light = star.sum()
        cross = correlate(star, self.optics, self.grid) - light * self.light / count
        a, u = (star**2).sum() - light**2 / count, (star * self.data).sum()
        b, v = self.power, self.match
        determinant = a * b - cross**2
        sound = determinant > 1e-4 * a * b
        determinant = np.where(sound, determinant, 1.0)
        flux_one, flux_two = (b * u - cross * v) / determinant, (a * v - cross * u) / determinant
        valid = sound & (flux_one > _FAINTEST * flux_two) & (flux_two > _FAINTEST * flux_one)
        gain = np.where(valid, flux_one * u + flux_two * v, 0.0) / max(self.noise, 1e-300)
        self.seen[first] = gain, flux_one, flux_two
        return self.seen[first]

    def companions(self, first: Position, least: float, most: int) -> list[Position]:
        """Return the best positions for a second star, each the best within ``least`` of itself."""
        gain, _, _ = self.beside(first)
        y, x = np.meshgrid(*self.grid.axes, indexing="ij")
        gain = np.where(np.hypot(x - first[0], y - first[1]) >= least, gain, 0.0)
        reach = max(3, 2 * int(np.ceil(least / 2 / self.grid.plate_scale)) + 1)
        peaks = np.flatnonzero((gain == maximum_filter(gain, size=reach)) & (gain > 0))
        best = peaks[np.argsort(gain.ravel()[peaks])[::-1][:most]]
        return [self.peak(gain, i) for i in best]

    def settle(self, first: Position, second: Position, least: float) -> tuple[Position, Position]:
        """Let the two positions change roles until neither moves."""
        for _ in range(6):
            best = self.companions(second, least, 1)
            if not best:
                break
            moved = np.hypot(best[0][0] - first[0], best[0][1] - first[1])
            first, second = second, best[0]
            if moved < 0.1 * self.grid.plate_scale:
                break
        return first, second

    def pair(self, first: Position, second: Position) -> FoundPair:
        """Describe two positions as a binary."""
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

    def peak(self, values: np.ndarray, flat) -> Position:
        """Place ``(x, y)`` [arcsec] of a maximum, by a parabola through its neighbours."""
        row, column = np.unravel_index(int(flat), values.shape)
        y, x = self.grid.axes
        scale = self.grid.plate_scale
        return (
            float(x[column] + scale * vertex(values[row, :], int(column))),
            float(y[row] + scale * vertex(values[:, column], int(row))),
        )
