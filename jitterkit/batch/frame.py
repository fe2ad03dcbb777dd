"""One frame from file to fit: the path that ``jitterkit process`` walks for each.

raw frame -> (region) -> electrons -> scene -> kernel estimate -> refit

A frame that cannot be used ends with a status and a sentence at whatever step stops it.
"""

from __future__ import annotations

import logging
import math
import time
from dataclasses import dataclass, replace

import numpy as np

from jitterkit.batch.estimated import Estimated
from jitterkit.batch.finder import Finder
from jitterkit.batch.verdict import (
    OUTLIERS,
    faint_companion,
    further_stars,
    judge,
    left_out,
    midpoint_pixel,
    position_angle,
)
from jitterkit.errors import out_of_memory
from jitterkit.frames import Frame, RawFrame
from jitterkit.likelihood import Data
from jitterkit.locate import Residual, most_outliers
from jitterkit.loci import locus_class
from jitterkit.refit import FitOptions, FitResult, KernelPrior, Priors, fit_best_locus, fit_locus
from jitterkit.refit.over_field import say_if_blur_varies
from jitterkit.refit.rays import find_rays
from jitterkit.scene import Stars

__all__ = ["Processed", "Processor"]

log = logging.getLogger(__name__)

_ROUNDS = 3
"""Times that a frame is fitted again without what does not belong: the first fit is bent by it."""

_UNUSED = "The prior holds this frame only and was not used."


@dataclass(frozen=True)
class Processed:
    """A frame and what became of it.

    Attributes
    ----------
    frame : Frame or None
        In electrons, cut to the region that was fitted; None if it never got so far.
    result : FitResult
    pixel : (float, float)
        Place of the star, or midpoint of the pair, ``(x, y)``, 0-based pixels of the original frame; NaN
        where none was fitted.
    pa : float
        Direction from A to B on the sky, north through east [deg]; NaN without a WCS or a pair.
    """

    frame: Frame | None
    result: FitResult
    pixel: tuple[float, float] = (math.nan, math.nan)
    pa: float = math.nan


