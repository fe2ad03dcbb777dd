"""Ways from frames to their separations, from a glance at each to the whole of its posterior.

Reach for :func:`separations`, and for :class:`Fitting` to have them as a long run does, with the time of
each.

* ``score``: the fit of a normal with which ``jitterkit estimate`` begins.
* ``mtf``: the blur by the ratio of transfer functions, held as if it were known; all else is fitted.
* ``refit``: everything is fitted, as ``jitterkit process`` does it.
* ``joint``: the frames together, as ``jitterkit sequence`` does it, to its own tolerance; they have to share
  the pair's direction.
* ``sampling``: the mean of draws from the posterior; needs the extra ``sampling``.
"""

from __future__ import annotations

import math
import time
import zlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import jax
import numpy as np

from jitterkit.batch import FrameProcessor
from jitterkit.batch.records import SceneEstimate
from jitterkit.errors import ErrorCode, JitterkitError
from jitterkit.frames import Frame, RawFrame
from jitterkit.joint import Exposure, FrameFitter, SequenceOptions, refit_sequence
from jitterkit.likelihood import Data
from jitterkit.loci import Mvn
from jitterkit.refit import FitResult, fit_frame, sample_posterior

_DRAWS, _CHAINS, _WARMUP = 150, 1, 60
"""Fewer than serve for the error itself: what they leave of the mean is what is measured."""


def separations(method: str, processor: FrameProcessor, frames: Iterable[Frame]) -> np.ndarray:
    """Return the separations of calibrated frames of one instrument.

    Parameters
    ----------
    method : str
        One of :data:`jitterkit.trade.settings.METHODS`.
    processor : FrameProcessor
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


def _scored(processor: FrameProcessor, frame: Frame) -> tuple[float, float]:
    return float(_estimated(processor, frame).parameters.binary.separation), math.nan


def _given_the_blur(processor: FrameProcessor, frame: Frame) -> tuple[float, float]:
    estimated = _estimated(replace(processor, kernel="mtf"), frame)
    blur = estimated.estimate.locus
    start = estimated.parameters.with_locus(Mvn.near(estimated.estimate.moments) if blur is None else blur)
    held = (*processor.options.hold, *start.locus.names)
    options = replace(processor.options, hold=held, priors=processor.priors)
    return _separation(fit_frame(estimated.data, processor.optics(frame), start, estimated.otf, options))


def _refitted(processor: FrameProcessor, frame: Frame) -> tuple[float, float]:
    return _separation(processor.complete(frame).result)


def _drawn(processor: FrameProcessor, frame: Frame) -> tuple[float, float]:
    fitted = processor.complete(frame)
    _separation(fitted.result)
    frame = frame if fitted.frame is None else fitted.frame
    data = Data.of(frame, censored=processor.censored).clear(fitted.result.image)
    known = data, processor.optics(frame), fitted.result, processor.options_of(frame).priors
    key = jax.random.key(zlib.crc32(np.asarray(frame.electrons).tobytes()))  # another chance in each frame
    posterior = sample_posterior(*known, draws=_DRAWS, chains=_CHAINS, warmup=_WARMUP, key=key)
    return posterior.mean("separation"), posterior.error("separation")


_OF_ONE: dict[str, Callable[[FrameProcessor, Frame], tuple[float, float]]] = {
    "score": _scored,
    "mtf": _given_the_blur,
    "refit": _refitted,
    "sampling": _drawn,
}


def _joint(processor: FrameProcessor, frames: list[Frame]) -> np.ndarray:
    """Return what each says, all that they share known by all of them, with the joint error."""
    exposures = [
        Exposure(frame.name, index * (frame.exposure or 1.0), frame) for index, frame in enumerate(frames)
    ]
    hold, optics = tuple(processor.options.hold), processor.optics(frames[0])
    locus = "mvn" if processor.locus == "auto" else processor.locus  # to which it comes where little is seen
    priors, light = processor.options.priors, processor.known_light
    fitter = FrameFitter(optics, locus, hold, priors, censored=processor.censored, known_light=light)
    fit = refit_sequence(exposures, fitter, SequenceOptions(rolling=False))
    together = int(fit.combined.kept.sum())
    if together < len(frames):
        problem = f"Only {together} of {len(frames)} frames can be fitted together"
        remedy = "give frames of one pair and telescope, or fit each by itself"
        raise JitterkitError(ErrorCode.WRONG_INSTRUMENT, f"{problem}; {remedy}.")
    error = fit.separation[1] * math.sqrt(len(frames))
    return np.array([(one.separation, error) for one in fit.frames()])


def _estimated(processor: FrameProcessor, frame: Frame) -> SceneEstimate:
    estimated = processor.estimate(frame)
    if isinstance(estimated, FitResult):
        raise JitterkitError(ErrorCode(estimated.reason), estimated.message)
    return estimated


def _separation(fit: FitResult) -> tuple[float, float]:
    if fit.parameters is None or not fit.status.usable:
        raise JitterkitError(ErrorCode(fit.reason), fit.message)
    return fit.of_scene("separation"), fit.error("separation")


FRAMES_PER_ANCHOR = 1024
"""Frames that share what one of them shows of the optics."""


@dataclass(frozen=True)
class Fitting:
    """A processor to be timed, and the share of a frame in what was done beforehand.

    Attributes
    ----------
    processor : FrameProcessor
    share : float
        s.
    method : str
        Of :mod:`jitterkit.trade.methods`.
    """

    processor: FrameProcessor
    share: float = 0.0
    method: str = "refit"

    @classmethod
    def anchored(
        cls, processor: FrameProcessor, raw: RawFrame, frames: int = FRAMES_PER_ANCHOR, method: str = "refit"
    ) -> Fitting:
        """With the optics about what a first frame of several shows."""
        frame = processor.calibrate(raw)
        processor.with_warm_starts({}).warm_start(frame)  # compiles
        began = time.perf_counter()
        warm = processor.with_warm_starts({}).warm_start(frame)
        share = (time.perf_counter() - began) / min(max(frames, 1), FRAMES_PER_ANCHOR)
        known = {} if warm is None else {processor.grid(frame): warm}
        return cls(processor.with_warm_starts(known), share, method)

    def separations(self, frames: Iterable[Frame]) -> np.ndarray:
        """Return the separations of calibrated frames with their errors (n, 2), arcsec.

        Raises
        ------
        JitterkitError
            If one cannot be had.
        """
        return separations(self.method, self.processor, frames)

    def timed(self, raws: Sequence[RawFrame]) -> tuple[np.ndarray, float]:
        """Return the separations of raw frames, and the seconds a frame, calibration included.

        The median, but of frames together their mean.
        """
        self._of_raw(raws)  # compiles what there is to
        if self.method == "joint":
            together, whole = self._clocked(raws)
            return together, whole / len(raws)
        found, spent = zip(*(self._clocked((raw,)) for raw in raws), strict=True)
        return np.concatenate(found), float(np.median(spent)) + self.share

    def _clocked(self, raws: Sequence[RawFrame]) -> tuple[np.ndarray, float]:
        began = time.perf_counter()
        return self._of_raw(raws), time.perf_counter() - began

    def _of_raw(self, raws: Sequence[RawFrame]) -> np.ndarray:
        return self.separations(map(self.processor.calibrate, raws))
