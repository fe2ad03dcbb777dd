"""The light that the mask of a file hides: of a star under a plane that marks what was detected.

Reach for :func:`hidden_light`.  Programs mark with bits of a mask what is wrong with a pixel, and also what
it shows.  Where nothing says which, all bits mask, and a bit of the second kind leaves nothing of a star but
its wings, from which a fit finds a separation with an error many times larger.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.stats import median_abs_deviation

from jitterkit.errors import ErrorCode, FrameError
from jitterkit.frames.beside import MISSIONS
from jitterkit.frames.frame import RawFrame
from jitterkit.frames.metadata import PRECEDENCE, Metadata
from jitterkit.vision import median_filter

_SIGNIFICANT, _OF_PEAK = 10.0, 0.02
"""Standard deviations above the sky from which a pixel is bright; share of the peak without noise."""

_FEWEST = 9
"""Bright pixels, fewer of which may be hot ones."""

_MOST_LIGHT, _ALL = 0.5, 0.95
"""Shares of the light from which a mask hides a star in part, and of bright pixels from which altogether."""

_DENSER = 3.0
"""Times the share of other pixels that a mask of stars has of bright ones; a random one has it once."""

_WIDE = 0.2
"""Share of bright pixels that a bit of stars has: saturated ones have less."""

_SAMPLES = 1 << 18
"""Pixels of which the sky is measured."""


@dataclass(frozen=True)
class HiddenLight:
    """What a mask hides of the bright pixels of a frame.

    Parameters
    ----------
    light : float
        Share of the light above the sky.
    bright, others : float
        Share of the bright pixels, and of all others.
    hiding : int
        Sum of the bits that a fifth of the bright pixels have, more than of others; 0 without bits.
    left : int
        Sum of the other bits that occur.
    """

    light: float
    bright: float
    others: float
    hiding: int
    left: int

    @property
    def remedy(self) -> str:
        """Return what to do where the bits mark stars and not faults."""
        if not self.hiding:
            return "errors are larger by that"
        return f"if its bits {self.hiding} mark what was detected and no faults, give --bad-bits {self.left}"

    def sentence(self, label: str) -> str:
        """Return the shares in words, of a mask with a name."""
        return (
            f"{self.light:.0%} of the light, {self.bright:.0%} of the bright pixels and {self.others:.1%} of "
            f"the others are masked by {label}"
        )


def hidden_light(
    data: np.ndarray,
    mask: np.ndarray,
    metadata: Metadata,
    quality: np.ndarray | None,
    variance: np.ndarray | None = None,
) -> HiddenLight | None:
    """Find out whether a mask hides a star.

    Parameters
    ----------
    data : (ny, nx) array
        Pixels in any unit; those that are not finite count as sky.
    mask : (ny, nx) bool array
    metadata : Metadata
        Its ``bad_bits`` are those of ``quality`` that mask.
    quality : (ny, nx) int array or None
        Bits of each pixel, -1 where they are not known.
    variance : (ny, nx) array, optional
        It masks where it is not finite and positive.

    Returns
    -------
    hidden : HiddenLight or None
        None if less than half of the light is masked, bright pixels are masked like others, or a mission
        says that its bits are faults.

    Notes
    -----
    A pixel is bright if the median of its 3 x 3 neighbours is, by 10 standard deviations of the sky: hot
    pixels and bad columns are not.  *Fails when* a star is so undersampled that this median removes it, and
    takes a mask of cosmic rays for one of stars where the tracks are wide and no star is as bright.
    """
    known, bits = metadata.bad_bits, int(metadata.value("bad_bits", 0))
    masked = mask if quality is None else mask | (quality & bits != 0)
    if variance is not None:
        masked = masked | ~(np.isfinite(variance) & (variance > 0))
    if not masked.any() or (known is not None and known.source.endswith(MISSIONS)):
        return None
    finite = np.where(np.isfinite(data), data, np.nan)
    few = finite.ravel()[:: max(1, data.size // _SAMPLES)]
    few = few[np.isfinite(few)]
    if not few.size:
        return None
    level, sigma = float(np.median(few)), float(median_abs_deviation(few, scale="normal"))
    above = median_filter(np.nan_to_num(finite, nan=level), 3).astype(np.float64) - level
    bright = above > max(_SIGNIFICANT * sigma, 0.0 if sigma else _OF_PEAK * float(above.max()))
    count = int(bright.sum())
    if count < _FEWEST:
        return None
    light = float(above[bright & masked].sum() / above[bright].sum())
    share = float(masked[bright].mean())
    others = float(masked[~bright].mean()) if count < data.size else 0.0
    if light < _MOST_LIGHT or share < _DENSER * others:
        return None
    flags = np.zeros(data.shape, np.int64) if quality is None else quality
    known_bits = np.where(flags < 0, 0, flags) & bits
    present, hiding = int(np.bitwise_or.reduce(known_bits, axis=None)), 0
    for bit in (1 << n for n in range(32) if present >> n & 1):
        has = (known_bits & bit) != 0
        elsewhere = float(has.sum() - has[bright].sum()) / max(1, int(np.sum(~bright)))
        if float(has[bright].mean()) > max(_WIDE, _DENSER * elsewhere):
            hiding |= bit  # one of stars
    return HiddenLight(light, share, others, hiding, present & ~hiding)


def with_a_star(raw: RawFrame) -> RawFrame:
    """Return a frame, or raise FrameError where the mask of its file hides all stars.

    Parameters
    ----------
    raw : RawFrame
        Complete with what the user and the instrument say of it.

    Returns
    -------
    raw : RawFrame
        The same.

    Raises
    ------
    FrameError
        If bits of which the file does not say what they mean mask all bright pixels; its code is ``NO_STAR``.
    """
    known = raw.metadata.bad_bits
    if raw.quality is None or known is None or known.precedence < PRECEDENCE.index("header"):
        return raw
    found = hidden_light(raw.data, raw.mask, raw.metadata, raw.quality)
    if found is None or found.bright < _ALL or not found.hiding:
        return raw
    label = known.source.partition(", convention")[0]
    problem, remedy = f"no star is left: {found.sentence(label)}", found.remedy
    remedy = f"{remedy}, else --bad-bits {found.left + found.hiding}"
    raise FrameError(ErrorCode.NO_STAR, raw.path or Path(raw.name), problem, remedy)
