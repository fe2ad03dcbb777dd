"""What a frame shows before everything of it is fitted: its electrons, its stars and a kernel estimate.

raw frame -> (region) -> electrons -> scene -> kernel estimate
"""

from __future__ import annotations

import functools
import logging
import math
from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, field, replace
from typing import Any

import jax.numpy as jnp
import numpy as np

from jitterkit.batch.estimated import Estimated
from jitterkit.batch.shown import Shown
from jitterkit.batch.verdict import scale_hint, why_unusable
from jitterkit.errors import ConfigurationError, ErrorCode, FrameError, JitterkitError, out_of_memory
from jitterkit.estimators import KernelEstimate, estimate_score, estimator
from jitterkit.estimators.score import estimate_from_normal
from jitterkit.frames import Frame, Metadata, RawFrame
from jitterkit.frames.region import find_region
from jitterkit.instruments import Instrument, resolve
from jitterkit.likelihood import Data
from jitterkit.locate import Residual, locate_binary, locate_star, locate_stars
from jitterkit.loci import Mvn
from jitterkit.optics import Optics
from jitterkit.refit import POOR, SCENES, FitOptions, FitResult, SceneChoice, Status, choose_scene
from jitterkit.scene import Star

__all__ = ["AUTO", "SCORE", "Finder", "GridKey"]

log = logging.getLogger(__name__)

_FEWEST = 8
"""Pixels along a side below which a pair cannot be told from one star."""

_FEWEST_USED = _FEWEST**2 // 2
"""Pixels below which several pairs fit alike: of fits to 10 to 16 one in thirty was off by 20 errors."""

GridKey = tuple[tuple[int, int], float]
"""Shape ``(ny, nx)`` and plate scale [arcsec]."""

_SYSTEMS = 8
"""Optics kept, one a grid: a scale that is solved anew in each frame must not fill the memory."""

SCORE = "score"
"""The estimator that is what finding the stars does, as far as a fit's start goes."""

AUTO = "auto"
"""In place of a scene's name: the simplest that the frame supports."""

_SEARCHES = dict(zip(SCENES, (locate_star, locate_binary, locate_stars), strict=True))


