"""Stars that stand alone: found, cut out, and given a noise.

Reach for :func:`find_stars`.  A trailed star is no point source, so stars are found as connected
regions above the sky, not as peaks; what is blended, clipped, saturated or far longer than the rest is
left out, because one blend says more about itself than about the telescope.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
from astropy.stats import SigmaClip
from photutils.background import Background2D, MedianBackground
from photutils.segmentation import SourceCatalog, deblend_sources, detect_sources
from photutils.utils.exceptions import NoDetectionsWarning
from scipy import ndimage

from jitterkit.errors import ErrorCode, UndeterminedError
from jitterkit.frames import Frame
from jitterkit.starfield.moments import Stars, cut_out, stand_alone
from jitterkit.vision import median_filter

_BOX = 64
"""Side of a box of the background [pixels]: some ten trailed stars wide."""

_SMOOTHING = 1.0
"""Sigma of the filter before detection [pixels]; it lowers white noise 3.5 times."""

_THRESHOLD = 1.5
"""Of the smoothed image in units of the unsmoothed noise: five sigma."""

_LEAST_AREA, _LEAST_PEAK = 7, 3
"""Pixels of the smallest region that may be a star, and of the smallest peak within one."""

_CONTRAST = 0.02
"""Share of a region's light that makes a peak of it a star of its own; less splits noise on a trail."""

_LEAST_SNR = 25.0
"""Of the light in a region; fainter stars have moments with errors beyond a tenth and biased by noise."""

_BAD, _SHARP = 6.0, 1.5
"""A bad pixel differs from the median of its neighbours by so many sigma, and by so many times the height of
that median.  So do stars sharper than a FWHM of 2 pixels, and pixels between a core and its dark ring."""

_LONELY = 0.15
"""Third highest of the eight neighbours, as a share of a pixel, up to which it is no star's: a normal star
of FWHM 1.4 pixels has 0.24 or more, a straight track of charge nothing."""

_WING, _NEAR = 0.1, 2.5
"""Peak, as a share of a brighter one, and distance in units of the brighter one's FWHM, within which a region
is a part of the brighter star: a piece of a diffraction ring, a speckle."""

_FLAT, _LEVEL = 4, 3e-4
"""Pixels at the frame's highest counts, to so small a share of them, that show it is a ceiling."""

_LONGER = 2.5
"""Region longer than so many times the median one: a streak, a galaxy."""

_CORE = 3.0, 2.0
"""Radius within which nothing else may lie, in sigmas and in FWHM of the typical star; the smaller counts: a
star with a halo has a large sigma."""

_HALVES = (8, 12, 16, 20, 24, 32, 48)
"""Half widths of a stamp [pixels]: few, so that few programs are compiled."""


_AROUND = np.array([[1, 1, 1], [1, 0, 1], [1, 1, 1]], bool)


def find_stars(frame: Frame, *, half: int | None = None) -> Stars:
    """Find stars that stand alone and cut them out.

    Parameters
    ----------
    frame : Frame
        In electrons, sky included or not; masked pixels (saturated ones are) spoil the star they lie in.
    half : int, optional
        Half width of a stamp [pixels]; from the size of the stars if omitted.

    Returns
    -------
    stars : Stars
        Brightest first.

    Raises
    ------
    UndeterminedError
        If no star stands alone above the noise.

    Notes
    -----
    Background and noise are measured in boxes of 64 pixels.  Pixels that stick out by more than any star
    could (cosmic rays, dead pixels) are treated as masked, and so are those of flat tops: four or more at the
    frame's highest level.  A region within 2.5 FWHM of a star ten times brighter is a part of it.  Left out
    are stars that hang together with another above the noise, lie within three sigma of another star, a bad
    pixel or the edge, or are 2.5 times longer than the median star: satellites, and moving objects.

    *Fails when* the field is so crowded that hardly a star stands alone.
    """
    image, noise, bad = _flattened(frame)
    found = _regions(image, noise, bad, frame.response)
    # pixels at a level that counts do not exceed, if the frame has such a level
    counts = np.where(frame.mask, -np.inf, frame.electrons * frame.response)
    ceiling = (counts >= counts.max() * (1 - _LEVEL)) & (counts.max() > 0)
    ceiling &= ceiling.sum() >= _FLAT
    bad |= ceiling
    good = found.bright & ~found.blended & (found.long < _LONGER * found.typical)
    if half is None:  # seven sigmas of the light above the sky
        half = next((h for h in _HALVES if h >= 7 * found.typical), _HALVES[-1])
    order = np.argsort(-found.flux[good])
    x, y, own = (a[good][order] for a in (found.x, found.y, found.numbers))
    response = np.broadcast_to(frame.response, frame.shape)
    stars = cut_out(image, noise**2, response, bad, found.labels, x, y, own, half)
    alone = stand_alone(stars, found.core)
    if not alone.any():
        full = len(np.unique(found.labels[ceiling & (found.labels > 0)]))
        why = f" ({full} of {len(found.flux)} are saturated: their tops are flat)" if full else ""
        problem = f"No star of the frame stands alone, clear of bad pixels and of the edge{why}"
        raise UndeterminedError(ErrorCode.TOO_FEW_STARS, f"{problem}; choose a less crowded part of it.")
    return stars.chosen(alone)


