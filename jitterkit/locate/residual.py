"""Stars and single pixels that stand out of what a model leaves of a frame.

A star is distinguished from a pixel by how much of the pixel it explains: all of it, if it is one, and
otherwise no more than the share of its own light in one pixel.  The two are parted where their ratio is,
halfway.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import fft, ndimage, special

from jitterkit.likelihood.data import Data, mean_counts
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
from jitterkit.optics.otf import OTF
from jitterkit.scene import FurtherStars, Scene, Star

SURE = 6.0
"""Standard errors of its flux from which a further star is one: the best of some ten thousand positions
reaches 4 by chance."""

_MISSED, _POSITIONS = 2.0, 0.9
"""Standard errors more that a star shines by which is missed once in fifty times, and the share of the places
in a frame where it would be found."""

_DARK = 0.35
"""Significance of the darkest spot as a share of the brightest's: 0.1 to 0.2 were left by third stars that a
fit of a pair lacked, 0.5 to 1 by 15 nm of an aberration."""

_AT_ONCE, _MOST = 0.3, 50
"""Share of the most significant star from which others are taken beside it, and how many: what is fainter may
be its pattern, where its position is off."""

_NONE = float(np.log(2))
"""Electrons a pixel that a median of none may stand for: half of such pixels have one or more."""

_FALSE = 1e-3
"""Chance that noise makes a pixel of a frame stand out."""

_JOINED, _LARGEST = 3.0, 4
"""Sigmas of the neighbours that belong to a pixel that stands out, and how many together are still alone."""

_HALF = 0.5
"""Share of a pixel's chi-squared: a star between pixels, sharper than they are, explains more."""

_SEEN = 0.5
"""Share of the pixels about one that must be used for it to be alone."""

_OF_LIGHT = 0.3
"""Share of the stars' light on a pixel, or beside it, that it must be off by: a model of the optics may be
wrong by less."""

_FEW = 0.002
"""Share of the pixels above which it is the model that is wrong."""


def most_outliers(used: np.ndarray) -> float:
    """Return how many outliers a frame may have, by which of its pixels (ny, nx) are used."""
    return max(_FEW * np.count_nonzero(used), _LARGEST)


