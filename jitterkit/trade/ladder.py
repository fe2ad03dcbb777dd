"""Settings measured one by one: milliseconds a frame, and what they do to the separation.

Reach for :func:`climb_ladder`.  The error of a setting has two parts, both as shares of the least error that
a frame allows (the Cramer-Rao bound at the most exact settings): what is wrong with the separation of
frames without noise, and by how much the error that their fits state is larger.  Of 32 bits the first is
what rounding changes in noisy frames: a fit's end is known to a share of its deviance, which is none without
noise.
"""

from __future__ import annotations

import math
import time
from collections.abc import Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import jax
import numpy as np

from jitterkit.batch import Processor
from jitterkit.batch.survey import Survey
from jitterkit.errors import JitterkitError
from jitterkit.frames import Frame, RawFrame
from jitterkit.instruments import Instrument
from jitterkit.refit import FitResult
from jitterkit.trade.scenes import TradeScene
from jitterkit.trade.settings import ABERRATIONS, PRESETS, Settings, own_pad, preset

__all__ = ["Point", "climb_ladder", "front", "measure"]

_TOGETHER = 1024
"""Frames that share what one of them shows of the optics."""

_RUNGS: dict[str, tuple[Any, ...]] = {
    "pad": (0, 8, 16, 32, 64, 96, 128),
    "samples": (1, 3, 5, 7, 9, 11, 13, 16),
    "binning": (8, 4, 2, 1),
    "aberrations": ABERRATIONS,
    "tolerance": (1.0, 0.1, 1e-2, 1e-4),
    "region": (32, 48, 64, 96, None),
    "bits": (32, 64),
}
"""From the fastest to the most exact."""


@dataclass(frozen=True)
class Point:
    """What settings cost and give.

    Attributes
    ----------
    name : str
    settings : Settings or None
        None of another package.
    seconds : float
        Of a frame, its share of the look at the optics included.
    bias : float
        Rms over the frames of what is wrong with the separation without noise, arcsec.
    sigma : float
        Rms of the errors of the separation that the fits state, arcsec.
    bound : float
        The least that there can be, arcsec.
    message : str
        Why there are no numbers, if there are none.
    """

    name: str
    settings: Settings | None
    seconds: float = math.nan
    bias: float = math.nan
    sigma: float = math.nan
    bound: float = math.nan
    message: str = ""

    @property
    def excess(self) -> float:
        """Stated error beyond the bound, as a share of it."""
        return max(self.sigma / self.bound - 1, 0.0)

    @property
    def error(self) -> float:
        """Bias and excess together, in squares, as a share of the bound."""
        return math.hypot(self.bias / self.bound, self.excess)


def climb_ladder(
    instrument: Instrument,
    scene: TradeScene,
    base: Settings | None = None,
    *,
    locus: str = "mvn",
) -> Iterator[Point]:
    """Measure the presets, and every rung of every setting with the others as they are in one of them.

    Parameters
    ----------
    instrument : Instrument
    scene : TradeScene
    base : Settings, optional
        What the others are; by default those of ``balanced``.
    locus : str
        To fit.

    Yields
    ------
    point : Point
        The most exact one first: its error, or that of the first that can be had, is the bound of the others.
    """
    base = PRESETS["balanced"] if base is None else base
    named = {name: preset(name, instrument) for name in ("exact", "balanced", "fast")}
    seen = {_resolved(settings, instrument) for settings in named.values()}
    for setting, rungs in _RUNGS.items():
        for value in rungs:
            settings = replace(base, **{setting: value})
            if _can_be_had(setting, value, instrument) and _resolved(settings, instrument) not in seen:
                seen.add(_resolved(settings, instrument))
                named[f"{setting} {'whole' if value is None else value}"] = settings
    bound: float | None = None
    for name, settings in named.items():
        point = measure(name, settings, instrument, scene, locus, bound)
        if bound is None and math.isfinite(point.sigma):
            bound = point.sigma
        yield point


def _can_be_had(setting: str, value: Any, instrument: Instrument) -> bool:
    """Whether an instrument can be modelled so."""
    if setting == "samples":
        spectrum = instrument.spectrum
        return spectrum is not None and len(spectrum.sampled(value).wavelengths) == value
    if setting in ("binning", "aberrations"):
        return instrument.pupil is not None
    return True


def _resolved(settings: Settings, instrument: Instrument) -> tuple[Hashable, ...]:
    """What settings come to for an instrument: equal where they are the same."""
    ny, nx = instrument.shape
    side, spectrum = settings.region or max(ny, nx), instrument.spectrum
    if spectrum is not None and settings.samples is not None:
        spectrum = spectrum.sampled(settings.samples)
    pad = own_pad(instrument) if settings.pad is None else settings.pad
    others = (settings.binning, settings.aberrations, settings.tolerance, settings.bits)
    return (pad, spectrum, min(ny, side), min(nx, side), *others)


