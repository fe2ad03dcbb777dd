"""The blur of frames of a star or a pair, with the optics of an instrument for a template."""

from __future__ import annotations

import copy
import math
from typing import Self

import numpy as np

from jitterkit.batch.diagnose import TOO_LOW, classify, scale_hint
from jitterkit.batch.plan import Batch
from jitterkit.batch.processor import FrameProcessor
from jitterkit.batch.records import BlurMeasurement, SceneEstimate
from jitterkit.batch.warm_start import SCORE
from jitterkit.forward import Parameters, expected_image
from jitterkit.frames import Frame, RawFrame
from jitterkit.likelihood import MISFIT, POOR, Misfit, pearson
from jitterkit.loci import Shaped
from jitterkit.refit import FitResult, Status
from jitterkit.refit.outliers import OUTLIERS, left_out
from jitterkit.scoring import fisher_scoring_without_prior

_STEPS = 20
"""At most, of the fit that a frame gets whose template is poor."""

_ELSE = (
    "If it shows more than a star or a pair, give --stars, --reference or --blind; if another telescope took "
    "it, -i."
)


class TemplateBlurEstimator:
    """Measures the blur of frames of a star or a pair, with the optics of an instrument for a template.

    Parameters
    ----------
    processor : FrameProcessor
        Its ``kernel`` names the estimator.
    """

    batch_size = 128
    threads: int | None = None

    def __init__(self, processor: FrameProcessor) -> None:
        self.processor = processor

    @property
    def name(self) -> str:
        """Return the name of the estimator."""
        return self.processor.kernel

    @property
    def plate_scale(self) -> float:
        """Return the instrument's plate scale, arcsec."""
        return self.processor.plate_scale

    def for_batch(self, batch: Batch, hdu: int | None) -> Self:
        """Return the estimator with what the reference frames of a batch show."""
        other = copy.copy(self)
        other.processor = self.processor.for_batch(batch, hdu)
        return other

    def calibrate(self, raw: RawFrame) -> Frame:
        """Calibrate a frame: many small steps of Python's, in which threads would hold each other up."""
        return self.processor.calibrate(raw)

    def complete(self, frame: Frame) -> BlurMeasurement | FitResult:
        """Measure a calibrated frame."""
        found = self.processor.estimate(frame)
        if isinstance(found, FitResult):
            return found
        remarks = [found.ambiguity, left_out(found.left_out)]
        if found.left_out:
            frame = frame.with_fields(flags=(*frame.flags, OUTLIERS))
        # what was registered to another frame is known to fit, if not too well
        registered, correlated = found.searched is None and self.name == SCORE, found.correlated
        if not registered or found.excess < -MISFIT:
            image = np.asarray(found.blurred())
            misfit = pearson(image, found.data)
            correlated = correlated or misfit.correlated_noise(image)
            too_low = misfit.chi2 - misfit.pixels < -MISFIT * misfit.spread
            if too_low and not correlated and found.data.model_variance is None:
                remarks.append(f"chi²/dof is {_per_pixel(misfit):.3g}. {TOO_LOW}")
            if not registered and not _per_pixel(misfit) <= POOR:
                best = _per_pixel(self._fitted(found))
                if not best <= POOR:
                    return self._poor(frame, found.parameters, misfit)
                remarks.append(
                    f"The template with this blur leaves chi²/dof of {_per_pixel(misfit):.3g}, with "
                    f"everything fitted {best:.3g}: the picture's residual is the template's."
                )
        message = " ".join(filter(None, [*remarks, correlated]))
        scale, scene = frame.plate_scale or self.plate_scale, found.parameters.scene.name
        return BlurMeasurement.from_estimate(frame, found.estimate, scale, found, message, scene)

    def _fitted(self, found: SceneEstimate) -> Misfit:
        """Return what is left with everything free: the template was fitted with a normal's shape."""
        shaped = found.parameters.with_locus(Shaped.near(found.parameters.locus.moments()))
        end, _ = fisher_scoring_without_prior(
            shaped, found.otf, found.data, self.processor.options.hold, _STEPS
        )
        return pearson(expected_image(end.parameters, found.otf), found.data)

    def _poor(self, frame: Frame, parameters: Parameters, misfit: Misfit) -> FitResult:
        """Say that no scene with a blur describes a frame, and why not where that can be determined."""
        message = f"{Status.POOR_FIT.value}: chi²/dof is {_per_pixel(misfit):.4g}."
        names = () if "background" in self.processor.options.hold else ("background",)
        poor = FitResult(
            Status.POOR_FIT,
            message,
            parameters=parameters,
            names=names,
            chi2=misfit.chi2,
            dof=misfit.pixels,
            residual=misfit.residual,
        )
        judged = classify(frame, poor, self.plate_scale)
        scale = scale_hint(frame, self.plate_scale)
        hints = [judged.message, "" if scale in judged.message else scale, _ELSE]
        return FitResult(Status.POOR_FIT, " ".join(filter(None, hints)), code=judged.code)


def _per_pixel(misfit: Misfit) -> float:
    return misfit.chi2 / misfit.pixels if misfit.pixels else math.nan
