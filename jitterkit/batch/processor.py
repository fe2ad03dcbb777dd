"""One frame from file to fit: the path of every frame of ``jitterkit process``.

raw frame -> (region) -> electrons -> scene -> kernel estimate -> refit -> diagnosis

A frame that cannot be used ends with a status and a sentence at whatever step stops it.  Frames on the grid
of reference frames start warm: registered to one of them, about its optics.
"""

from __future__ import annotations

import copy
import functools
import logging
import math
import time
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, field, replace
from typing import Any, Self

import jax.numpy as jnp
import numpy as np

from jitterkit.batch.diagnose import (
    diagnose,
    midpoint_pixel,
    position_angle,
    remark,
    status_from_exception,
    undecided,
    unusable,
)
from jitterkit.batch.plan import Batch, FrameReader, Item
from jitterkit.batch.records import ProcessedFrame, SceneEstimate
from jitterkit.batch.warm_start import AUTO, SCORE, GridKey, WarmStart, WarmStartCache
from jitterkit.errors import ConfigurationError, ErrorCode, JitterkitError, out_of_memory
from jitterkit.estimators import KernelEstimate, estimate_score, estimator
from jitterkit.frames import Frame, Metadata, RawFrame
from jitterkit.frames.region import find_region
from jitterkit.instruments import Instrument, resolve
from jitterkit.likelihood import Data
from jitterkit.locate import (
    Residual,
    allow_for_model,
    locate_binary,
    locate_star,
    locate_stars,
    most_outliers,
)
from jitterkit.loci import locus_class
from jitterkit.optics import Optics
from jitterkit.refit import (
    POOR,
    SCENES,
    FitOptions,
    FitResult,
    KernelPrior,
    Priors,
    SceneChoice,
    Status,
    choose_scene,
    fit_best_locus,
    fit_locus,
)
from jitterkit.refit.outliers import OUTLIERS, left_out
from jitterkit.refit.rays import find_rays
from jitterkit.refit.scene_choice import DECIDED
from jitterkit.refit.scene_search import found_allowing
from jitterkit.refit.together import scene_together
from jitterkit.scene import Star

__all__ = ["AUTO", "SCORE", "FrameProcessor"]

log = logging.getLogger(__name__)

_SEARCHES = dict(zip(SCENES, (locate_star, locate_binary, locate_stars), strict=True))

_Look = tuple[Frame, SceneChoice]
"""A frame, and what it shows by itself."""

_SYSTEMS = 8
"""Optics kept, one a grid: a scale that is solved anew in each frame must not fill the memory."""

_ROUNDS = 3
"""Refits without what does not belong to a frame: the first fit is bent by it."""

_MISLED = (Status.POOR_FIT, Status.NOT_CONVERGED, Status.NO_PAIR, Status.FAILED)
"""What may come of a warm start; such a frame is fitted again from a cold start."""

_SURE = (Status.POOR_FIT, Status.NO_PAIR)
"""Of these, what does not, where pair and wavefront are in no doubt: the locus does not fit."""


