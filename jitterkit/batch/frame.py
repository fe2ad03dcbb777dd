"""One frame from file to fit: the path that ``jitterkit process`` walks for each.

raw frame -> (region) -> electrons -> star pair -> kernel estimate -> refit

A frame that cannot be used ends with a status and a sentence at whatever step stops it.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from jitterkit.errors import FrameError, JitterkitError
from jitterkit.estimators import KernelEstimate, estimator
from jitterkit.frames import Frame, RawFrame, sky_position_angle
from jitterkit.frames.region import find_region
from jitterkit.instruments import Instrument, resolve
from jitterkit.likelihood import Data
from jitterkit.locate import Start, locate_binary
from jitterkit.loci import locus_class
from jitterkit.optics.system import FixedOptics, OpticalSystem
from jitterkit.refit import FitOptions, FitResult, Status, fit_best_locus, fit_locus

__all__ = ["Processed", "Processor"]

log = logging.getLogger(__name__)

_FEWEST = 8
"""Pixels along a side below which no pair can be told from one star."""


@dataclass(frozen=True)
class Processed:
    """A frame and what became of it.

    Attributes
    ----------
    frame : Frame or None
        In electrons, cut to the region that was fitted; None if it never got so far.
    result : FitResult
    pa : float
        Direction from A to B on the sky, north through east [deg]; NaN without a WCS.
    """

    frame: Frame | None
    result: FitResult
    pa: float = float("nan")


@dataclass
class Processor:
    """Processes frames of one instrument; optics are computed once for each shape and scale.

    Attributes
    ----------
    instrument : Instrument
    overrides : mapping
        Metadata from the command line, by field.
    locus : str
        ``"auto"`` or a name in ``LOCI``.
    kernel : str
        Name of the estimator that starts the fit.
    options : FitOptions
    """

    instrument: Instrument
    overrides: Mapping[str, Any] = field(default_factory=dict)
    locus: str = "auto"
    kernel: str = "score"
    options: FitOptions = field(default_factory=FitOptions)
    _systems: dict[tuple, OpticalSystem | FixedOptics] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        """Refuse unknown names before any frame is read."""
        estimator(self.kernel)
        if self.locus != "auto":
            locus_class(self.locus)

    def process(self, raw: RawFrame) -> Processed:
        """Fit a frame.

        Parameters
        ----------
        raw : RawFrame

        Returns
        -------
        processed : Processed
            Never raises for the frame's sake; ``result.status`` says how it ended.
        """
        frame = None
        began = time.perf_counter()
        try:
            frame = self.calibrate(raw)
            result = self._fit(frame)
        except FrameError as error:
            result = FitResult(Status.NO_STAR if frame is None else Status.FAILED, str(error))
        except JitterkitError as error:
            result = FitResult(Status.MISMATCH, f"{Status.MISMATCH.value}: {error}")
        except (ArithmeticError, ValueError, np.linalg.LinAlgError) as error:
            log.debug("%s", raw.name, exc_info=True)
            result = FitResult(Status.FAILED, f"{Status.FAILED.value}: {error}")
        result = replace(result, seconds=time.perf_counter() - began)
        return Processed(frame, result, self._position_angle(frame, result))

    def calibrate(self, raw: RawFrame) -> Frame:
        """Complete a frame's metadata, cut out its stars if it is large, and turn it into electrons."""
        raw = resolve(raw, self.instrument, self.overrides)
        ny, nx = self.instrument.shape
        large = raw.shape[0] > ny or raw.shape[1] > nx
        if large:
            raw = find_region(raw, (min(ny, raw.shape[0]), min(nx, raw.shape[1])))
        frame = self.instrument.detector.calibrate(raw)
        flags = (*frame.flags, *["masked"] * bool(raw.mask.any()), *["cut_out"] * large)
        return replace(frame, flags=flags)

    def estimate(self, frame: Frame) -> tuple[KernelEstimate, Start] | FitResult:
        """Find the pair and estimate the kernel, or say why not."""
        data = Data(frame.electrons, frame.read_variance, ~frame.mask)
        if not np.any(np.asarray(data.used)):
            return FitResult(
                Status.NO_DATA, f"{Status.NO_DATA.value}: every pixel is masked or not a number."
            )
        if min(frame.shape) < _FEWEST:
            return FitResult(
                Status.NO_DATA, f"{frame.shape[1]} x {frame.shape[0]} pixels are too few for a pair."
            )
        start = locate_binary(data, self.optics(frame))
        if start is None:
            return FitResult(Status.NO_STAR, f"{Status.NO_STAR.value}: there is no star to fit.")
        estimate = estimator(self.kernel)(data, start.parameters, start.otf)
        return replace(estimate, source=frame.name), start

    def optics(self, frame: Frame) -> OpticalSystem | FixedOptics:
        """Optics on a frame's grid, at the scale the frame says it has."""
        scale = frame.plate_scale or self.instrument.plate_scale
        key = (frame.shape, scale)
        if key not in self._systems:
            self._systems[key] = self.instrument.system(shape=frame.shape, plate_scale=scale)
        return self._systems[key]

    def _fit(self, frame: Frame) -> FitResult:
        estimated = self.estimate(frame)
        if isinstance(estimated, FitResult):
            return estimated
        estimate, start = estimated
        data = Data(frame.electrons, frame.read_variance, ~frame.mask)
        common = (data, self.optics(frame), start.parameters, estimate.moments, start.otf, self.options)
        result = fit_best_locus(*common) if self.locus == "auto" else fit_locus(self.locus, *common)
        return self._judge(frame, replace(result, estimate=estimate))

    def _judge(self, frame: Frame, result: FitResult) -> FitResult:
        """Add what only the frame and the instrument together can tell."""
        if result.status is Status.POOR_FIT:
            return replace(result, message=result.message + self._scale_hint(frame))
        if result.status in (Status.OK, Status.NOT_CONVERGED) and _is_single(result):
            message = f"{Status.NO_PAIR.value}: a second one is lost in its noise."
            return replace(result, status=Status.NO_PAIR, message=message)
        return result

    def _scale_hint(self, frame: Frame) -> str:
        """A sentence where a frame that does not fit has an unexpected plate scale."""
        known, expected = frame.metadata.plate_scale, self.instrument.plate_scale
        if known is None or abs(known.value / expected - 1) < 0.01:
            return ""
        return (
            f" Its plate scale of {known.value:g} arcsec ({known.source}) is not the instrument's "
            f"{expected:g}: give --plate-scale if it is wrong."
        )

    def _position_angle(self, frame: Frame | None, result: FitResult) -> float:
        if frame is None or frame.metadata.wcs is None or result.parameters is None:
            return float("nan")
        scene, scale = result.parameters.scene, frame.plate_scale or self.instrument.plate_scale
        x, y = (
            first + (n - 1) / 2 + float(offset) / scale
            for first, n, offset in zip(frame.origin, frame.shape[::-1], (scene.x, scene.y), strict=True)
        )
        return sky_position_angle(frame.metadata.wcs, x, y, float(scene.theta))


def _is_single(result: FitResult) -> bool:
    """Whether the fainter star's flux is not five standard errors."""
    if result.parameters is None:
        return False
    contrast, error = float(result.parameters.scene.contrast), result.error("contrast")
    return not error < 0.2 * (1 + contrast)
