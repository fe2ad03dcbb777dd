"""What a file says of its pixels: the unit they are stored in, and their variance.

:func:`in_counts` converts to ADU or electrons; :func:`with_read_variance` takes the read variance from that
of the file.  The variance of a pipeline holds the photon noise of the data, estimated from the noisy data
themselves. Used as it is, pixels that are low by chance count for more, and fluxes and separations are biased
(Neyman weights).  The likelihood adds the photon noise of the model, so that only the rest is wanted here.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from jitterkit.errors import ErrorCode, FrameError
from jitterkit.frames.frame import RawFrame
from jitterkit.frames.metadata import PRECEDENCE, Metadata, Sourced
from jitterkit.frames.units import COUNTS, RATES
from jitterkit.vision import median_filter

GUESSED = ("preset", "assumed")
"""How the sources begin of numbers that nobody said of this frame or camera."""

NORMALISED = (
    "the pixels are floats from 0 to 1, as Siril and PixInsight write, neither ADU nor electrons: errors and "
    "chi-squared are not valid; use the frame before it was normalised"
)
"""Remark on a frame of which :func:`is_normalised` is true."""


def in_counts(raw: RawFrame) -> RawFrame:
    """Return a frame whose pixels are counts.

    Parameters
    ----------
    raw : RawFrame
        In ADU or electrons, or in either per second.

    Returns
    -------
    counts : RawFrame
        Rates are multiplied by the exposure; of rates in ADU the bias is taken to be subtracted.

    Raises
    ------
    FrameError
        If the unit is another (code ``unknown_unit``), or a rate has no exposure.
    """
    unit, known = raw.unit, raw.metadata.unit
    if unit in COUNTS or known is None:
        return raw
    where = raw.path or raw.name
    if unit not in RATES:
        problem = f"has pixels in {unit} ({known.source}), which is neither ADU nor electrons"
        remedy = "convert them to ADU or electrons, or correct the unit"
        raise FrameError(ErrorCode.UNKNOWN_UNIT, where, problem, remedy)
    exposure = raw.metadata.exposure
    if exposure is None or exposure.value == 0 or exposure.source.startswith(GUESSED):
        problem = f"has pixels in {unit} ({known.source}), and its exposure is not known"
        raise FrameError(ErrorCode.MISSING_VALUE, where, problem, "give --exposure, in s")
    counted = Sourced(unit.removesuffix("/s"), "", f"{known.source} in {unit} times {exposure.source}")
    metadata = raw.metadata.override(counted.source, unit=counted)
    bias = metadata.bias
    if counted.value == "adu" and (bias is None or bias.precedence >= PRECEDENCE.index("instrument file")):
        metadata = metadata.override("argument, as the pixels are a rate", bias=0.0)
    variance = None if raw.variance is None else raw.variance * exposure.value**2
    return replace(raw, data=raw.data * exposure.value, variance=variance, metadata=metadata)


def is_normalised(raw: RawFrame) -> bool:
    """Return whether pixels that count as ADU are fractions of full scale: floats from 0 to 1.

    Parameters
    ----------
    raw : RawFrame
        The noise of one whose bias was subtracted goes below 0.
    """
    good = raw.data[~raw.mask]
    if raw.unit != "adu" or not good.size or not 0 < good.max() <= 1 or good.min() < -good.max() / 2:
        return False
    return not np.array_equal(good, np.rint(good))


_INCLUDED = 0.5
"""Share of the photon noise by which a variance has to rise with the light to be taken to include it."""

_WRONG = 3.0
"""Share beyond which the gain or a unit is wrong: of a ramp of two groups, the least efficient, it is two."""

_CONTRAST = 3.0
"""Sigmas between bright and median pixels from which a frame shows how its variance rises."""

_OUTLIER = 5.0
"""Standard deviations above its neighbours from which a pixel keeps its own value."""

_FLAT = 0.1
"""Share of the photon noise that a division by a flat adds or takes away, which is no pixel's own."""


_UNLIKE = 3.0
"""Ratio of the stated noise to the scatter from which one is wrong: drizzling smooths by less."""

