"""The blur of frames of a star or a pair, with the optics of an instrument for a template."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from jitterkit.batch.estimated import Estimated
from jitterkit.batch.finder import SCORE, Finder
from jitterkit.batch.measured import Measured
from jitterkit.batch.plan import Batch
from jitterkit.batch.survey import Survey
from jitterkit.batch.verdict import OUTLIERS, judge, left_out, scale_hint
from jitterkit.errors import FrameError, JitterkitError, UndeterminedError
from jitterkit.forward import Parameters, expected_image
from jitterkit.frames import Frame, RawFrame
from jitterkit.likelihood import Data, Misfit, pearson
from jitterkit.loci import Shaped
from jitterkit.optics import OTF
from jitterkit.refit import POOR, FitResult, Status
from jitterkit.report.estimate_pictures import blurred_image, plot_estimate, template_images
from jitterkit.scoring import climb_a_little

__all__ = ["OpticsMeasurer"]

_STEPS = 20
"""At most, of the fit that a frame gets whose template is poor."""

_ELSE = (
    "If it shows more than a star or a pair, give --stars, --reference or --blind; if another telescope took "
    "it, -i."
)


class OpticsMeasurer:
    """Measures the blur of frames of a star or a pair, with the optics of an instrument for a template.

    Parameters
    ----------
    finder : Finder
        Its ``kernel`` names the estimator.
    survey : Survey, optional
        Tells what the frames of a batch have in common; by default one of its own.
    """

    together = 128
    threads: int | None = None

    def __init__(self, finder: Finder, survey: Survey | None = None) -> None:
        self.finder, self._survey = finder, survey

    @property
    def name(self) -> str:
        """Of the estimator."""
        return self.finder.kernel

    def among(self, batch: Batch, hdu: int | None) -> OpticsMeasurer:
        """The same for the frames of a batch, with what its lead shows."""
        self._survey = self._survey or Survey(self.finder, hdu)
        return OpticsMeasurer(replace(self.finder, known=self._survey.of(batch)), self._survey)

    def begin(self, raw: RawFrame) -> Frame:
        """Calibrate a frame: many small steps of Python's, in which threads would hold each other up."""
        return self.finder.calibrate(raw)

    def measure(self, frame: Frame) -> Measured | FitResult:
        """Measure a calibrated frame."""
        try:
            estimated = self.finder.estimate(frame)
        except (FrameError, UndeterminedError):
            raise
        except JitterkitError as error:  # as ``process`` calls it
            told = f"{Status.MISMATCH.value}: {error} {self._scale_hint(frame)}".rstrip()
            return FitResult.from_error(Status.MISMATCH, error, told)
        if isinstance(estimated, FitResult):
            return estimated
        message = estimated.doubt
        if estimated.left_out:
            frame = frame.told(flags=(*frame.flags, OUTLIERS))
            message = " ".join(filter(None, [message, left_out(estimated.left_out)]))
        if estimated.searched is not None or self.name != SCORE:
            data, parameters, otf = estimated.data, estimated.parameters, estimated.otf
            misfit = pearson(blurred_image(estimated.estimate, parameters, otf), data)
            if not _per_pixel(misfit) <= POOR:
                best = _per_pixel(self._fitted(data, parameters, otf))
                if not best <= POOR:
                    return self._poor(frame, parameters, misfit)
                rest = (
                    f"The template with this blur leaves chi²/dof of {_per_pixel(misfit):.3g}, with "
                    f"everything fitted {best:.3g}: the picture's residual is the template's."
                )
                message = " ".join(filter(None, [message, rest]))
        return self._measured(frame, estimated, message)

    def _measured(self, frame: Frame, estimated: Estimated, message: str) -> Measured:
        """With a picture for which the optics are expanded when it is drawn."""
        scale = frame.plate_scale or self.finder.instrument.plate_scale
        estimate, data = estimated.estimate, estimated.data

        def draw() -> list[Any]:
            sharp, blurred = template_images(estimate, estimated.parameters, estimated.otf)
            variance = np.asarray((blurred.clip(0) + data.offset) / data.weight)
            mask = ~np.isfinite(pearson(blurred, data).residual)
            return plot_estimate(
                estimate, frame.electrons, sharp, blurred, scale, variance=variance, mask=mask
            )

        return Measured.of(frame, estimate, scale, draw, message, estimated.parameters.scene.name)

    def _scale_hint(self, frame: Frame) -> str:
        return scale_hint(frame, self.finder.instrument.plate_scale)

    def _fitted(self, data: Data, parameters: Parameters, otf: OTF) -> Misfit:
        """What is left with everything free: the template was fitted with a normal's shape."""
        shaped = parameters.with_locus(Shaped.near(parameters.locus.moments()))
        end, _ = climb_a_little(shaped, otf, data, self.finder.options.hold, _STEPS)
        return pearson(expected_image(end.parameters, otf), data)

    def _poor(self, frame: Frame, parameters: Parameters, misfit: Misfit) -> FitResult:
        """That no scene with a blur describes a frame, and why not where that can be told."""
        said = f"{Status.POOR_FIT.value}: chi²/dof is {_per_pixel(misfit):.4g}."
        names = () if "background" in self.finder.options.hold else ("background",)
        poor = FitResult(
            Status.POOR_FIT,
            said,
            parameters=parameters,
            names=names,
            chi2=misfit.chi2,
            dof=misfit.pixels,
            residual=misfit.residual,
        )
        judged = judge(frame, poor, self.finder.instrument.plate_scale)
        scale = self._scale_hint(frame)
        hints = [judged.message, "" if scale in judged.message else scale, _ELSE]
        return FitResult(Status.POOR_FIT, " ".join(filter(None, hints)), code=judged.code)


def _per_pixel(misfit: Misfit) -> float:
    return misfit.chi2 / misfit.pixels if misfit.pixels else math.nan
