"""The expected effect of settings, in the worst of some frames.

Reach for :func:`examples_of` to fit frames spread over the files of a run, and give them to
:class:`WorstCase`, which caches its forecasts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from jitterkit.batch import FrameProcessor
from jitterkit.batch.plan import FrameReader, count_frames
from jitterkit.errors import ConfigurationError, ErrorCode, JitterkitError
from jitterkit.refit.choose import DETECTED
from jitterkit.refit.fit import convergence_error
from jitterkit.trade.predict import BiasForecast, Example
from jitterkit.trade.settings import Settings

_SEEN = 1.0
"""Misfit, in units of its own scatter, from which a model is refused: it would not fit the frames."""

OWN = Settings()
"""The settings of the instrument itself."""

_NOTHING = BiasForecast(math.inf, math.inf, math.inf, math.inf)
"""The forecast of settings that are not available."""


class WorstCase:
    """Forecast the effect of settings on the separation of every example.

    Parameters
    ----------
    examples : sequence of Example
        At least one; a result holds for each.

    Raises
    ------
    JitterkitError
        If what fitted an example does not determine its parameters.
    """

    def __init__(self, examples: Sequence[Example]) -> None:
        self.examples = tuple(examples)
        (first, *_) = examples
        self.instrument = replace(first.processor.instrument, shape=first.frame.shape)
        self._forecasts = {(one, OWN): one.forecast(OWN) for one in examples}  # raises here if there is none

    @property
    def sigma(self) -> float:
        """Return the least standard error of the separation in the fits of the examples [arcsec]."""
        return min(one.result.error("separation") for one in self.examples)

    def loss(self, settings: Settings, *, roughly: bool = False) -> float:
        """Return the largest loss: bias and added scatter, in squares, and jitter not fitted [arcsec].

        Infinite where the settings are not available.  The rough loss is that if pupil and spectrum have the
        same effect in every geometry.
        """
        losses = (self._loss(one, settings, roughly=roughly) for one in self.examples)
        return self._left_out(settings) + max(losses)

    def holds(self, settings: Settings, limit: float, *, roughly: bool = False) -> bool:
        """Return whether the loss, or the rough one, is at most ``limit`` [arcsec]."""
        limit -= self._left_out(settings)
        return all(self._loss(one, settings, limit, roughly) <= limit for one in self.examples)

    def can_be_had(self, settings: Settings) -> bool:
        """Return whether every example can be modelled so."""
        return all(self._forecast(one, settings) is not _NOTHING for one in self.examples)

    def cost_of(self, names: tuple[str, ...], settings: Settings = OWN) -> float:
        """Return the possible change of the separation if aberrations are left out [arcsec]."""
        return max(one.without(names, settings) for one in self.examples)

    def cost_of_jitter(self, settings: Settings = OWN) -> float:
        """Return the loss [arcsec] if undetected jitter is left out; infinite if every example shows some."""
        still = [one for one in self.examples if one.still]
        return max((one.without_jitter(settings) for one in still), default=math.inf)

    def convergence_error(self, tolerance: float) -> float:
        """Return the largest convergence error of the separation [arcsec].

        Parameters
        ----------
        tolerance : float
            Step, in standard errors, below which a fit ends.
        """
        varied = bool(self.instrument.aberrations)
        return max(
            convergence_error(tolerance, one.truth.locus, varied) * self._forecast(one, OWN).sigma
            for one in self.examples
        )

    def _left_out(self, settings: Settings) -> float:
        """Return the loss by jitter that is not fitted [arcsec]."""
        return 0.0 if settings.jitter == "always" else self.cost_of_jitter(settings)

    def _loss(
        self, one: Example, settings: Settings, limit: float = math.inf, roughly: bool = False
    ) -> float:
        """Return bias and added scatter, in squares [arcsec]; infinite where no such model fits.

        Where the scatter alone exceeds ``limit``, return the scatter.
        """
        excess = self._excess(one, settings.region)
        if excess > limit:
            return excess
        seen = self._rough(one, settings) if roughly else self._forecast(one, settings)
        unseen = 0.0 if settings.jitter == "always" else DETECTED / seen.scatter
        # at worst what is wrong with the model looks like the jitter that it lacks
        misfit = (math.sqrt(max(seen.misfit, 0.0)) + math.sqrt(unseen)) ** 2
        return math.hypot(seen.bias, excess) if misfit < _SEEN else math.inf

    def _rough(self, one: Example, settings: Settings) -> BiasForecast:
        geometry = self._forecast(one, Settings(pad=settings.pad, region=settings.region))
        coarse = self._forecast(one, Settings(binning=settings.binning))
        if coarse is _NOTHING:  # a coarse pupil does not carry the instrument's own padding, but some less
            return self._forecast(one, settings)
        if geometry.misfit >= _SEEN:
            return geometry
        few, own = self._forecast(one, Settings(samples=settings.samples)), self._forecast(one, OWN)
        bias = geometry.bias + coarse.bias + few.bias - 2 * own.bias
        misfit = max(geometry.misfit, coarse.misfit, few.misfit)
        return BiasForecast(bias, own.sigma, misfit, geometry.scatter)

    def _excess(self, one: Example, region: int | None) -> float:
        """Return the scatter that is added by excluding the light outside of a region [arcsec]."""
        cut, whole = (self._forecast(one, settings).sigma for settings in (Settings(region=region), OWN))
        return math.sqrt(max(cut**2 - whole**2, 0.0))

    def _forecast(self, one: Example, settings: Settings) -> BiasForecast:
        key = one, settings = one, replace(settings, jitter="always")
        if key not in self._forecasts:
            try:
                self._forecasts[key] = one.forecast(settings)
            except JitterkitError:
                self._forecasts[key] = _NOTHING
        return self._forecasts[key]


_LOOKED_AT, _TRIED = 3, 12
"""Frames on which a plan is based, spread over the run, and those that are tried to find as many."""


def examples_of(
    files: Sequence[Path], processor: FrameProcessor, hdu: int | None = None
) -> tuple[list[Example], int]:
    """Fit frames spread over the files of a run, until there are enough.

    Parameters
    ----------
    files : sequence of Path
        At least one.
    processor : FrameProcessor
    hdu : int, optional
        Of FITS files.

    Returns
    -------
    examples : list of Example
        Of the frames that can be fitted, at least one.
    frames : int
        In the run, estimated from the files that were read.

    Raises
    ------
    ConfigurationError
        If none of them can be fitted.
    """
    stride = _TRIED // _LOOKED_AT
    shares = np.linspace(0, 1, _TRIED)
    shares = np.concatenate([shares[start::stride] for start in range(stride)])  # the first are far apart
    chosen = [files[round(share * (len(files) - 1))] for share in shares]
    counts = {file: count_frames(file, hdu) for file in dict.fromkeys(chosen)}
    items = [(file, round(share * (counts[file] - 1))) for file, share in zip(chosen, shares, strict=True)]
    spread = list(dict.fromkeys(items))
    examples: list[Example] = []
    with FrameReader(hdu) as reader:
        for _, _, raw in reader.read(spread):
            example = None if isinstance(raw, JitterkitError) else Example.of(raw, processor)
            examples += [] if example is None else [example]
            if len(examples) == _LOOKED_AT:
                break
    if not examples:
        problem = f"None of {len(spread)} frames that were tried can be fitted"
        remedy = "see what 'jitterkit process' without --tolerance and --budget says about them"
        raise ConfigurationError(ErrorCode.TOO_FEW, f"{problem}, so there is nothing to plan for; {remedy}.")
    return examples, round(len(files) * float(np.mean(list(counts.values()))))
