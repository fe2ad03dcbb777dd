"""Plan the settings of a run: the cheapest that keep the error of the separation below a limit.

Reach for :class:`Planner` with some frames of the run that have been fitted.  The loss by settings is
forecast for those frames (:mod:`jitterkit.trade.worst_case`); their cost is counted and not measured
(:func:`work`), to put them in order before any is tried.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product

from jitterkit.batch.plan import PLAN
from jitterkit.errors import ConfigurationError, ErrorCode, JitterkitError
from jitterkit.instruments import Instrument
from jitterkit.optics import Grid
from jitterkit.trade.grid import GRID, can_be_had
from jitterkit.trade.methods import FRAMES_PER_ANCHOR, Fitting
from jitterkit.trade.predict import Example
from jitterkit.trade.settings import Settings, own_pad
from jitterkit.trade.worst_case import OWN, WorstCase

_FRAME = 1e5
"""Work for a frame beside its model: that of 32 x 32 padded samples of a hundred parameters."""


def work(settings: Settings, instrument: Instrument, parameters: int, frames: int) -> float:
    """Count the operations for a frame, up to a factor.

    Parameters
    ----------
    settings : Settings
    instrument : Instrument
    parameters : int
        That are fitted, each a derivative of the padded image.
    frames : int
        In the run: they share what is computed once, and of few each computes it.

    Returns
    -------
    work : float

    Notes
    -----
    A fit is transforms of the padded frame, one a parameter; a look at the optics is transforms of the pupil,
    one for each wavelength and aberration.  Within a quarter of the times of 17 settings, of 48 x 48 to
    320 x 320 padded pixels and 10 to 15 parameters.
    """
    ny, nx = (min(n, settings.region or n) for n in instrument.shape)
    pad = own_pad(instrument) if settings.pad is None else settings.pad
    padded = math.prod(Grid((ny, nx), instrument.plate_scale, pad).fine_shape)
    fit = _FRAME + (parameters - len(settings.without)) * padded
    if instrument.pupil is None or instrument.spectrum is None:
        return fit
    rays = instrument.pupil.opd.size / settings.binning**2 * (1 + len(instrument.aberrations))
    look = rays * (settings.samples or len(instrument.spectrum.wavelengths))
    return fit + look / (min(frames, FRAMES_PER_ANCHOR) if frames >= PLAN.fewest else 1)


_MARGIN = 0.8
"""Share of the allowed loss that a first-order forecast may use."""

_CONVERGENCE_SHARE = 0.1
"""Share of the allowed loss that the convergence error may use."""

_LEFT_OUT = 0.1
"""Share of the allowed loss that all aberrations left out may cost together."""

_ENDS = (1e-4, 1e-2)
"""Share of an error within which fits end where time is given, and where it is short."""

_TIMES, _SHORTER = 4, 0.95
"""Models that are timed until one keeps to a budget, and how much faster the next is to be than needed."""


@dataclass(frozen=True)
class Plan:
    """Hold settings, with their expected loss and time.

    Attributes
    ----------
    settings : Settings
    loss : float
        Of the separation of a frame, at most: :meth:`WorstCase.loss` [arcsec].
    seconds : float
        Of a frame, measured.
    """

    settings: Settings
    loss: float
    seconds: float


class Planner:
    """Search for settings on the grid of :mod:`jitterkit.trade.grid`.

    Parameters
    ----------
    examples : sequence of Example
        At least one; the limit is kept for each.
    frames : int
        In the run, that share what is computed once.
    """

    def __init__(self, examples: Sequence[Example], frames: int = FRAMES_PER_ANCHOR) -> None:
        self.worst_case, self.frames = WorstCase(examples), frames

    def cheapest(self, allowed: float) -> Plan:
        """Return the cheapest settings whose loss stays below ``allowed`` [arcsec].

        Raises
        ------
        ConfigurationError
            If there are none.
        """
        worst_case, limit, every = self.worst_case, _MARGIN * allowed, self.by_work()
        most = _CONVERGENCE_SHARE * allowed
        tolerances = [one for one in GRID["tolerance"] if worst_case.convergence_error(one) <= most]
        for settings in every if tolerances else ():
            if worst_case.holds(settings, limit, roughly=True) and worst_case.holds(settings, limit):
                settings = self._drop_aberrations(replace(settings, tolerance=max(tolerances)), allowed)
                seen = replace(settings, jitter="seen")  # none in frames that show none
                settings = seen if worst_case.holds(seen, limit) else settings
                try:
                    return Plan(settings, worst_case.loss(settings), self.seconds(settings))
                except JitterkitError:  # with noise, so little a model describes no frame
                    continue
        convergence_error = worst_case.convergence_error(min(GRID["tolerance"]))
        loss = worst_case.loss(min(every, key=partial(worst_case.loss, roughly=True)))
        least = max(loss / _MARGIN, convergence_error / _CONVERGENCE_SHARE)
        limits = f"within {1e6 * allowed:.2g} uas for certain; allow {_rounded_up(1e6 * least)} uas or more"
        problem = f"No settings keep the separation of these frames {limits}."
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, problem)

    def within(self, seconds: float) -> Plan:
        """Return the settings of least loss that take at most so many seconds a frame, fitted one by one.

        Raises
        ------
        ConfigurationError
            If the cheapest take more.
        """
        share = seconds / self.seconds(OWN)
        for _ in range(_TIMES):
            best = self._best(share)
            if not math.isfinite(self.worst_case.loss(best)):
                break  # so little a model describes no frame
            for tolerance in _ENDS:
                settings = replace(best, tolerance=tolerance)
                try:
                    spent = self.seconds(settings)
                except JitterkitError:
                    spent = math.inf
                if spent <= seconds:
                    return Plan(settings, self.worst_case.loss(settings), spent)
            share *= min(_SHORTER * seconds / spent, _SHORTER)
        problem = f"No settings that describe these frames fit one in {1e3 * seconds:.3g} ms on this machine"
        remedy = "give more, or ask for the fastest by --preset fast"
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, f"{problem}; {remedy}.")

    def as_they_are(self) -> Plan:
        """Return the plan with the settings that the examples were fitted with."""
        settings = replace(OWN, tolerance=self.worst_case.examples[0].processor.options.tolerance)
        return Plan(settings, self.worst_case.loss(settings), self.seconds(settings))

    def _best(self, share: float) -> Settings:
        """Return the settings of least loss with at most ``share`` of the work of the instrument's own."""
        every, worst_case = self.by_work(), self.worst_case
        affordable = [settings for settings in every if self.work(settings) <= share] or every[:1]
        rest = []
        for region in dict.fromkeys(one.region for one in affordable):
            pads = sorted({one.pad or 0 for one in affordable if one.region == region}, reverse=True)
            geometries = (Settings(pad=pad, region=region) for pad in pads)
            widest = next(filter(worst_case.can_be_had, geometries), None)  # less padding is never more exact
            if widest is not None:
                rest += [one for one in affordable if (one.pad, one.region) == (widest.pad, region)]
        return min(rest or affordable, key=partial(worst_case.loss, roughly=True))

    def seconds(self, settings: Settings) -> float:
        """Measure the time of a frame: one at a time, as in a run of so many.

        Raises
        ------
        JitterkitError
            If an example cannot be fitted so.
        """
        examples = self.worst_case.examples
        raws, processor = [one.raw for one in examples], settings.applied(examples[0].processor)
        few = self.frames < PLAN.fewest  # each of which looks at the optics itself
        fitting = Fitting(processor) if few else Fitting.anchored(processor, raws[0], self.frames)
        return fitting.timed(raws)[1]

    def work(self, settings: Settings) -> float:
        """Return the work for a frame, as a share of that with the instrument's own settings."""
        beside = (self.worst_case.instrument, len(self.worst_case.examples[0].result.names), self.frames)
        return work(settings, *beside) / work(OWN, *beside)

    def by_work(self) -> list[Settings]:
        """Return all combinations of the model's settings, from the cheapest on."""
        instrument = self.worst_case.instrument
        axes = {
            name: [value for value in GRID[name] if can_be_had(name, value, instrument)]
            for name in ("pad", "samples", "binning", "region")
        }
        axes["samples"].append(None)
        axes["region"] = [side for side in axes["region"] if side < max(instrument.shape)] + [None]
        axes["binning"] = axes["binning"] or [1]
        every = (Settings(**dict(zip(axes, values, strict=True))) for values in product(*axes.values()))
        return sorted(every, key=self.work)

    def _drop_aberrations(self, settings: Settings, allowed: float) -> Settings:
        """Drop the aberrations that hardly change the separation, also together, and are not seen."""
        known, worst_case, rest = self.worst_case.instrument.aberrations, self.worst_case, settings
        for name in sorted(known, key=lambda one: worst_case.cost_of((one,), rest)):
            without = tuple(one for one in known if one in (*settings.without, name))
            fewer = replace(settings, without=without)
            cost = worst_case.cost_of(without, settings)
            if cost <= _LEFT_OUT * allowed and worst_case.holds(fewer, _MARGIN * allowed):
                settings = fewer
        return settings


def _rounded_up(value: float) -> str:
    """Round up to two digits.

    >>> _rounded_up(2.31), _rounded_up(0.0400001)
    ('2.4', '0.041')
    """
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return f"{math.ceil(value / unit) * unit:.2g}"