@dataclass
class FrameProcessor:
    """Processes frames of one instrument: finds their stars and fits them.

    Optics are computed once for each shape and scale.

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
        Warm starts by :meth:`grid`; frames on other grids start cold.
    locus : str
        ``"auto"`` or a name in ``LOCI``.
    prior : KernelPrior or None
        What other data say about the jitter: of each frame, whatever was not made of that frame itself.
        It joins the priors in the options.
    rays : bool
        Whether to look for cosmic rays in what a fit leaves, and to fit again without the pixels they hit.
    """

    instrument: Instrument
    overrides: Mapping[str, Any] = field(default_factory=dict)
    _: KW_ONLY
    kernel: str = SCORE
    scene: str = AUTO
    options: FitOptions = field(default_factory=FitOptions)
    censored: bool = False
    known: Mapping[GridKey, WarmStart] = field(default_factory=dict, repr=False)
    locus: str = AUTO
    prior: KernelPrior | None = None
    rays: bool = False
    # of these settings: a copy with others begins without
    _systems: dict[GridKey, Optics] = field(init=False, default_factory=dict, repr=False)
    _cache: WarmStartCache = field(init=False, default_factory=WarmStartCache, repr=False)

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
        if self.locus != AUTO:
            locus_class(self.locus)
        Metadata().apply("command line", **self.overrides)

    @property
    def plate_scale(self) -> float:
        """The instrument's, arcsec."""
        return self.instrument.plate_scale

    def process(self, raw: RawFrame) -> ProcessedFrame:
        """Fit a frame.

        Parameters
        ----------
        raw : RawFrame

        Returns
        -------
        processed : ProcessedFrame
            Never raises for the frame's sake; ``result.status`` says how it ended.

        Raises
        ------
        MemoryError or jax.errors.JaxRuntimeError
            If memory runs out.
        """
        return self.complete(self.prepare(raw))

    def prepare(self, raw: RawFrame) -> Frame | FitResult:
        """Calibrate a frame, or say why that cannot be done; raises nothing but a lack of memory."""
        try:
            return self.calibrate(raw)
        except Exception as error:  # whatever a frame does, the others are not to suffer
            if out_of_memory(error):
                raise
            return status_from_exception(error, None, self.plate_scale)

    def complete(self, prepared: Frame | FitResult) -> ProcessedFrame:
        """Fit a prepared frame."""
        return self.fit(prepared) if isinstance(prepared, Frame) else ProcessedFrame(None, prepared)

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

    def fit(self, frame: Frame) -> ProcessedFrame:
        """Fit a calibrated frame; raises nothing but a lack of memory, which is not the frame's fault.

        If a warm start may be why it cannot be fitted, it is fitted again from a cold start.
        """
        began = time.perf_counter()
        try:
            fitted, result = self._fit(frame)
        except Exception as error:
            if out_of_memory(error):
                raise
            log.debug("%s", frame.name, exc_info=True)
            fitted, result = frame, status_from_exception(error, frame, self.plate_scale)
        known = self.known.get(self.grid(frame))
        misled = known is not None and known.changes(frame) and result.status in _MISLED
        if misled and not (result.status in _SURE and self.repeats(frame)):
            return self.with_warm_starts({}).fit(frame)
        result = replace(result, seconds=time.perf_counter() - began)
        scale = frame.plate_scale or self.plate_scale
        pixel, pa = midpoint_pixel(fitted, result, scale), position_angle(fitted, result, scale)
        return ProcessedFrame(fitted, result, pixel, pa)

    def estimate(self, frame: Frame, *, rough: bool = False) -> SceneEstimate | FitResult:
        """Find the stars and estimate the kernel, or say why not.

        Parameters
        ----------
        frame : Frame
        rough : bool
            Whether a fit of everything is to follow: the score estimate is then the one that finding the
            stars gives, which need not be made twice.

        Returns
        -------
        estimate : SceneEstimate or FitResult
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

    def for_batch(self, batch: Batch, hdu: int | None = None) -> Self:
        """Return the processor with the warm starts that the reference frames of a batch give."""
        key = batch.references, hdu, batch.scene_only
        return self.with_warm_starts(self._cache.get(key, functools.partial(self._find_warm_starts, *key)))

    def with_warm_starts(self, known: Mapping[GridKey, WarmStart]) -> Self:
        """Return a processor of the same settings with other warm starts; optics are shared."""
        other = copy.copy(self)
        other.known, other._systems, other._cache = known, self._systems, WarmStartCache()
        return other

    def __getstate__(self) -> dict[str, Any]:
        """Leave out the optics, which other processes compute themselves."""
        return self.__dict__ | {"_systems": {}}

    def warm_start(self, frame: Frame) -> WarmStart | None:
        """Return what one frame shows; None for one that is not sound, and where nothing is known by it."""
        choice = self.choose_scene(frame)
        return None if choice is None else self._warm_start(frame, choice)

    def choose_scene(self, frame: Frame) -> SceneChoice | None:
        """Return what scene a frame shows at first sight; None if it shows none."""
        try:
            data = self._without_outliers(frame, Data.of(frame, censored=self.censored))
            search = functools.partial(self._found, frame)
            found, _ = found_allowing(search, data, self.options.model_error, rough=True)
        except Exception as error:
            if out_of_memory(error):
                raise
            return None  # the frame itself will say why
        return None if isinstance(found, FitResult) or not found.start.deviance_dof < POOR else found

    def repeats(self, frame: Frame) -> bool:
        """Return whether a frame shows what the reference frame shows: its scene is in no doubt then."""
        found = self._registered(frame, Data.of(frame), rough=True)
        # a cut-out about one star does not show what else is in the frame
        return found is not None and found.parameters.scene.name != Star.name

    def optics(self, frame: Frame) -> Optics:
        """Return the optics on a frame's grid, at the scale the frame says it has."""
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
        """Return what frames have in common that share their optics: shape, and plate scale to 9 digits."""
        return frame.shape, float(f"{frame.plate_scale or self.plate_scale:.9g}")

    @property
    def priors(self) -> Priors:
        """Those of every frame: the options', and what the instrument says of aberrations that are fitted."""
        known = Priors.alike(self.instrument.aberrations, self.instrument.aberration_sigma)
        return known.joined(self.options.priors)

    def options_of(self, frame: Frame) -> FitOptions:
        """Return the options with what is known of this frame's jitter and optics."""
        told = Priors() if self.prior is None else self.prior.of(frame.name, frame.digest)
        return replace(self.options, priors=self.priors.joined(told))

    def _fit(self, frame: Frame) -> tuple[Frame, FitResult]:
        """Fit a frame, and again without pixels that do not belong to it, as long as they are few."""
        (result, before), after, most = self._fit_once(frame), 0, most_outliers(~frame.mask)
        for _ in range(_ROUNDS):
            hit, flag = self._do_not_belong(frame, result)
            alone = int(hit.sum()) if flag == OUTLIERS else 0
            if not hit.any() or (alone and before + after + alone > most):
                break
            after += alone
            flags = tuple(dict.fromkeys((*frame.flags, flag)))
            frame = replace(frame, mask=frame.mask | hit, flags=flags)
            result, before = self._fit_once(frame)
        left = self._left_over(frame, result)
        if left is not None and result.parameters is not None and result.status.usable:
            result = replace(result, further_limit=left.hidden(result.parameters.scene))
        return frame, remark(result, left_out(before + after), OUTLIERS)

    def _do_not_belong(self, frame: Frame, result: FitResult) -> tuple[np.ndarray, str]:
        """Return pixels that a fit leaves over, and the flag that says so of the frame."""
        left = self._left_over(frame, result)
        if left is None or result.parameters is None:
            return np.zeros(frame.shape, bool), ""
        if self.rays and (rays := find_rays(result.residual)).any():
            return rays, "rays_masked"
        return left.outliers(float(result.parameters.background)), OUTLIERS

    def _left_over(self, frame: Frame, result: FitResult) -> Residual | None:
        """Return what a fit leaves of a frame; None for one that could not be fitted."""
        if result.residual is None or result.image is None or result.parameters is None:
            return None
        data, otf = Data.of(frame).without(~np.isfinite(result.residual)), self.optics(frame).nominal
        data = allow_for_model(data, result.parameters, result.image, otf, self.options.model_error)
        return Residual(data, result.image, otf, result.parameters.locus)

    def _fit_once(self, frame: Frame) -> tuple[FitResult, int]:
        """Fit a frame, and say how many pixels the search for its stars left out."""
        found = self.estimate(frame, rough=True)
        if isinstance(found, FitResult):
            return found, 0
        options = self.options_of(frame)
        common = (found.data, found.optics, found.parameters, found.estimate.moments, found.otf, options)
        told = options.priors.terms or options.priors.if_free or options.priors.moments is not None
        if self.locus == AUTO and found.fit is not None and not told:
            result = found.fit
        elif self.locus == AUTO:
            result = fit_best_locus(*common, found.estimate.covariance, sure=found.searched is None)
        else:
            result = fit_locus(self.locus, *common, sure=found.searched is None)
        result = diagnose(frame, found, replace(result, estimate=found.estimate), self.plate_scale)
        if self.prior is not None and self.prior.of(frame.name, frame.digest) == Priors():
            result = remark(result, "The prior holds this frame only and was not used.", "prior_unused")
        return result, found.left_out

    def _find_warm_starts(
        self, references: tuple[Item, ...], hdu: int | None, scene_only: bool
    ) -> dict[GridKey, WarmStart]:
        """Look at reference frames until one is in no doubt of its scene; at all for their scene only."""
        found: defaultdict[GridKey, list[_Look]] = defaultdict(list)
        with FrameReader(hdu) as reader:
            for _, _, raw in reader.read(references):
                frame = None if isinstance(raw, JitterkitError) else self.prepare(raw)
                if not isinstance(frame, Frame):
                    continue
                seen = found[self.grid(frame)]
                if not scene_only and any(map(_is_sure, seen)):
                    continue
                if (choice := self.choose_scene(frame)) is not None:
                    seen.append((frame, choice))
        combine = self._scene_of if scene_only else self._warm_start_of
        starts = ((key, combine(seen)) for key, seen in found.items())
        return {key: start for key, start in starts if start is not None}

    def _warm_start_of(self, seen: list[_Look]) -> WarmStart | None:
        """Return what the first frame shows that is in no doubt; where all are, what they show together."""
        sure = [look for look in seen if _is_sure(look)]
        if sure:
            return self._warm_start(*sure[0])
        scene = scene_together([choice for _, choice in seen])
        looks = [look for look in seen if look[1].scene == scene]
        if looks:
            return self._warm_start(*looks[0])
        return None if scene is None else WarmStart(scene)

    def _scene_of(self, seen: list[_Look]) -> WarmStart | None:
        """Return what scene a few frames show together, and what each shows by itself."""
        if self.scene != AUTO:
            return None
        scene = scene_together([choice for _, choice in seen]) or AUTO
        return WarmStart(scene, choices={frame.digest: choice for frame, choice in seen})

    def _warm_start(self, frame: Frame, choice: SceneChoice) -> WarmStart | None:
        if warm := self._cache.warm_start(self.grid(frame), self.optics(frame), choice, self.options):
            return warm
        return WarmStart(choice.scene, choice.doubt) if self.scene == AUTO else None  # nothing can change

    def _registered(self, frame: Frame, data: Data, rough: bool) -> SceneEstimate | None:
        """Return what a frame shows that repeats a reference frame; None for one that does not."""
        known = self.known.get(self.grid(frame))
        # any other estimate takes the place of the score's, for which a normal will do
        rough = rough or self.kernel != SCORE
        return None if known is None else known.register(frame, data, self.options.hold, rough)

    def _located(self, frame: Frame, data: Data, rough: bool) -> SceneEstimate | FitResult:
        """Return what a frame shows that is searched through."""
        clean = self._without_outliers(frame, data)
        search, haste = functools.partial(self._found, frame), rough and self.kernel == SCORE
        found, clean = found_allowing(search, clean, self.options.model_error, rough=haste)
        if isinstance(found, FitResult):
            return found
        if (result := undecided(found)) is not None:
            return result
        start = found.start
        if rough or self.kernel != SCORE:  # any other estimate takes the place of this one
            estimate = KernelEstimate(np.asarray(start.parameters.locus.moments()), start.covariance, SCORE)
        else:
            estimate = estimate_score(clean, start.parameters, start.otf, hold=self.options.hold)
        known = self.known.get(self.grid(frame))
        doubt = found.doubt or ("" if known is None or known.scene != found.scene else known.doubt)
        dropped = int(np.count_nonzero(data.used) - np.count_nonzero(clean.used))
        optics = self.optics(frame)
        return SceneEstimate(clean, start.parameters, estimate, optics, start.otf, doubt, found.fit, dropped)

    def _without_outliers(self, frame: Frame, data: Data) -> Data:
        """Return data without pixels that no star can have made: a search would take them for stars."""
        if not np.any(data.used):
            return data
        dark = Residual.of_dark(data, self.optics(frame).nominal)
        return data.without(dark.outliers(0.0, surely=True))

    def _found(self, frame: Frame, data: Data, *, rough: bool = False) -> SceneChoice | FitResult:
        """Find the stars, or say why not."""
        if (refused := unusable(frame, data)) is not None:
            return refused
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


def _is_sure(look: _Look) -> bool:
    """Return whether a frame is in no doubt about its scene."""
    return not abs(look[1].log_odds) < DECIDED


@functools.cache
def _warn_of_32_bits() -> None:
    log.warning(
        "JAX computes in 32 bits, which costs accuracy: call jax.config.update('jax_enable_x64', True) "
        "before anything else."
    )
