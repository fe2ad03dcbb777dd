"""Ways from frames to their separations, from a glance at each to the whole of its posterior.

Reach for :func:`separations`.

* ``score``: the scoring step of a frame that repeats another, as ``jitterkit estimate`` takes it; nothing is
  fitted.
* ``mtf``: the blur by the ratio of transfer functions, held; all else is fitted.
* ``refit``: everything is fitted, as ``jitterkit process`` does it.
* ``joint``: the frames together, as ``jitterkit sequence`` does it; they have to share the pair's direction.
* ``sampling``: the mean of draws from the posterior; needs the extra ``sampling``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import replace

import jax
import numpy as np

from jitterkit.batch import Processor
from jitterkit.errors import JitterkitError
from jitterkit.frames import Frame
from jitterkit.joint import Exposure, Looker, refit_sequence
from jitterkit.likelihood import Data
from jitterkit.loci import Mvn
from jitterkit.refit import FitResult, fit_frame, sample_posterior

__all__ = ["separations"]

_DRAWS, _CHAINS, _WARMUP = 150, 1, 60
"""Fewer than serve for the error itself: what they leave of the mean is what is measured."""


def separations(method: str, processor: Processor, frames: Iterable[Frame]) -> np.ndarray:
    """Separations of calibrated frames of one instrument.

    Parameters
    ----------
    method : str
        One of :data:`jitterkit.trade.settings.METHODS`.
    processor : Processor
    frames : iterable of Frame

    Returns
    -------
    separations : (n, 2) array
        With the error that is stated, arcsec: NaN where none is; of frames together that of one of so many.

    Raises
    ------
    JitterkitError
        If one cannot be had.
    """
    if method == "joint":
        return _joint(processor, list(frames))
    one = _OF_ONE[method]
    return np.array([one(processor, frame) for frame in frames])


def _scored(processor: Processor, frame: Frame) -> tuple[float, float]:
    estimated = processor.estimate(frame)
    if isinstance(estimated, FitResult):
        raise JitterkitError(estimated.message)
    return float(estimated.parameters.binary.separation), math.nan


def _given_the_blur(processor: Processor, frame: Frame) -> tuple[float, float]:
    estimated = replace(processor, kernel="mtf").estimate(frame)
    if isinstance(estimated, FitResult):
        raise JitterkitError(estimated.message)
    start = estimated.parameters.with_locus(Mvn.near(estimated.estimate.moments))
    options = replace(processor.options, hold=(*processor.options.hold, *Mvn.names))
    return _told(fit_frame(estimated.data, processor.optics(frame), start, estimated.otf, options))


def _refitted(processor: Processor, frame: Frame) -> tuple[float, float]:
    return _told(processor.fit(frame).result)


def _drawn(processor: Processor, frame: Frame) -> tuple[float, float]:
    fit = processor.fit(frame).result
    _told(fit)
    data = Data.of(frame, censored=processor.censored).clear(fit.image)
    posterior = sample_posterior(
        data,
        processor.optics(frame),
        fit,
        processor.options.priors,
        draws=_DRAWS,
        chains=_CHAINS,
        warmup=_WARMUP,
        key=jax.random.key(0),
    )
    drawn = posterior.draws[:, posterior.slot("separation")]
    return float(drawn.mean()), float(drawn.std())


_OF_ONE: dict[str, Callable[[Processor, Frame], tuple[float, float]]] = {
    "score": _scored,
    "mtf": _given_the_blur,
    "refit": _refitted,
    "sampling": _drawn,
}


def _joint(processor: Processor, frames: list[Frame]) -> np.ndarray:
    exposures = [Exposure(frame.name, place * _step(frame), frame) for place, frame in enumerate(frames)]
    looker = Looker(processor.optics(frames[0]), processor.locus, tuple(processor.options.hold))
    fit = refit_sequence(exposures, looker)
    error = fit.separation[1] * math.sqrt(len(frames))
    return np.array([(one.separation, error) for one in fit.frames()])


def _step(frame: Frame) -> float:
    """From the middle of an exposure to that of the next, s: they follow each other without a pause."""
    return frame.exposure or 1.0


def _told(fit: FitResult) -> tuple[float, float]:
    if fit.parameters is None or not fit.status.usable:
        raise JitterkitError(fit.message)
    return fit.of_scene("separation"), fit.error("separation")