_TILE, _MOST_TILES, _ENOUGH, _FEW_TILES = 16, 256, 0.5, 0.1
"""Side and number of the tiles in which both are measured, share of good pixels that a tile needs, and
share of the tiles that scatter less than the middle of those used."""


def with_read_variance(raw: RawFrame, metadata: Metadata) -> RawFrame:
    """Replace the variance of a frame by the part that its light does not make.

    Parameters
    ----------
    raw : RawFrame
        In counts, with ``variance``.
    metadata : Metadata
        What is known about it, a detector's numbers included.

    Returns
    -------
    raw : RawFrame
        Its ``variance`` is that of the counts without photon noise [e-²], and its metadata name it as the
        read noise; None where it is not used, with a warning.  The gain follows from the variance where
        nobody said it.

    Notes
    -----
    How the variance rises with the light shows whether it includes the photon noise.  A weight map often does
    not, and is used as it is.  Otherwise ``max(signal, 0)`` is subtracted, and each pixel takes the median of
    25 neighbours within five pixels, itself excluded, so that its own noise has no part in its weight.  A
    pixel far above its neighbours, such as a hot one, keeps its own value.

    *Assumes* that the bias is subtracted where no header says it.  *Fails when* the rest of the variance
    changes within five pixels by less than its scatter.
    """
    said, source, good = metadata.read_noise, raw.variance_source, ~raw.mask
    variance = np.asarray(raw.variance)
    if said is not None and said.precedence <= PRECEDENCE.index("sidecar"):
        return _without(raw, f"{source} is not used, as the read noise is given ({said.source})")
    if not good.any():
        return replace(raw, variance=None)
    signal, gain = raw.data, Sourced(1.0, "", "header")
    if raw.unit != "electron":
        bias, gain = metadata.bias, metadata.gain or Sourced(1.0, "e-/ADU", "assumed")
        if bias is None or bias.source.startswith(GUESSED):
            bias = Sourced(0.0, "ADU", "argument, as pixels with a variance are calibrated")
            raw = replace(raw, metadata=raw.metadata.override(bias.source, bias=bias))
        signal = raw.data - bias.value
    rise = _rise(signal, variance, good)
    if rise is not None and rise > 0 and gain.source.startswith(GUESSED):
        gain = Sourced(1 / rise, "e-/ADU", f"{source}, by its rise with the pixels")
        raw = replace(raw, metadata=raw.metadata.override(gain.source, gain=gain))
    share = 1.0 if rise is None else rise * gain.value
    if share > _WRONG:
        problem = f"{source} rises {share:.3g} times as fast with the light as photon noise"
        return _without(raw, f"{problem} and is not used: check the gain and the units")
    variance = variance * gain.value**2
    if share >= _INCLUDED:
        photons = min(share, 1.0) * np.maximum(signal, 0.0) * gain.value
        variance, source = _smoothed(variance, photons, good), f"{source} less photon noise"
    level = float(np.median(variance[good]))
    if level <= 0:
        problem = f"{raw.variance_source} is smaller than the photon noise of the pixels"
        return _without(raw, f"{problem} and is not used: check the gain and the units")
    denied = _contradiction(signal * gain.value, variance, good)
    if denied is not None:
        stated = f"{raw.variance_source} says a noise of {denied[0]:.3g} e-"
        problem = f"{stated}, and pixels scatter by {denied[1]:.3g} e-"
        if raw.weighted:
            return _without(raw, f"{problem}: it is no inverse variance, and only its zeros are used")
        raw = replace(raw, metadata=raw.metadata.warn(f"{problem}: check its unit and the gain"))
    known = Sourced(level**0.5, "e-", source)
    return replace(raw, variance=variance, metadata=raw.metadata.override(source, read_noise=known))


