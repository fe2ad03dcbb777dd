"""The settings that a run needs, and no more: the cheapest that keep a promise about the separation.

Reach for :class:`Planner` with some frames of the run that have been fitted.  What settings put wrong is
foreseen for those frames (:mod:`jitterkit.trade.predict`), and what they cost (:mod:`jitterkit.trade.cost`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np

from jitterkit.batch import Processor
from jitterkit.batch.plan import FEWEST, count_frames
from jitterkit.batch.survey import read_items
from jitterkit.errors import ConfigurationError, JitterkitError
from jitterkit.refit.fit import unfinished
from jitterkit.trade.cost import work
from jitterkit.trade.fitting import TOGETHER, Fitting
from jitterkit.trade.ladder import RUNGS, can_be_had
from jitterkit.trade.predict import Example, Foresight
from jitterkit.trade.settings import Settings

__all__ = ["OWN", "Plan", "Planner"]

_MARGIN = 0.8
"""Share of what is allowed that a first-order forecast may use up."""

_UNFINISHED = 0.1
"""Share of what is allowed, or of an error, by which a fit may end before it has arrived."""

_LEFT_OUT = 0.1
"""Share of what is allowed that the aberrations which are left out may cost together."""

_ENDS = (1e-4, 1e-2)
"""Share of an error within which fits end where time is given, and where it is short."""

_SEEN = 1.0
"""Of its own scatter, from which on a misfit would be seen: a model that does not fit promises nothing."""

_LOOKED_AT, _TRIED = 3, 12
"""Frames that a plan is made for, spread over the run, and those that are tried to find as many."""

_TIMES, _SHORTER = 4, 0.95
"""Models that are timed until one keeps to a budget, and how much faster the next is to be than needed."""

OWN = Settings()
"""Those of the instrument itself."""

_NOTHING = Foresight(math.inf, math.inf, math.inf)
"""Of settings that cannot be had."""


@dataclass(frozen=True)
class Plan:
    """Settings, and what is expected of them.

    Attributes
    ----------
    settings : Settings
    loss : float
        Bias and added scatter of the separation of a frame, in squares, at most [arcsec].
    seconds : float
        Of a frame, measured.
    """

    settings: Settings
    loss: float
    seconds: float


class Planner:
    """Looks for settings on the ladder of :mod:`jitterkit.trade.ladder`.

    Parameters
    ----------
    examples : sequence of Example
        At least one; what is promised is promised of each.
    frames : int
        In the run, that share what is computed once.
    """

    def __init__(self, examples: Sequence[Example], frames: int = TOGETHER) -> None:
        self.examples, self.frames = tuple(examples), frames
        (first, *_) = examples
        self.instrument = replace(first.processor.instrument, shape=first.frame.shape)
        self._foreseen = {(one, OWN): one.foresee(OWN) for one in examples}  # what cannot be is told here

    @classmethod
    def of_files(cls, files: Sequence[Path], processor: Processor, hdu: int | None = None) -> Planner:
        """Look at frames spread over the files of a run.

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
        items = [
            (file, round(share * (counts[file] - 1))) for file, share in zip(chosen, shares, strict=True)
        ]
        spread = list(dict.fromkeys(items))
        examples: list[Example] = []
        for _, _, raw in read_items(spread, hdu):
            example = None if isinstance(raw, JitterkitError) else Example.of(raw, processor)
            examples += [] if example is None else [example]
            if len(examples) == _LOOKED_AT:
                break
        if not examples:
            raise ConfigurationError(
                f"None of {len(spread)} frames that were looked at can be fitted, so there is nothing to "
                "plan for; see what 'jitterkit process' without --tolerance and --budget says about them."
            )
        return cls(examples, round(len(files) * float(np.mean(list(counts.values())))))

    @property
    def sigma(self) -> float:
        """Least standard error of the separation that an example was fitted with [arcsec]."""
        return min(one.result.error("separation") for one in self.examples)

    def cheapest(self, allowed: float) -> Plan:
        """The cheapest settings whose loss stays below ``allowed`` [arcsec].

        Raises
        ------
        ConfigurationError
            If there are none.
        """
        tolerances, limit, every = self._tolerances(allowed), _MARGIN * allowed, self.by_work()
        for settings in every if tolerances else ():
            if self._holds(settings, limit, roughly=True) and self._holds(settings, limit):
                settings = replace(settings, tolerance=max(tolerances))
                leaner = replace(settings, without=self._without(_LEFT_OUT * allowed))
                settings = leaner if self._holds(leaner, limit) else settings
                try:
                    return Plan(settings, self.loss(settings), self.seconds(settings))
                except JitterkitError:  # with noise, so little a model describes no frame
                    continue
        least = max(self.loss(min(every, key=self._roughly)) / _MARGIN, self._unfinished / _UNFINISHED)
        raise ConfigurationError(
            f"No settings keep the separation of these frames within {1e6 * allowed:.2g} uas for certain; "
            f"allow {_rounded_up(1e6 * least)} uas or more."
        )

    def _tolerances(self, allowed: float) -> list[float]:
        """Those with which every example ends near enough."""
        sigma = max(self._foresee(one, OWN).sigma for one in self.examples)
        near = _UNFINISHED * allowed
        return [one for one in RUNGS["tolerance"] if one * sigma <= near] if self._unfinished <= near else []

    @property
    def _unfinished(self) -> float:
        """What fits may leave, however small the tolerance [arcsec]."""
        finest = min(RUNGS["tolerance"])
        return max(
            max(unfinished(one.truth.locus), finest) * self._foresee(one, OWN).sigma for one in self.examples
        )

    def within(self, seconds: float) -> Plan:
        """The settings of least loss that take at most so many seconds a frame, fitted one by one.

        Raises
        ------
        ConfigurationError
            If the cheapest take more.
        """
        share = seconds / self.seconds(OWN)
        for _ in range(_TIMES):
            best = self._best(share)
            if not math.isfinite(self.loss(best)):
                break  # so little a model describes no frame
            for tolerance in _ENDS:
                settings = replace(best, tolerance=tolerance)
                try:
                    spent = self.seconds(settings)
                except JitterkitError:
                    spent = math.inf
                if spent <= seconds:
                    return Plan(settings, self.loss(settings), spent)
            share *= min(_SHORTER * seconds / spent, _SHORTER)
        raise ConfigurationError(
            f"No settings that describe these frames fit one in {1e3 * seconds:.3g} ms on this machine; give "
            "more, or ask for the fastest by --preset fast."
        )

    def as_they_are(self) -> Plan:
        """What is expected of the settings that the examples were fitted with."""
        settings = replace(OWN, tolerance=self.examples[0].processor.options.tolerance)
        return Plan(settings, self.loss(settings), self.seconds(settings))

    def _best(self, share: float) -> Settings:
        """The settings of least loss that are at most ``share`` of the work of the instrument's own."""
        every = self.by_work()
        affordable = [settings for settings in every if self.work(settings) <= share] or every[:1]
        rest = []
        for region in dict.fromkeys(one.region for one in affordable):
            pads = sorted({one.pad or 0 for one in affordable if one.region == region}, reverse=True)
            geometries = (Settings(pad=pad, region=region) for pad in pads)
            widest = next(filter(self._can_be_had, geometries), None)  # less padding is never more exact
            rest += (
                []
                if widest is None
                else [one for one in affordable if (one.pad, one.region) == (widest.pad, region)]
            )
        return min(rest or affordable, key=self._roughly)

    def _can_be_had(self, settings: Settings) -> bool:
        return all(self._foresee(one, settings) is not _NOTHING for one in self.examples)

    def loss(self, settings: Settings) -> float:
        """Bias and added scatter, in squares, at most [arcsec]; infinite where they cannot be had."""
        return max(self._loss(one, settings) for one in self.examples)

    def _roughly(self, settings: Settings) -> float:
        return max(self._loss(one, settings, roughly=True) for one in self.examples)

    def seconds(self, settings: Settings) -> float:
        """Of a frame, measured: one at a time, as in a run of so many.

        Raises
        ------
        JitterkitError
            If an example cannot be fitted so.
        """
        raws, processor = [one.raw for one in self.examples], settings.applied(self.examples[0].processor)
        few = self.frames < FEWEST  # each of which looks at the optics itself
        fitting = Fitting(processor) if few else Fitting.anchored(processor, raws[0], self.frames)
        return fitting.timed(raws)[1]

    def work(self, settings: Settings) -> float:
        """Of a frame, as a share of that of the instrument's own settings."""
        beside = (self.instrument, len(self.examples[0].result.names), self.frames)
        return work(settings, *beside) / work(OWN, *beside)

    def by_work(self) -> list[Settings]:
        """Rungs of what the model of a frame is made of, with each other, from the cheapest on."""
        axes = {
            name: [value for value in RUNGS[name] if can_be_had(name, value, self.instrument)]
            for name in ("pad", "samples", "binning", "region")
        }
        axes["samples"].append(None)
        axes["region"] = [side for side in axes["region"] if side < max(self.instrument.shape)] + [None]
        axes["binning"] = axes["binning"] or [1]
        every = (Settings(**dict(zip(axes, values, strict=True))) for values in product(*axes.values()))
        return sorted(every, key=self.work)

    def _holds(self, settings: Settings, limit: float, *, roughly: bool = False) -> bool:
        return all(self._loss(one, settings, limit, roughly) <= limit for one in self.examples)

    def _loss(
        self, one: Example, settings: Settings, limit: float = math.inf, roughly: bool = False
    ) -> float:
        """Bias and added scatter, in squares [arcsec]; infinite where there is no such model, or it misfits.

        Something above ``limit`` where the scatter alone is.  Roughly, pupil and spectrum do to every
        geometry what they do to the instrument's own.
        """
        excess = self._excess(one, settings.region)
        if excess > limit:
            return excess
        seen = self._rough(one, settings) if roughly else self._foresee(one, settings)
        return math.hypot(seen.bias, excess) if seen.misfit < _SEEN else math.inf

    def _rough(self, one: Example, settings: Settings) -> Foresight:
        geometry = self._foresee(one, Settings(pad=settings.pad, region=settings.region))
        coarse = self._foresee(one, Settings(binning=settings.binning))
        if coarse is _NOTHING:  # a coarse pupil does not carry the instrument's own padding, but some less
            return self._foresee(one, settings)
        if geometry.misfit >= _SEEN:
            return geometry
        few, own = self._foresee(one, Settings(samples=settings.samples)), self._foresee(one, OWN)
        bias = geometry.bias + coarse.bias + few.bias - 2 * own.bias
        return Foresight(bias, own.sigma, max(geometry.misfit, coarse.misfit, few.misfit))

    def _excess(self, one: Example, region: int | None) -> float:
        """Scatter that the light outside of a region would have spared [arcsec]."""
        cut, whole = (self._foresee(one, settings).sigma for settings in (Settings(region=region), OWN))
        return math.sqrt(max(cut**2 - whole**2, 0.0))

    def _foresee(self, one: Example, settings: Settings) -> Foresight:
        key = (one, settings)
        if key not in self._foreseen:
            try:
                self._foreseen[key] = one.foresee(settings)
            except JitterkitError:
                self._foreseen[key] = _NOTHING
        return self._foreseen[key]

    def _without(self, limit: float) -> tuple[str, ...]:
        """Aberrations that may be left out, together for less than ``limit`` [arcsec]."""
        names: tuple[str, ...] = ()
        alone = {name: self.cost_of((name,)) for name in self.instrument.aberrations}
        for name in sorted(alone, key=lambda one: alone[one]):
            if alone[name] > limit or self.cost_of((*names, name)) > limit:
                break
            names = (*names, name)
        return tuple(name for name in self.instrument.aberrations if name in names)

    def cost_of(self, names: tuple[str, ...]) -> float:
        """What it may do to the separation to leave out aberrations [arcsec]."""
        return max(one.without(names) for one in self.examples)


def _rounded_up(value: float) -> str:
    """With two digits, the second not too small.

    >>> _rounded_up(2.31), _rounded_up(0.0400001)
    ('2.4', '0.041')
    """
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return f"{math.ceil(value / unit) * unit:.2g}"
