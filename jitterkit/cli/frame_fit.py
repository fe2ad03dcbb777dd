"""Declare the options of the commands that fit frame by frame, and build the processor of the frames."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from jitterkit.cli import options
from jitterkit.cli.loci import locus_sizes
from jitterkit.cli.runtime import log, prepare_jax

if TYPE_CHECKING:
    from jitterkit.batch import FrameProcessor


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
    scene: options.SceneName = "auto"
    locus: Annotated[str, typer.Option(metavar="auto|NAME", help=_LOCUS)] = "auto"
    estimator: str = "score"
    prior: Path | None = None
    censored: options.Censored = False
    rays: bool = False
    background: options.Background = True
    model_error: options.ModelError = "0"
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
        prepare_jax(self.device, self.float32)
        from jitterkit.batch import FrameProcessor
        from jitterkit.instruments import load_instrument
        from jitterkit.refit import FitOptions, read_kernel_prior
        from jitterkit.trade import settings as trade

        telescope = load_instrument(self.instrument)
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