def _flattened(frame: Frame) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the image without background, its noise, and the bad pixels, which are filled."""
    if frame.mask.all():
        raise UndeterminedError(ErrorCode.NO_DATA, f"{frame.name} has no usable pixel; mask less of it.")
    box = tuple(min(_BOX, n) for n in frame.shape)
    background = Background2D(
        frame.electrons,
        box,
        mask=frame.mask,
        sigma_clip=SigmaClip(3.0),
        bkg_estimator=MedianBackground(),
        exclude_percentile=90.0,
    )
    image = frame.electrons - background.background
    noise = np.maximum(background.background_rms, np.sqrt(frame.read_variance) / frame.response)
    noise = np.maximum(noise, np.finfo(np.float32).tiny)
    smooth = median_filter(np.where(frame.mask, 0.0, image), 3).astype(float)
    reach = _BAD * np.hypot(noise, np.sqrt(np.clip(smooth, 0, None) / frame.response))
    odd = np.abs(image - smooth) > reach + _SHARP * np.clip(smooth, 0, None)
    third = ndimage.rank_filter(np.where(frame.mask, 0.0, image), -3, footprint=_AROUND)
    bad = frame.mask | (odd & ((image < 0) | (third < _LONELY * image)))
    return np.where(bad, smooth, image), noise, bad


@dataclass(frozen=True, eq=False)
class _Regions:
    """Regions above the sky, one a star: labels (ny, nx), and n numbers of each [pixels, electrons]."""

    labels: np.ndarray
    numbers: np.ndarray
    x: np.ndarray
    y: np.ndarray
    long: np.ndarray
    flux: np.ndarray
    bright: np.ndarray
    blended: np.ndarray
    fwhm: np.ndarray

    @property
    def typical(self) -> float:
        """Sigma along the axis of the median star that is bright enough [pixels]."""
        return float(np.median(self.long[self.bright]))

    @property
    def core(self) -> float:
        """Return the radius within which nothing else may lie [pixels]."""
        return min(_CORE[0] * self.typical, _CORE[1] * float(np.median(self.fwhm[self.bright])))


def _regions(image: np.ndarray, noise: np.ndarray, bad: np.ndarray, response) -> _Regions:
    """Find the regions above the sky, split where they hold several stars, and measure them."""
    smooth = ndimage.gaussian_filter(image, _SMOOTHING)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NoDetectionsWarning)
        whole = detect_sources(smooth, _THRESHOLD * noise, _LEAST_AREA)
    if whole is None:
        raise _no_star()
    regions = deblend_sources(smooth, whole, _LEAST_PEAK, contrast=_CONTRAST, progress_bar=False)
    for wing, star in _wings(smooth, regions.data):
        regions.reassign_label(wing, star)
    catalog = SourceCatalog(image, regions, mask=bad)
    x, y = np.asarray(catalog.centroid).T
    long = np.sqrt(np.linalg.eigvalsh(np.asarray(catalog.covariance))[:, -1])
    flux = np.asarray(catalog.segment_flux)
    variance = np.median(noise) ** 2 + np.clip(image, 0, None) / response
    bright = flux > _LEAST_SNR * np.sqrt(ndimage.sum_labels(variance, regions.data, catalog.labels))
    bright &= np.isfinite(x + y + long)
    if not bright.any():
        raise _no_star()
    numbers, labels = np.asarray(catalog.labels), regions.data
    shapes = _blended(image, labels, whole.data), _fwhm(image, labels)
    return _Regions(labels, numbers, x, y, long, flux, bright, *shapes)


def _no_star() -> UndeterminedError:
    problem = "No star rises above the noise of the frame; expose longer or stack frames."
    return UndeterminedError(ErrorCode.NO_STAR, problem)


def _wings(image: np.ndarray, labels: np.ndarray) -> list[tuple[int, int]]:
    """Return pairs of labels: a region that is a part of a brighter star, and that star's."""
    numbers = np.arange(1, labels.max() + 1)
    peaks = ndimage.maximum(image, labels, numbers)
    at = np.array(ndimage.maximum_position(image, labels, numbers))
    fwhm = _fwhm(image, labels)
    brighter = peaks * _WING > peaks[:, None]
    near = np.hypot(*(at[:, None] - at).transpose(2, 0, 1)) < _NEAR * fwhm
    owner = np.argmax(np.where(near & brighter, peaks, 0), axis=1)
    return [(int(i) + 1, int(owner[i]) + 1) for i in np.flatnonzero((near & brighter).any(1))]


def _fwhm(image: np.ndarray, labels: np.ndarray) -> np.ndarray:
    """Return the diameter of a disc as large as the part of each region above half its peak [pixels]."""
    numbers = np.unique(labels[labels > 0])
    level = np.full(labels.max() + 1, np.inf)
    level[numbers] = ndimage.maximum(image, labels, numbers) / 2
    return 2 * np.sqrt(ndimage.sum_labels(image > level[labels], labels, numbers) / np.pi)


def _blended(image: np.ndarray, labels: np.ndarray, whole: np.ndarray) -> np.ndarray:
    """Return which regions are faint parts of a larger one, or share it with another that is not faint."""
    numbers, first = np.unique(labels, return_index=True)
    parents = whole.ravel()[first[numbers > 0]]
    peaks = ndimage.maximum(image, labels, numbers[numbers > 0])
    highest = np.zeros(whole.max() + 1)
    np.maximum.at(highest, parents, peaks)
    faint = peaks < _WING * highest[parents]
    return faint | (np.bincount(parents[~faint], minlength=len(highest))[parents] > 1)