@dataclass(frozen=True)
class Residual:
    """Hold the residual of a frame from its expected image.

    Attributes
    ----------
    data : Data
    image : (ny, nx) array
        Expected electrons.
    otf : OTF
    jitter : Locus, optional
    """

    data: Data
    image: np.ndarray
    otf: OTF
    jitter: Locus | None = None

    @classmethod
    def of_dark(cls, data: Data, otf: OTF) -> Residual:
        """Take the median of a frame for its expected image, so that all of its stars are left."""
        level = np.median(np.asarray(data.electrons)[np.asarray(data.used)])
        return cls(data, np.full(data.used.shape, max(level, _NONE)), otf)

    @cached_property
    def sigmas(self) -> np.ndarray:
        """Return ``(data - image)/sigma`` (ny, nx); zero where a pixel does not count."""
        return (np.asarray(self.data.electrons) - self.image) * np.sqrt(self._weight)

    def star(self) -> tuple[Star, float]:
        """Find the star that would explain most of the residual, and how much chi-squared that is.

        Next to a star of the image it explains less in truth: the fit of that star has explained a part.
        """
        match, power = self._products
        gain = ratio(np.clip(match, 0, None) ** 2, power)
        row, column = np.unravel_index(int(gain.argmax()), gain.shape)
        y, x = self.otf.grid.axes
        flux = match[row, column] / max(power[row, column], np.finfo(float).tiny)
        return Star(x[column], y[row], flux), float(gain[row, column])

    def further_stars(self, scene: Scene | None = None, apart: float = 1.0) -> FurtherStars | None:
        """Find stars of six standard errors of their flux, one after the other.

        Parameters
        ----------
        scene : Scene, optional
            Stars that are known.
        apart : float
            Distance from these and from each other, in units of the resolution.

        Returns
        -------
        stars : FurtherStars or None
            None if there is none.  What a star explains is taken away before the next is looked for.
        """
        found: list[tuple[float, float, float]] = []
        left, least = self, SURE
        while len(found) < _MOST and (star := left._outstanding(scene, least, apart)) is not None:
            significance, x, y, flux = star
            found.append((x, y, flux))
            scene = Star(x, y, flux) if scene is None else scene.joined(FurtherStars(x, y, flux))
            left = left.without(Star(x, y, flux))
            least = max(least, _AT_ONCE * significance)
        return FurtherStars(*zip(*found, strict=True)) if found else None

    def without(self, star: Star) -> Residual:
        """Return what is left when the image has one more star."""
        position = float(star.x), float(star.y)
        image = self.otf.grid.crop(star_at(position, self._spectrum, self.otf.grid))
        return replace(self, image=self.image + float(star.flux) * image)

    def _outstanding(self, scene: Scene | None, least: float, apart: float):
        """Significance, position [arcsec] and flux of the star that stands out most, if by so many errors."""
        errors = np.where(self._clear_of(scene, apart), self._significance, 0.0)
        errors = np.where(errors**2 > self._of_pixels, errors, 0.0)
        row, column = np.unravel_index(int(errors.argmax()), errors.shape)
        if not errors[row, column] > least:
            return None
        (match, power), (y, x), scale = self._products, self.otf.grid.axes, self.otf.grid.plate_scale
        return (
            float(errors[row, column]),
            float(x[column] + scale * vertex(errors[row, :], int(column))),
            float(y[row] + scale * vertex(errors[:, column], int(row))),
            float(match[row, column] / power[row, column]),
        )

    def hidden(self, scene: Scene) -> float:
        """Return the light [electron] from which a further star would have been found.

        Parameters
        ----------
        scene : Scene
            Stars that are known.

        Returns
        -------
        flux : float
            Of a star that is found with a chance of 98 % or better in nine tenths of the frame, further than
            the resolution from all known ones.  It is eight standard errors, with everything else known: six
            are needed.  NaN of a frame that has no such place.
        """
        _, power = self._products  # of a star with itself: the information on its flux
        errors = 1 / np.sqrt(power[self._clear_of(scene) & np.asarray(self.data.used)])
        return float((SURE + _MISSED) * np.quantile(errors, _POSITIONS)) if errors.size else float("nan")

    def is_all_stars(self, scene: Scene) -> bool:
        """Return whether no spots are dark as others are bright, as they are where the model is wrong.

        A star that the model lacks is bright; what a fit makes up for it is darker by a few, and spread.
        """
        errors = np.where(self._clear_of(scene), self._significance, 0.0)
        dark = np.where(errors**2 > self._of_pixels, -errors, 0.0)
        return bool(dark.max() <= max(SURE, _DARK * errors.max()))

    def outliers(self, background, *, surely: bool = False) -> np.ndarray:
        """Find single pixels that do not belong to the image: cosmic rays, hot and dead pixels.

        Parameters
        ----------
        background : (ny, nx) array or float
            Electrons of the image that are not the stars' light.
        surely : bool
            Whether the image may lack stars, whose blur is not known: a star must explain less than half of
            an outlier, which must be bright.

        Returns
        -------
        outliers : (ny, nx) bool array
            Nothing where there are so many that the model is to blame.
        """
        used, sigmas = np.asarray(self.data.used), self.sigmas
        none, chance = np.zeros_like(used), _FALSE / max(used.sum(), 1)
        if not np.any(np.abs(sigmas) > special.ndtri(1 - chance)):  # no Poisson law has shorter tails above
            return none
        around = ndimage.uniform_filter(used.astype(float), size=3, mode="constant")
        seeds = used & (around > _SEEN) & (self._chance < chance)
        light = ndimage.maximum_filter(self.image - np.asarray(background), size=3)
        seeds &= np.abs(np.asarray(self.data.electrons) - self.image) > _OF_LIGHT * light
        # a star there explains as much of a pixel's chi-squared as it has in that one pixel
        step = self.otf.grid.refine
        alone = fft.irfft2(self._spectrum, s=self.otf.grid.fine_shape)[::step, ::step]
        share = min(np.sqrt(alone[0, 0] ** 2 / (alone**2).sum()), _HALF if surely else 1.0)
        found = none.copy()
        for sign in (1.0,) if surely else (1.0, -1.0):
            groups, _ = ndimage.label(sign * sigmas > _JOINED, structure=np.ones((3, 3)))
            for group in np.unique(groups[seeds & (groups > 0)]):
                own = groups == group
                star = np.max(sign * self._significance, where=ndimage.binary_dilation(own), initial=0.0)
                if own.sum() <= _LARGEST and star**2 < share * (sigmas[own] ** 2).sum():
                    found |= own
        return found if found.sum() <= most_outliers(used) else none

    @cached_property
    def _spectrum(self) -> np.ndarray:
        return spectrum_of_star(self.otf, self.jitter)

    @cached_property
    def _counts(self) -> np.ndarray:
        return mean_counts(np.maximum(self.image, 0.0), self.data)

    @cached_property
    def _weight(self) -> np.ndarray:
        return np.where(self.data.used, np.asarray(self.data.weight) / self._counts, 0.0)

    @cached_property
    def _chance(self) -> np.ndarray:
        """Return the chance of a reading so far from its mean, on its side: Poisson, read noise included."""
        weight = np.asarray(self.data.weight)
        mean = weight * self._counts
        count = np.maximum(weight * (np.asarray(self.data.electrons) + np.asarray(self.data.offset)), 0.0)
        above = special.gammainc(np.maximum(count, np.finfo(float).tiny), mean)
        return np.where(count > mean, above, special.gammaincc(count + 1, mean))

    @cached_property
    def _products(self) -> tuple[np.ndarray, np.ndarray]:
        """Return weighted products of the residual with a star at each pixel, and of the star with itself."""
        grid = self.otf.grid
        left = (np.asarray(self.data.electrons) - self.image) * self._weight
        squares = fft.rfft2(fft.irfft2(self._spectrum, s=grid.fine_shape) ** 2)
        power = correlate(embed(self._weight, grid), squares, grid)
        match = correlate(embed(left, grid), self._spectrum, grid)
        return match, np.maximum(power, np.finfo(float).tiny)

    @cached_property
    def _significance(self) -> np.ndarray:
        """Return the flux of a star at each pixel, in its standard errors."""
        match, power = self._products
        return match / np.sqrt(power)

    @cached_property
    def _of_pixels(self) -> np.ndarray:
        """Return chi-squared of the most outstanding pixel within one of each."""
        return ndimage.maximum_filter(self.sigmas**2, size=3)

    def _clear_of(self, scene: Scene | None, apart: float = 1.0) -> np.ndarray | bool:
        """Return the pixels to which no star of a scene is nearer than so many resolutions."""
        if scene is None:
            return True
        y, x = self.otf.grid.axes
        positions = zip(*map(np.asarray, scene.sources()[:2]), strict=True)
        distances = [np.hypot(x - xs, y[:, None] - ys) for xs, ys in positions]
        return np.min(distances, axis=0) > apart * resolution(self.otf)
