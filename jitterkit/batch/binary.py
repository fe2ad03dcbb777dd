"""The blur of a binary's frames, with the optics of an instrument for a template."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from jitterkit.batch.finder import SCORE, Finder, GridKey
from jitterkit.batch.measured import Measured
from jitterkit.batch.plan import Batch
from jitterkit.batch.repeats import Repeats
from jitterkit.batch.stream import cores
from jitterkit.batch.survey import Item, Survey
from jitterkit.batch.verdict import judge, scale_hint
from jitterkit.errors import FrameError, JitterkitError, UndeterminedError
from jitterkit.estimators import KernelEstimate
from jitterkit.estimators.compare import End, several
from jitterkit.estimators.repeat import Repeat
from jitterkit.forward import Parameters, expected_image
from jitterkit.frames import Frame, RawFrame
from jitterkit.likelihood import Data, Misfit, pearson
from jitterkit.loci import Shaped
from jitterkit.optics import OTF
from jitterkit.refit import POOR, FitResult, Status
from jitterkit.report.estimate_pictures import blurred_image, plot_estimate, template_images
from jitterkit.scoring import climb_a_little

__all__ = ["BinaryMeasurer"]

_STEPS = 20
"""At most, of the fit that a frame gets whose template is poor."""

_ELSE = "If it shows no binary, give --stars, --reference or --blind; if one of another telescope, -i."


class BinaryMeasurer:
    """Measures the blur of a binary's frames, with the optics of an instrument for a template.

    Parameters
    ----------
    finder : Finder
        Its ``kernel`` names the estimator.
    survey, repeats : Survey, Repeats, optional
        Tell what the frames of a batch have in common; by default of its own.
    """

    together = 128

    def __init__(self, finder: Finder, survey: Survey | None = None, repeats: Repeats | None = None) -> None:
        self.finder, self._survey, self._repeats = finder, survey, repeats
        self._lead: tuple[Item, ...] = ()
        self._known: Mapping[GridKey, Repeat] = {}

    @property
    def name(self) -> str:
        """Of the estimator."""
        return self.finder.kernel

    @property
    def threads(self) -> int:
        """One more than there are processors: each waits for Python now and then."""
        return cores() + 1

    def among(self, batch: Batch, hdu: int | None) -> BinaryMeasurer:
        """The same for the frames of a batch, with what its lead shows."""
        self._survey = self._survey or Survey(self.finder, hdu)
        self._repeats = self._repeats or Repeats(self.finder, hdu)
        one = BinaryMeasurer(self.finder, self._survey, self._repeats)
        one._lead, one._known = batch.lead, self._repeats.of(batch.lead) if self.name == SCORE else {}
        return one

    @property
    def handful(self) -> int:
        """As many as are compared together."""
        return several(self.finder.instrument.shape) if self.name == SCORE else 1

    def begin(self, raw: RawFrame) -> tuple[Frame, Data]:
        """Calibrate a frame: many small steps of Python's, in which threads would hold each other up."""
        frame = self.finder.calibrate(raw)
        return frame, Data.of(frame)

    def measure(self, begun: Sequence[tuple[Frame, Data]]) -> list[Callable[[], Measured | FitResult]]:
        """Compare those together that may repeat what others have shown."""
        ends: list[End | None] = [None] * len(begun)
        for grid, repeat in self._known.items():
            here = [place for place, (frame, _) in enumerate(begun) if self.finder.grid(frame) == grid]
            for place, end in zip(here, repeat.compare([begun[n][1] for n in here]), strict=True):
                ends[place] = end
        return [partial(self._measure, *one, end) for one, end in zip(begun, ends, strict=True)]

    def _measure(self, frame: Frame, data: Data, end: End | None) -> Measured | FitResult:
        return self._again(frame, data, end) or self._from_nothing(frame)

    def _again(self, frame: Frame, data: Data, end: End | None) -> Measured | None:
        """As a repetition of what others have shown, where it is one."""
        repeated = None if end is None else self._known[self.finder.grid(frame)].told(end)
        if repeated is None:
            return None
        parameters = repeated.parameters

        def look() -> tuple[Parameters, OTF]:
            return parameters, self.finder.optics(frame).otf(np.asarray(parameters.aberrations))

        estimate = replace(repeated.estimate, source=frame.name, digest=frame.digest)
        return self._measured(frame, data, estimate, look)

    @cached_property
    def _among_others(self) -> Finder:
        """With the optics that the lead shows; asked for by the first frame that needs them."""
        if self._survey is None or not self._lead:
            return self.finder
        known = self._survey.of(self._lead)
        if self.name == SCORE:  # what may be repeated is known better
            known = {grid: replace(shown, repeat=None) for grid, shown in known.items()}
        return replace(self.finder, known=known)

    def _from_nothing(self, frame: Frame) -> Measured | FitResult:
        odd = self.finder.grid(frame) in self._known  # one among many is not worth a look at the optics
        try:
            estimated = (self.finder if odd else self._among_others).estimate(frame)
        except (FrameError, UndeterminedError):
            raise
        except JitterkitError as error:  # as ``process`` calls it
            told = f"{Status.MISMATCH.value}: {error} {self._scale_hint(frame)}".rstrip()
            return FitResult.from_error(Status.MISMATCH, error, told)
        if isinstance(estimated, FitResult):
            return estimated
        data, parameters, otf, estimate = estimated
        misfit, message = pearson(blurred_image(estimate, parameters, otf), data), ""
        if not _per_pixel(misfit) <= POOR:
            best = _per_pixel(self._fitted(data, parameters, otf))
            if not best <= POOR:
                return self._poor(frame, parameters, misfit)
            message = (
                f"The template with this blur leaves chi²/dof of {_per_pixel(misfit):.3g}, with everything "
                f"fitted {best:.3g}: the picture's residual is the template's."
            )
        return self._measured(frame, data, estimate, lambda: (parameters, otf), message)

    def _measured(
        self,
        frame: Frame,
        data: Data,
        estimate: KernelEstimate,
        look: Callable[[], tuple[Parameters, OTF]],
        message: str = "",
    ) -> Measured:
        """With a picture for which template and optics are looked up when it is drawn."""
        scale = frame.plate_scale or self.finder.instrument.plate_scale

        def draw() -> list[Any]:
            sharp, blurred = template_images(estimate, *look())
            variance = np.asarray((blurred.clip(0) + data.offset) / data.weight)
            mask = ~np.isfinite(pearson(blurred, data).residual)
            return plot_estimate(
                estimate, frame.electrons, sharp, blurred, scale, variance=variance, mask=mask
            )

        return Measured.of(frame, estimate, scale, draw, message)

    def _scale_hint(self, frame: Frame) -> str:
        return scale_hint(frame, self.finder.instrument.plate_scale)

    def _fitted(self, data: Data, parameters: Parameters, otf: OTF) -> Misfit:
        """What is left with everything free: the template was fitted with a normal's shape."""
        shaped = parameters.with_locus(Shaped.near(parameters.locus.moments()))
        end, _ = climb_a_little(shaped, otf, data, self.finder.options.hold, _STEPS)
        return pearson(expected_image(end.parameters, otf), data)

    def _poor(self, frame: Frame, parameters: Parameters, misfit: Misfit) -> FitResult:
        """That no binary with a blur describes a frame, and why not where that can be told."""
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
