"""Declare the options of the commands that fit frame by frame, and build the processor of the frames.

Reach for :class:`FrameFit`, and for :class:`Plan` where settings are chosen by what they cost
(``process --tolerance``, ``--budget`` and ``--explain``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from jitterkit.cli import options
from jitterkit.cli.loci import locus_sizes
from jitterkit.cli.quantities import parse_allowed, parse_time
from jitterkit.cli.runtime import log, open_instrument
from jitterkit.errors import ErrorCode, refuse_if
from jitterkit.report.words import angle_size

if TYPE_CHECKING:
    from jitterkit.batch import FrameProcessor
    from jitterkit.trade import Settings


_LOCUS = f"Jitter locus: auto (the simplest that the frame supports), {', '.join(locus_sizes())}."


@dataclass(frozen=True, kw_only=True)
class FrameFit:
    """Choose how each frame is fitted.

    Parameters
    ----------
    estimator : NAME
        Kernel estimator that starts the fit: score or mtf.
    prior : FILE
        Other data about the jitter: a table of 'estimate -o' (.ecsv; a frame's own row, identified by its
        pixels, is excluded), or a trace t,x,y (.csv, s and arcsec, good to 10 % of its rms), the same for
        every frame. Of a trace that is longer than an exposure, the first exposure is used; of two exposures
        or more, their mean and scatter.
    rays
        Find cosmic rays in the residuals of the fit, and fit again without their pixels.
    device : cpu|gpu
        Where to compute; by default on a GPU if JAX finds one.
    float32
        Compute in 32 bits, where speed matters more than the last digits.
    preset : fast|balanced|exact
        Accuracy of the model; 'jitterkit trade' measures its cost for your scene.
    """

    instrument: options.InstrumentName = "toliman"
    scene: str = "auto"
    locus: Annotated[str, typer.Option(metavar="auto|NAME", help=_LOCUS)] = "auto"
    estimator: str = "score"
    prior: Path | None = None
    censored: bool = False
    rays: bool = False
    background: bool = True
    model_error: str = "0"
    detector: options.Detector
    device: str | None = None
    float32: bool = False
    preset: str = "balanced"

    def processor(self) -> FrameProcessor:
        """Prepare JAX and return the processor of the frames.

        Raises
        ------
        ConfigurationError
            If the optics do not carry the preset, or there is no such instrument, device, preset or prior.
        """
        error = options.parse_model_error(self.model_error)
        telescope = open_instrument(self.instrument, device=self.device, float32=self.float32)
        from jitterkit.batch import FrameProcessor
        from jitterkit.refit import FitOptions, read_kernel_prior
        from jitterkit.trade import settings as trade

        settings = trade.preset(self.preset, telescope)
        fit = FitOptions(hold=options.held(self.background), model_error=error)
        modelled = settings.instrument(telescope)
        if settings != trade.Settings():
            modelled.system()  # refuses what its pupil does not carry before any frame is read
        exposure = self.detector.exposure or telescope.exposure
        prior = None if self.prior is None else read_kernel_prior(self.prior, exposure=exposure)
        if prior is not None and prior.remark:
            log(f"{self.prior}: {prior.remark}")
        return FrameProcessor(
            modelled,
            self.detector.metadata(),
            locus=self.locus,
            kernel=self.estimator,
            scene=self.scene,
            options=settings.options(telescope, fit),
            prior=prior,
            censored=self.censored,
            rays=self.rays,
        )


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Choose the settings of the model by what they cost.

    Parameters
    ----------
    tolerance : 1uas|10%
        Use the fastest settings whose model biases the separation of a frame by no more than this: an angle,
        or a share of its error. Three frames of the run are used to choose them.
    budget : 20ms
        Use the most exact settings with which a frame, fitted by itself, takes no longer than this on this
        machine. Three frames of the run are used to choose them.
    explain
        Report what the settings omit from the model, and the error that this causes.
    """

    tolerance: str | None = None
    budget: str | None = None
    explain: bool = False

    def check(self) -> None:
        """Refuse what is no angle, share or time, and two criteria at once.

        Raises
        ------
        ConfigurationError
        """
        problem = "--tolerance and --budget cannot be combined; give one of the two."
        refuse_if(self.tolerance is not None and self.budget is not None, ErrorCode.CONFLICT, problem)
        _parsed(self.tolerance, self.budget)

    def apply(
        self, processor: FrameProcessor, files: Sequence[Path], hdu: int | None, resumed: Path | None
    ) -> tuple[FrameProcessor, dict[str, Any] | None]:
        """Return the processor with the settings that its frames need, and how they were chosen.

        Parameters
        ----------
        processor : FrameProcessor
        files : sequence of Path
        hdu : int, optional
        resumed : Path, optional
            Directory of a run that is resumed with its own settings.

        Raises
        ------
        ConfigurationError
            If no settings meet the tolerance or budget, or no frame can be fitted.
        """
        asked = {"tolerance": self.tolerance, "budget": self.budget}
        if not any(asked.values()) and not self.explain:
            return processor, None
        from jitterkit.batch.configuration import describe
        from jitterkit.run.process import planned_before
        from jitterkit.trade import Settings

        before = None if resumed is None else planned_before(resumed)
        if before is not None and _parsed(**before["asked"]) == _parsed(**asked):
            log("using the settings that were chosen when the run began")
            return Settings(**before["settings"]).applied(processor), dict(before)
        settings = self._choose(processor, files, hdu)
        if not any(asked.values()):
            return processor, None
        return settings.applied(processor), {"asked": asked, "settings": describe(settings)}

    def _choose(self, processor: FrameProcessor, files: Sequence[Path], hdu: int | None) -> Settings:
        """Fit some frames, and log what is expected of the settings that suit them."""
        from jitterkit.trade.explain import explain
        from jitterkit.trade.plan import Planner
        from jitterkit.trade.worst_case import examples_of

        allowed, seconds = _parsed(self.tolerance, self.budget)
        log("fitting some frames to choose the settings ...")
        planner = Planner(*examples_of(files, processor, hdu))
        if allowed is not None:
            kind, size = allowed
            plan = planner.cheapest(size * planner.worst_case.sigma if kind == "error" else size)
        elif seconds is not None:
            plan = planner.within(seconds)
        else:
            plan = planner.as_they_are()
        loss, error = angle_size(plan.loss, 2), angle_size(planner.worst_case.sigma)
        cost = f"the model's omissions may bias the separation by {loss}, at an error of {error} per frame"
        log(f"{1e3 * plan.seconds:.3g} ms per frame; {cost}")
        for sentence in explain(planner.worst_case, plan) if self.explain else ():
            log(f"  {sentence}")
        return plan.settings


def _parsed(tolerance: str | None, budget: str | None) -> tuple[tuple[str, float] | None, float | None]:
    """Return the kind and size of the allowed loss, and the time of a frame [s]."""
    allowed = None if tolerance is None else parse_allowed(tolerance, "--tolerance", "error")
    return allowed, None if budget is None else parse_time(budget, "--budget")