def _contradiction(
    electrons: np.ndarray, variance: np.ndarray, good: np.ndarray
) -> tuple[float, float] | None:
    """Return the noise [e-] of a read variance and the light, and the scatter of pixels that denies it.

    Both are of tiles where pixels scatter little: stars only add to it.  From above the scatter is that of
    pixels two apart, which interpolation between neighbours changes little, and from below that of second
    differences along x and y, in which images of stars hardly show.
    """
    ny, nx = (n // _TILE for n in electrons.shape)
    every = max(1, math.ceil(math.sqrt(ny * nx / _MOST_TILES)))

    def tiles(image: np.ndarray) -> np.ndarray:
        blocks = image[: ny * _TILE, : nx * _TILE].reshape(ny, _TILE, nx, _TILE)[::every, :, ::every]
        return blocks.swapaxes(1, 2).reshape(-1, _TILE, _TILE)

    values, known = tiles(electrons), tiles(good)
    enough = known.mean(axis=(1, 2)) > _ENOUGH
    if not enough.any():
        return None
    values, known = values[enough], known[enough]
    values, variances = (np.where(known, one, np.nan) for one in (values, tiles(variance)[enough]))
    light, own = (np.nanmedian(one, axis=(1, 2)) for one in (values, variances))
    noise = np.sqrt(own + np.maximum(light, 0.0))
    stated, scatter = _of_quiet_tiles(noise, (values[:, :, 2:] - values[:, :, :-2]) / math.sqrt(2))
    if stated > _UNLIKE * scatter:
        return stated, scatter
    stated, scatter = _of_quiet_tiles(noise, np.diff(np.diff(values, 2, axis=1), 2, axis=2) / 6)
    return (stated, scatter) if scatter > _UNLIKE * stated else None


def _of_quiet_tiles(noise: np.ndarray, steps: np.ndarray) -> tuple[float, float]:
    """Return the noise and the spread of steps of tiles where these scatter little, but are not constant."""
    away = np.abs(steps - np.nanmedian(steps, axis=(1, 2), keepdims=True))
    # of numbers that are rounded coarsely the median may be zero
    spread = np.maximum(1.4826 * np.nanmedian(away, axis=(1, 2)), 0.5 * np.nanmean(away, axis=(1, 2)))
    order = [tile for tile in np.argsort(spread) if spread[tile] > 0]
    if not order:
        return 0.0, 0.0
    quiet = order[: 1 + 2 * int(_FEW_TILES * len(order))]
    return float(np.median(noise[quiet])), float(np.median(spread[quiet]))


def _without(raw: RawFrame, warning: str) -> RawFrame:
    return replace(raw, variance=None, metadata=raw.metadata.warn(warning))


def _rise(signal: np.ndarray, variance: np.ndarray, good: np.ndarray) -> float | None:
    """Return the slope of the variance with the signal; None where the frame shows too little light."""
    level = float(np.median(signal[good]))
    smooth = median_filter(np.where(good, signal, level), 3)
    order = smooth[good]
    low, high = (good & mask for mask in (smooth <= level, smooth >= np.quantile(order, 0.98)))
    if not (low.any() and high.any()):
        return None
    contrast = float(np.median(signal[high]) - np.median(signal[low]))
    scatter = 1.4826 * float(np.median(np.abs(signal - smooth)[good]))
    if contrast < _CONTRAST * min(scatter, float(np.median(variance[good])) ** 0.5):
        return None
    return float(np.median(variance[high]) - np.median(variance[low])) / contrast


def _smoothed(variance: np.ndarray, photons: np.ndarray, good: np.ndarray) -> np.ndarray:
    """The rest without photon noise: the median of neighbours, or a pixel's own where it lies far above."""
    rest = variance - photons
    level = float(np.median(rest[good]))
    smooth = _of_neighbours(np.where(good, rest, level))
    smooth = np.where(smooth > 0, smooth, max(level, 0.0))
    relative = np.sqrt(np.maximum(variance, 0.0) / float(np.median(variance[good])))
    away = np.abs(rest - smooth)[good] / relative[good]
    scatter = 1.4826 * float(np.median(away))
    own = good & (rest - smooth > _OUTLIER * scatter * relative + _FLAT * photons)
    return np.where(own, rest, smooth)


def _of_neighbours(image: np.ndarray) -> np.ndarray:
    """Return for each pixel the median of 25 near it: of every second row and column, without its own."""
    ny, nx = image.shape
    padded = np.pad(image, ((0, ny % 2), (0, nx % 2)), mode="edge")
    found = np.empty_like(padded)
    for j in (0, 1):
        for i in (0, 1):
            found[j::2, i::2] = median_filter(padded[1 - j :: 2, 1 - i :: 2], 5)
    return found[:ny, :nx]
