"""What is expected of settings, at the worst of some frames.

Reach for :func:`examples_of` to fit frames spread over the files of a run, and give them to
:class:`Outlook`.  What it is asked again it remembers.
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
from jitterkit.trade.predict import Example, Foresight
from jitterkit.trade.settings import Settings

_SEEN = 1.0
"""Of its own scatter, from which on a misfit would be seen: a model that does not fit promises nothing."""

OWN = Settings()
"""Those of the instrument itself."""

_NOTHING = Foresight(math.inf, math.inf, math.inf, math.inf)
"""Of settings that cannot be had."""


class Outlook:
    """Expected effect of settings on the separation of every example.

    Parameters
    ----------
    examples : sequence of Example
        At least one; what is said holds for each.

    Raises
    ------
    JitterkitError
        If what fitted an example does not determine its parameters.
    """

    def __init__(self, examples: Sequence[Example]) -> None:
        self.examples = tuple(examples)
        (first, *_) = examples
        self.instrument = replace(first.processor.instrument, shape=first.frame.shape)
        self._foreseen = {(one, OWN): one.foresee(OWN) for one in examples}  # what cannot be is told here

    @property
    def sigma(self) -> float:
        """Least standard error of the separation that an example was fitted with [arcsec]."""
        return min(one.result.error("separation") for one in self.examples)

    def loss(self, settings: Settings) -> float:
        """Bias and added scatter, in squares, and what jitter that is left out may cost, at most [arcsec].

        Infinite where the settings cannot be had.
        """
        return self._left_out(settings) + max(self._loss(one, settings) for one in self.examples)

    def rough_loss(self, settings: Settings) -> float:
        """The same, where pupil and spectrum do to every geometry what they do to the instrument's own."""
        return self._left_out(settings) + max(
            self._loss(one, settings, roughly=True) for one in self.examples
        )

    def holds(self, settings: Settings, limit: float, *, roughly: bool = False) -> bool:
        """Return whether the loss, or the rough one, is at most ``limit`` [arcsec]."""
        limit -= self._left_out(settings)
        return all(self._loss(one, settings, limit, roughly) <= limit for one in self.examples)

    def can_be_had(self, settings: Settings) -> bool:
        """Return whether every example can be modelled so."""
        return all(self._foresee(one, settings) is not _NOTHING for one in self.examples)

    def cost_of(self, names: tuple[str, ...], settings: Settings = OWN) -> float:
        """Return what it may do to the separation to leave out aberrations [arcsec]."""
        return max(one.without(names, settings) for one in self.examples)

    def cost_of_jitter(self, settings: Settings = OWN) -> float:
        """The same of jitter that a frame does not show; infinite where no example may do without."""
        still = [one for one in self.examples if one.still]
        return max((one.without_jitter(settings) for one in still), default=math.inf)

    def convergence_error(self, tolerance: float) -> float:
        """By how much fits may end before they have arrived [arcsec].

        Parameters
        ----------
        tolerance : float
            Step, in standard errors, below which a fit ends.
        """
        varied = bool(self.instrument.aberrations)
        return max(
            convergence_error(tolerance, one.truth.locus, varied) * self._foresee(one, OWN).sigma
            for one in self.examples
        )

    def _left_out(self, settings: Settings) -> float:
        """Return what jitter may cost that is not fitted [arcsec]."""
        return 0.0 if settings.jitter == "always" else self.cost_of_jitter(settings)

    def _loss(
        self, one: Example, settings: Settings, limit: float = math.inf, roughly: bool = False
    ) -> float:
        """Bias and added scatter, in squares [arcsec]; infinite where there is no such model, or it misfits.

        Something above ``limit`` where the scatter alone is.
        """
        excess = self._excess(one, settings.region)
        if excess > limit:
            return excess
        seen = self._rough(one, settings) if roughly else self._foresee(one, settings)
        unseen = 0.0 if settings.jitter == "always" else DETECTED / seen.scatter
        # at worst what is wrong with the model looks like the jitter that it lacks
        misfit = (math.sqrt(max(seen.misfit, 0.0)) + math.sqrt(unseen)) ** 2
        return math.hypot(seen.bias, excess) if misfit < _SEEN else math.inf

    def _rough(self, one: Example, settings: Settings) -> Foresight:
        geometry = self._foresee(one, Settings(pad=settings.pad, region=settings.region))
        coarse = self._foresee(one, Settings(binning=settings.binning))
        if coarse is _NOTHING:  # a coarse pupil does not carry the instrument's own padding, but some less
            return self._foresee(one, settings)
        if geometry.misfit >= _SEEN:
            return geometry
        few, own = self._foresee(one, Settings(samples=settings.samples)), self._foresee(one, OWN)
        bias = geometry.bias + coarse.bias + few.bias - 2 * own.bias
        misfit = max(geometry.misfit, coarse.misfit, few.misfit)
        return Foresight(bias, own.sigma, misfit, geometry.scatter)

    def _excess(self, one: Example, region: int | None) -> float:
        """Scatter that the light outside of a region would have spared [arcsec]."""
        cut, whole = (self._foresee(one, settings).sigma for settings in (Settings(region=region), OWN))
        return math.sqrt(max(cut**2 - whole**2, 0.0))

    def _foresee(self, one: Example, settings: Settings) -> Foresight:
        key = one, settings = one, replace(settings, jitter="always")
        if key not in self._foreseen:
            try:
                self._foreseen[key] = one.foresee(settings)
            except JitterkitError:
                self._foreseen[key] = _NOTHING
        return self._foreseen[key]


_LOOKED_AT, _TRIED = 3, 12
"""Frames that a plan is made for, spread over the run, and those that are tried to find as many."""


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
        In the run, by those in the files that were looked at.

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
        raise ConfigurationError(
            ErrorCode.TOO_FEW,
            f"None of {len(spread)} frames that were looked at can be fitted, so there is nothing to "
            "plan for; see what 'jitterkit process' without --tolerance and --budget says about them.",
        )
    return examples, round(len(files) * float(np.mean(list(counts.values()))))
