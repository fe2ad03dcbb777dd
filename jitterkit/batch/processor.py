"""One frame from file to fit: the :mod:`~jitterkit.batch.steps` of every frame of ``jitterkit process``.

A frame that cannot be used ends with a status and a sentence at whatever step stops it.  Frames on the grid
of reference frames start warm: registered to one of them, about its optics.
"""

from __future__ import annotations

import copy
import functools
import logging
import time
from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, field, replace
from typing import Any, Self

import jax.numpy as jnp

from jitterkit.batch import steps
from jitterkit.batch.diagnose import flag_uneven_motion, status_from_exception
from jitterkit.batch.plan import Batch, Item, read_calibrated
from jitterkit.batch.records import ProcessedFrame, SceneEstimate
from jitterkit.batch.warm_start import (
    AUTO,
    SCORE,
    GridKey,
    WarmStart,
    WarmStartCache,
    from_searched_frames,
    warm_start,
)
from jitterkit.errors import ConfigurationError, ErrorCode, out_of_memory
from jitterkit.estimators import estimator
from jitterkit.frames import Frame, Metadata, RawFrame
from jitterkit.instruments import Instrument
from jitterkit.known_light import KnownLight, without_light
from jitterkit.likelihood import POOR, Data
from jitterkit.loci import locus_class
from jitterkit.optics import Optics
from jitterkit.refit import SCENES, FitOptions, FitResult, KernelPrior, Priors, SceneChoice, Status
from jitterkit.refit.outliers import Fitted, fit_without_outliers
from jitterkit.scene import Star

log = logging.getLogger(__name__)
_warn_once = functools.cache(log.warning)

_SYSTEMS = 8
"""Optics kept, one a grid: a scale that is solved again in each frame must not fill the memory."""

_MISLED = (Status.POOR_FIT, Status.NOT_CONVERGED, Status.NO_PAIR, Status.FAILED)
"""What may come of a warm start; such a frame is fitted again from a cold start."""

_CONCLUSIVE = (Status.POOR_FIT, Status.NO_PAIR)
"""Of these, what does not, where pair and wavefront are in no doubt: the locus does not fit."""