@dataclass
class Processor(Finder):
    """Processes frames of one instrument: finds their stars and fits them.

    Attributes
    ----------
    locus : str
        ``"auto"`` or a name in ``LOCI``.
    prior : KernelPrior or None
        What other data say about the jitter: of each frame, whatever was not made of that frame itself.
        It joins the priors in the options.
    rays : bool
        Whether to look for cosmic rays in what a fit leaves, and to fit again without the pixels they hit.
    """

    locus: str = "auto"
    prior: KernelPrior | None = None
    rays: bool = False

    def __post_init__(self) -> None:
        """Refuse an unknown locus too."""
        super().__post_init__()
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

        Raises
        ------
        MemoryError or jax.errors.JaxRuntimeError
            If memory runs out.
        """
        frame = self.prepare(raw)
        return self.fit(frame) if isinstance(frame, Frame) else Processed(None, frame)

    def fit(self, frame: Frame) -> Processed:
        """Fit a calibrated frame; raises nothing but a lack of memory, which is not the frame's fault."""
        began = time.perf_counter()
        try:
            frame, result = self._fit(frame)
        except Exception as error:
            if out_of_memory(error):
                raise
            log.debug("%s", frame.name, exc_info=True)
            result = self.trouble(error, frame)
        result = replace(result, seconds=time.perf_counter() - began)
        scale = frame.plate_scale or self.instrument.plate_scale
        pixel, pa = midpoint_pixel(frame, result, scale), position_angle(frame, result, scale)
        return Processed(frame, result, pixel, pa)

    @property
    def priors(self) -> Priors:
        """Those of every frame: the options', and what the instrument says of aberrations that are fitted."""
        known = Priors.alike(self.instrument.aberrations, self.instrument.aberration_sigma)
        return known.joined(self.options.priors)

    def options_of(self, frame: Frame) -> FitOptions:
        """The options, and what is known of this frame's jitter and optics."""
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
            frame = replace(frame, mask=frame.mask | hit, flags=_with(frame.flags, flag))
            result, before = self._fit_once(frame)
        left = self._left(frame, result)
        if left is not None and result.parameters is not None and result.status.usable:
            result = replace(result, further_limit=left.hidden(result.parameters.scene))
        return frame, _remark_left_out(result, before + after)

    def _do_not_belong(self, frame: Frame, result: FitResult) -> tuple[np.ndarray, str]:
        """Pixels that a fit leaves over, and the flag that says so of the frame."""
        left = self._left(frame, result)
        if left is None or result.parameters is None:
            return np.zeros(frame.shape, bool), ""
        if self.rays and (rays := find_rays(result.residual)).any():
            return rays, "rays_masked"
        return left.outliers(float(result.parameters.background)), OUTLIERS

    def _left(self, frame: Frame, result: FitResult) -> Residual | None:
        """What a fit leaves of a frame; None if there is none."""
        if result.residual is None or result.image is None or result.parameters is None:
            return None
        data = Data.of(frame).without(~np.isfinite(result.residual))
        return Residual(data, result.image, self.optics(frame).nominal, result.parameters.locus)

    def _fit_once(self, frame: Frame) -> tuple[FitResult, int]:
        """Fit a frame, and say how many pixels the search for its stars left out."""
        found = self.estimate(frame, rough=True)
        if isinstance(found, FitResult):
            return found, 0
        estimate, where = found.estimate, (found.data, found.optics, found.parameters)
        options = self.options_of(frame)
        common = (*where, estimate.moments, found.otf, options)
        told = options.priors.terms or options.priors.if_free or options.priors.moments is not None
        if self.locus == "auto" and found.fit is not None and not told:
            result = found.fit
        elif self.locus == "auto":
            result = fit_best_locus(*common, estimate.covariance, sure=found.searched is None)
        else:
            result = fit_locus(self.locus, *common, sure=found.searched is None)
        result = self._compared_over_field(found, further_stars(replace(result, estimate=estimate)))
        result = judge(frame, result, self.instrument.plate_scale)
        result = faint_companion(result, found.optics.nominal)
        if found.doubt and result.status.usable:
            flags = (*result.flags, "maybe_pair")
            result = replace(result, message=f"{result.message} {found.doubt}", flags=flags)
        return self._remark_unused(frame, result), found.left_out

    def _compared_over_field(self, found: Estimated, result: FitResult) -> FitResult:
        """The result, with a remark where the stars of a field differ in their blur."""
        p = result.parameters
        if p is None or result.image is None or result.residual is None or p.scene.name != Stars.name:
            return result
        if not result.status.usable:
            return result
        data = found.data.without(~np.isfinite(result.residual))
        said = say_if_blur_varies(p, found.optics.otf(p.aberrations), result.image, data)
        if not said:
            return result
        return replace(result, message=f"{result.message} {said}", flags=_with(result.flags, "blur_varies"))

    def _remark_unused(self, frame: Frame, result: FitResult) -> FitResult:
        """The result, with a remark where a prior was given and nothing of it holds for this frame."""
        if self.prior is None or self.prior.of(frame.name, frame.digest) != Priors():
            return result
        message = f"{result.message or result.status.value} {_UNUSED}"
        return replace(result, message=message, flags=(*result.flags, "prior_unused"))


def _remark_left_out(result: FitResult, pixels: int) -> FitResult:
    """The result, with a remark where single pixels were left out."""
    if not pixels:
        return result
    message = f"{result.message or result.status.value} {left_out(pixels)}"
    return replace(result, message=message, flags=_with(result.flags, OUTLIERS))


def _with(flags: tuple[str, ...], flag: str) -> tuple[str, ...]:
    return tuple(dict.fromkeys((*flags, flag)))