@dataclass
class Finder:
    """Finds the stars in frames of one instrument; optics are computed once for each shape and scale.

    Attributes
    ----------
    instrument : Instrument
    overrides : mapping
        Metadata from the command line, by field.
    kernel : str
        Name of the estimator.
    scene : str
        ``"auto"``, ``"star"``, ``"binary"`` or ``"stars"``.
    options : FitOptions
        Its priors hold for every frame.
    censored : bool
        Whether pixels at their ceiling count with the probability of being there, or are left out.
    known : mapping
        What other frames have shown, by :meth:`grid`; on other grids all is found from nothing.
    """

    instrument: Instrument
    overrides: Mapping[str, Any] = field(default_factory=dict)
    _: KW_ONLY
    kernel: str = SCORE
    scene: str = AUTO
    options: FitOptions = field(default_factory=FitOptions)
    censored: bool = False
    known: Mapping[GridKey, Shown] = field(default_factory=dict, repr=False)
    _systems: dict[GridKey, Optics] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        """Refuse unknown names and impossible numbers before any frame is read, and warn of 32 bits."""
        if jnp.zeros(()).dtype == jnp.float32:
            _warn_of_32_bits()
        estimator(self.kernel)
        if self.scene not in (AUTO, *SCENES):
            raise ConfigurationError(
                ErrorCode.UNKNOWN_NAME,
                f"There is no scene {self.scene!r}; give one of {', '.join((AUTO, *SCENES))}.",
            )
        Metadata().apply("command line", **self.overrides)

    def prepare(self, raw: RawFrame) -> Frame | FitResult:
        """Calibrate a frame, or say why that cannot be done; raises nothing but a lack of memory."""
        try:
            return self.calibrate(raw)
        except Exception as error:  # whatever a frame does, the others are not to suffer
            if out_of_memory(error):
                raise
            return self.trouble(error)

    def calibrate(self, raw: RawFrame) -> Frame:
        """Complete a frame's metadata, cut out its stars if it is large, and turn it into electrons."""
        digest = raw.digest  # of the whole frame, as its file holds it
        raw = resolve(raw, self.instrument, self.overrides)
        ny, nx = self.instrument.shape
        large = raw.shape[0] > ny or raw.shape[1] > nx
        if large:
            raw = find_region(raw, (min(ny, raw.shape[0]), min(nx, raw.shape[1])))
        frame = self.instrument.detector.calibrate(raw)
        flags = (*frame.flags, *["masked"] * bool(raw.mask.any()), *["cut_out"] * large)
        return frame.told(flags=flags, digest=digest)

    def estimate(self, frame: Frame, *, rough: bool = False) -> Estimated | FitResult:
        """Find the stars and estimate the kernel, or say why not.

        Parameters
        ----------
        frame : Frame
        rough : bool
            Whether a fit of everything is to follow: the score estimate is then the one that finding the
            stars gives, which need not be made twice.

        Returns
        -------
        estimated : Estimated or FitResult
        """
        data = Data.of(frame, censored=self.censored)
        found = self._registered(frame, data, rough) or self._located(frame, data, rough)
        if isinstance(found, FitResult):
            return found
        if self.kernel != SCORE:
            blur = estimator(self.kernel)(data, found.parameters, found.otf, hold=self.options.hold)
            found.estimate = blur
        found.estimate = replace(found.estimate, source=frame.name, digest=frame.digest)
        return found

    def choose_scene(self, frame: Frame) -> SceneChoice | None:
        """What scene a frame shows at first sight; None if it shows none."""
        try:
            data = self._without_outliers(frame, Data.of(frame, censored=self.censored))
            found = self._found(frame, data, rough=True)
        except Exception as error:
            if out_of_memory(error):
                raise
            return None  # the frame itself will say why
        return None if isinstance(found, FitResult) or not found.start.deviance_dof < POOR else found

    def repeats(self, frame: Frame) -> bool:
        """Whether a frame shows what others have shown, so that its scene is in no doubt."""
        found = self._registered(frame, Data.of(frame), rough=True)
        # a cut-out about one star does not show what else is in the frame
        return found is not None and found.parameters.scene.name != Star.name

    def optics(self, frame: Frame) -> Optics:
        """Optics on a frame's grid, at the scale the frame says it has."""
        key = self.grid(frame)
        if key in self.known and self.known[key].anchored is not None:
            return self.known[key].optics(frame)
        system = self._systems.get(key)
        if system is None:
            shape, scale = key
            while len(self._systems) >= _SYSTEMS:
                self._systems.pop(next(iter(self._systems)), None)
            system = self._systems[key] = self.instrument.system(shape=shape, plate_scale=scale)
        return system

    def grid(self, frame: Frame) -> GridKey:
        """What frames have in common that share their optics: shape and plate scale, but for its rounding."""
        return frame.shape, float(f"{frame.plate_scale or self.instrument.plate_scale:.9g}")

    def trouble(self, error: Exception, frame: Frame | None = None) -> FitResult:
        """Map an exception to a result with the matching status."""
        if not isinstance(error, JitterkitError):
            return FitResult.from_error(Status.FAILED, error, f"{Status.FAILED.value}: {error}")
        if isinstance(error, FrameError) and error.code is ErrorCode.NO_STAR:
            return FitResult.from_error(Status.NO_STAR, error)
        hint = "" if frame is None else scale_hint(frame, self.instrument.plate_scale)
        message = f"{Status.MISMATCH.value}: {error} {hint}".rstrip()
        return FitResult.from_error(Status.MISMATCH, error, message)

    def _registered(self, frame: Frame, data: Data, rough: bool) -> Estimated | None:
        """What a frame shows that repeats others; None of one that does not."""
        known = self.known.get(self.grid(frame))
        start = None if known is None or known.reference is None else known.reference.locate(data)
        if known is None or start is None or not np.all(np.isfinite(start.covariance)):
            return None
        # any other estimate takes the place of this one, for which a normal will do
        if (rough or self.kernel != SCORE) and start.describes(start.parameters):
            parameters, moments = start.parameters, np.asarray(start.parameters.locus.moments())
            estimate = KernelEstimate(moments, start.covariance, SCORE)
        else:
            told = (start.covariance, start.otf, start.data, self.options.hold)
            estimate, parameters = estimate_from_normal(start.parameters, *told)
            if not start.describes(parameters):
                return None
            parameters = parameters.with_locus(Mvn.near(jnp.asarray(estimate.moments)))
        return Estimated(data, start.in_frame(parameters), estimate, known.optics(frame), doubt=known.doubt)

    def _located(self, frame: Frame, data: Data, rough: bool) -> Estimated | FitResult:
        """What a frame shows that is searched through."""
        clean = self._without_outliers(frame, data)
        found = self._found(frame, clean, rough=rough and self.kernel == SCORE)
        if isinstance(found, FitResult):
            return found
        start = found.start
        if found.undecided:
            return FitResult(
                Status.UNDETERMINED,
                f"A pair closer than the resolution, or a smear: {found.readings}; the odds are "
                f"{math.exp(found.log_odds):.2g} to 1 for the pair. Give --scene if it is known.",
            )
        if rough or self.kernel != SCORE:  # any other estimate takes the place of this one
            estimate = KernelEstimate(np.asarray(start.parameters.locus.moments()), start.covariance, SCORE)
        else:
            estimate = estimate_score(clean, start.parameters, start.otf, hold=self.options.hold)
        known = self.known.get(self.grid(frame))
        doubt = found.doubt or ("" if known is None or known.scene != found.scene else known.doubt)
        left_out = int(np.count_nonzero(data.used) - np.count_nonzero(clean.used))
        told = start.parameters, estimate, self.optics(frame), start.otf, doubt, found.fit, left_out
        return Estimated(clean, *told)

    def _without_outliers(self, frame: Frame, data: Data) -> Data:
        """Data without pixels that no star can have made: a search would take them for stars."""
        if not np.any(data.used):
            return data
        dark = Residual.of_dark(data, self.optics(frame).nominal)
        return data.without(dark.outliers(0.0, surely=True))

    def _found(self, frame: Frame, data: Data, *, rough: bool = False) -> SceneChoice | FitResult:
        """Find the stars, or say why not."""
        if not np.any(np.asarray(data.used)):
            return FitResult(Status.NO_DATA, f"{Status.NO_DATA.value}: {why_unusable(frame)}.")
        if min(frame.shape) < _FEWEST:
            return FitResult(
                Status.NO_DATA, f"{frame.shape[1]} x {frame.shape[0]} pixels are too few for a fit."
            )
        used = int(np.count_nonzero(np.asarray(data.used)))
        if used < _FEWEST_USED:
            few = f"{used} usable pixels are too few for a fit; at least {_FEWEST_USED} are needed."
            return FitResult(Status.NO_DATA, few)
        known = self.known.get(self.grid(frame))
        scene = known.scene if self.scene == AUTO and known is not None else self.scene
        optics, hold = self.optics(frame), self.options.hold
        seen = known.choices.get(frame.digest) if rough and known is not None else None
        if seen is not None and (scene in (AUTO, seen.scene) or seen.evidence is None):
            return seen  # it agrees with the others, or is in no doubt
        start = None if scene == AUTO else _SEARCHES[scene](data, optics, hold, rough=rough)
        choice = None
        # a frame of a run need not be as the run is
        if start is not None and (scene == self.scene or start.describes(data)):
            told = ("", False) if seen is None else (seen.readings, True)
            choice = SceneChoice(start, -math.inf if scene == Star.name else math.inf, *told)
        elif self.scene == AUTO:
            choice = choose_scene(data, optics, self.options, rough=rough)
        if choice is None:
            return FitResult(Status.NO_STAR, f"{Status.NO_STAR.value}: there is no star to fit.")
        return choice


@functools.cache
def _warn_of_32_bits() -> None:
    log.warning(
        "JAX computes in 32 bits, which costs accuracy: call jax.config.update('jax_enable_x64', True) "
        "before anything else."
    )