def measure(
    name: str,
    settings: Settings,
    instrument: Instrument,
    scene: TradeScene,
    locus: str = "mvn",
    bound: float | None = None,
) -> Point:
    """Fit the frames of a scene with some settings.

    Parameters
    ----------
    name : str
    settings : Settings
    instrument : Instrument
    scene : TradeScene
    locus : str
    bound : float, optional
        Least error of a frame, arcsec; by default that of these settings.

    Returns
    -------
    point : Point
        With a message instead of numbers where the settings do not do.
    """
    try:
        if settings.bits == 64:
            fitting = _Fitting.of(settings, instrument, scene, locus)
            bias, sigma = fitting.errors(scene)
            return Point(name, settings, fitting.seconds(scene.noisy), bias, sigma, bound or sigma)
        told = _Fitting.of(replace(settings, bits=64), instrument, scene, locus).separations(scene.noisy)
        jax.clear_caches()  # programs of the one precision do not take the other's numbers
        with jax.enable_x64(False):
            fitting = _Fitting.of(settings, instrument, scene, locus)
            rounded = fitting.separations(scene.noisy)
            sigma = _rms(told[:, 1])
            bias = _rms(rounded[:, 0] - told[:, 0])
            return Point(name, settings, fitting.seconds(scene.noisy), bias, sigma, bound or sigma)
    except JitterkitError as error:
        return Point(name, settings, message=str(error))


@dataclass(frozen=True)
class _Fitting:
    """What fits with some settings, and seconds of a frame that were spent beforehand."""

    processor: Processor
    share: float

    @classmethod
    def of(cls, settings: Settings, instrument: Instrument, scene: TradeScene, locus: str) -> _Fitting:
        processor = settings.processor(instrument, locus)
        if settings.aberrations == "expanded":
            return cls(processor, 0.0)
        frame = processor.calibrate(scene.noisy[0])
        survey = Survey(processor)
        survey.shown(frame)  # compiles
        began = time.perf_counter()
        shown = Survey(processor).shown(frame)
        share = (time.perf_counter() - began) / _TOGETHER
        known = {} if shown is None else {processor.grid(frame): shown}
        return cls(replace(processor, known=known), share)

    def errors(self, scene: TradeScene) -> tuple[float, float]:
        """Of the separation without noise, and as the fits believe it, rms."""
        frames = zip(scene.plain, scene.images, strict=True)
        found = self._separations(
            _without_noise(self.processor.calibrate(raw), image) for raw, image in frames
        )
        truths = np.array([float(truth.binary.separation) for truth in scene.truths])
        return _rms(found[:, 0] - truths), _rms(found[:, 1])

    def separations(self, raws: Sequence[RawFrame]) -> np.ndarray:
        """Of frames with noise, with their errors (n, 2), arcsec."""
        return self._separations(map(self.processor.calibrate, raws))

    def _separations(self, frames: Iterable[Frame]) -> np.ndarray:
        results = map(self._fitted, frames)
        return np.array([(one.of_scene("separation"), one.error("separation")) for one in results])

    def seconds(self, raws: Sequence[RawFrame]) -> float:
        """Median of a frame with noise, calibration included; the first has compiled what there was to."""
        spent = []
        for raw in (raws[0], *raws):
            began = time.perf_counter()
            self._fitted(self.processor.calibrate(raw))
            spent.append(time.perf_counter() - began)
        return float(np.median(spent[1:])) + self.share

    def _fitted(self, frame: Frame) -> FitResult:
        result = self.processor.fit(frame).result
        if result.parameters is None or not result.status.usable:
            raise JitterkitError(result.message)
        return result


def _without_noise(frame: Frame, image: np.ndarray) -> Frame:
    """A frame with the electrons that were expected of it, neither rounded nor cut off at a ceiling."""
    (x0, y0), (ny, nx) = frame.origin, frame.shape
    return replace(frame, electrons=image[y0 : y0 + ny, x0 : x0 + nx])


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def front(points: Sequence[Point]) -> list[Point]:
    """Those of which no other of this package is both as fast and as exact, from the fastest on."""
    ours = (point for point in points if point.settings is not None)
    sound = sorted((p for p in ours if math.isfinite(p.error)), key=lambda p: (p.seconds, p.error))
    best, least = [], math.inf
    for point in sound:
        if point.error < least:
            best.append(point)
            least = point.error
    return best