@dataclass
class FrameProcessor:
    """Processes frames of one instrument; optics are computed once for each shape and scale.

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
            found = "JAX computes in 32 bits, which costs accuracy"
            _warn_once(f"{found}: call jax.config.update('jax_enable_x64', True) before anything else.")
        estimator(self.kernel)
        if self.scene not in (AUTO, *SCENES):
            problem = f"There is no scene {self.scene!r}; give one of {', '.join((AUTO, *SCENES))}."
            raise ConfigurationError(ErrorCode.UNKNOWN_NAME, problem)
        if self.locus != AUTO:
            locus_class(self.locus)
        Metadata().apply("command line", **self.overrides)

    @property
    def plate_scale(self) -> float:
        """Return the instrument's plate scale, arcsec."""
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
        try:
            frame = self.calibrate(raw)
        except Exception as error:  # whatever a frame does, the others are not to suffer
            if out_of_memory(error):
                raise
            return ProcessedFrame(None, status_from_exception(error, None, self.plate_scale))
        return self.complete(frame)

    def calibrate(self, raw: RawFrame) -> Frame:
        """Return a frame in electrons, as :func:`~jitterkit.batch.steps.calibrate` does."""
        return steps.calibrate(raw, self.instrument, self.overrides)

    def complete(self, frame: Frame) -> ProcessedFrame:
        """Fit a calibrated frame; raises nothing but a lack of memory, which is not the frame's fault.

        If a warm start may be why it cannot be fitted, it is fitted again from a cold start.
        """
        began, model_error = time.perf_counter(), self.options.model_error
        try:
            whole, fit = fit_without_outliers(
                frame, self._fit, known_light=self.known_light, rays=self.rays, model_error=model_error
            )
            result, p = fit.result, fit.result.parameters
            if result.status.usable and p and (left := fit.residual(whole, model_error)):
                result = replace(result, further_limit=left.hidden(p.scene))
        except Exception as error:
            if out_of_memory(error):
                raise
            log.debug("%s", frame.name, exc_info=True)
            whole, result = frame, status_from_exception(error, frame, self.plate_scale)
        known = self.known.get(self.grid(frame))
        misled = known is not None and known.changes(frame) and result.status in _MISLED
        if misled and not (result.status in _CONCLUSIVE and self.matches_reference(frame)):
            return self.with_warm_starts({}).complete(frame)
        result = replace(result, seconds=time.perf_counter() - began)
        return ProcessedFrame.from_fit(whole, result, frame.plate_scale or self.plate_scale)

    def estimate(self, frame: Frame, *, rough: bool = False) -> SceneEstimate | FitResult:
        """Find the stars and estimate the kernel, or say why not.

        Parameters
        ----------
        frame : Frame
        rough : bool
            Whether a fit of everything is to follow: the score estimate is then the normal with which the
            stars are found, and is not made.
        """
        score = self.kernel == SCORE  # any other estimate takes the place of the score's
        where, warm = (frame, self.optics(frame), self.scene), self.known.get(self.grid(frame))
        how: Any = {"rough": rough and score, "shape": score and not rough}
        start = steps.locate(*where, options=self.options, censored=self.censored, warm=warm, **how)
        if isinstance(start, FitResult) or (rough and score):
            return start
        return replace(start, estimate=steps.estimate(start, self.kernel, hold=self.options.hold))

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

    def warm_start(self, frame: Frame, choice: SceneChoice | None = None) -> WarmStart | None:
        """Return what one frame shows; None for one that is not sound, and where nothing is known by it."""
        choice = choice or self.choose_scene(frame)
        if choice is None:
            return None
        if warm := warm_start(self.optics(frame), choice, self.options):
            return warm
        # where the scene was given, nothing can change
        return WarmStart(choice.scene, choice.ambiguity_of_run) if self.scene == AUTO else None

    def choose_scene(self, frame: Frame) -> SceneChoice | None:
        """Return what scene a frame shows at first sight; None if it shows none."""

        def search(frame: Frame) -> SceneChoice | FitResult:
            data, warm = Data.of(frame, censored=self.censored), self.known.get(self.grid(frame))
            where = self.optics(frame), self.scene, data, self.options, warm
            return steps.search(frame, *where, rough=True)[0]

        try:
            found = search(frame)
            if self.known_light is not None and not isinstance(found, FitResult):
                light = self.known_light.of_frame(frame, found.start.parameters, found.start.otf)
                found = search(without_light(frame, light))
        except Exception as error:
            if out_of_memory(error):
                raise
            return None  # the frame itself will say why
        return None if isinstance(found, FitResult) or not found.start.deviance_dof < POOR else found

    def matches_reference(self, frame: Frame) -> bool:
        """Return whether a frame shows the reference frame's pair or field; its scene is certain then."""
        known, optics = self.known[self.grid(frame)], self.optics(frame)
        found = known.register(frame, Data.of(frame), optics, self.options.hold, rough=True)
        # a cut-out about one star does not show what else is in the frame
        return found is not None and found.parameters.scene.name != Star.name

    def optics(self, frame: Frame) -> Optics:
        """Return the optics on a frame's grid, at the scale the frame says it has."""
        key = self.grid(frame)
        if key in self.known and self.known[key].anchored is not None:
            return self.known[key].optics(frame)
        system = self._systems.get(key)
        if system is None:
            while len(self._systems) >= _SYSTEMS:
                self._systems.pop(next(iter(self._systems)), None)
            system = self._systems[key] = self.instrument.system(shape=key[0], plate_scale=key[1])
        return system

    def grid(self, frame: Frame) -> GridKey:
        """Return what frames have in common that share their optics: shape, and plate scale to 9 digits."""
        return frame.shape, float(f"{frame.plate_scale or self.plate_scale:.9g}")

    @functools.cached_property
    def known_light(self) -> KnownLight | None:
        """Return what of a frame is known beside the model."""
        return KnownLight.of(self.instrument)

    @property
    def priors(self) -> Priors:
        """Return the priors of every frame: the options', and the instrument's on fitted aberrations."""
        known = Priors.alike(self.instrument.aberrations, self.instrument.aberration_sigma)
        return known.joined(self.options.priors)

    def options_of(self, frame: Frame) -> FitOptions:
        """Return the options with what is known of this frame's jitter and optics."""
        priors = Priors() if self.prior is None else self.prior.of(frame.name, frame.digest)
        return replace(self.options, priors=self.priors.joined(priors))

    def _fit(self, frame: Frame) -> Fitted:
        """Locate, estimate, fit and diagnose a frame."""
        otf, start = self.optics(frame).nominal, self.estimate(frame, rough=not self.options.may_be_still)
        if isinstance(start, FitResult):
            return Fitted(start, otf)
        result = steps.fit(start, locus=self.locus, options=self.options_of(frame))
        result = steps.diagnose(frame, start, result, self.plate_scale)
        if self.scene == AUTO:
            result = flag_uneven_motion(result, otf)
        if self.prior is not None:
            result = result.remarked(*self.prior.remark_on(frame.name, frame.digest))
        if self.known_light is not None and result.parameters is not None:
            otf = self.optics(frame).otf(result.parameters.aberrations)  # of the light that is taken out
        return Fitted(result, otf, start.left_out)

    def _find_warm_starts(
        self, references: tuple[Item, ...], hdu: int | None, scene_only: bool
    ) -> dict[GridKey, WarmStart]:
        """Look at reference frames until one is in no doubt of its scene; at all for their scene only."""
        searched: dict[GridKey, list] = {}
        if scene_only and self.scene != AUTO:
            return {}
        for frame in read_calibrated(references, hdu, self.calibrate):
            seen = searched.setdefault(self.grid(frame), [])
            if scene_only or not any(choice.is_clear for _, choice in seen):
                choice = self.choose_scene(frame)
                seen += [] if choice is None else [(frame, choice)]
        starts = ((key, from_searched_frames(s, self.warm_start, scene_only)) for key, s in searched.items())
        return {key: start for key, start in starts if start is not None}
