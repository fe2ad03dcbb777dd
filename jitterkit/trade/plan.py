"""Plan the settings of a run: the cheapest that keep the error of the separation below a limit.

Reach for :class:`Planner` with some frames of the run that have been fitted.  The loss by settings is
forecast for those frames (:mod:`jitterkit.trade.worst_case`); their cost is counted and not measured
(:func:`work`), to put them in order before any is tried.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

from jitterkit.batch.plan import PLAN
from jitterkit.errors import ConfigurationError, ErrorCode, JitterkitError
from jitterkit.instruments import Instrument
from jitterkit.optics import Grid
from jitterkit.report.words import angle_size
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
        tolerances = [
            one
            for one in GRID["tolerance"]
            if worst_case.convergence_error(one) <= _CONVERGENCE_SHARE * allowed
        ]
        for settings in every if tolerances else ():
            if worst_case.holds(settings, limit, roughly=True) and worst_case.holds(settings, limit):
                settings = self._drop_aberrations(replace(settings, tolerance=max(tolerances)), allowed)
                settings = self._drop_jitter(settings, allowed)
                try:
                    return Plan(settings, worst_case.loss(settings), self.seconds(settings))
                except JitterkitError:  # with noise, so little a model describes no frame
                    continue
        convergence_error = worst_case.convergence_error(min(GRID["tolerance"]))
        least = max(
            worst_case.loss(min(every, key=worst_case.rough_loss)) / _MARGIN,
            convergence_error / _CONVERGENCE_SHARE,
        )
        raise ConfigurationError(
            ErrorCode.OUT_OF_RANGE,
            f"No settings keep the separation of these frames within {1e6 * allowed:.2g} uas for certain; "
            f"allow {_rounded_up(1e6 * least)} uas or more.",
        )

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
            rest += (
                []
                if widest is None
                else [one for one in affordable if (one.pad, one.region) == (widest.pad, region)]
            )
        return min(rest or affordable, key=worst_case.rough_loss)

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

    def _drop_jitter(self, settings: Settings, allowed: float) -> Settings:
        """Drop jitter in frames that show none, where the limit allows."""
        seen = replace(settings, jitter="seen")
        return seen if self.worst_case.holds(seen, _MARGIN * allowed) else settings


def _rounded_up(value: float) -> str:
    """Round up to two digits.

    >>> _rounded_up(2.31), _rounded_up(0.0400001)
    ('2.4', '0.041')
    """
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return f"{math.ceil(value / unit) * unit:.2g}"


_UNKNOWN = 100.0
"""nm, beyond which the error of an aberration says that a frame does not tell it."""

_HELD = 0.9
"""Share of what is known beforehand, beyond which the error says the same."""


def explain(worst_case: WorstCase, plan: Plan) -> Iterator[str]:
    """Say what is modelled of a scene, what is not, and what that costs.

    Parameters
    ----------
    worst_case : WorstCase
        By which it was planned.
    plan : Plan

    Yields
    ------
    sentence : str
        Of each part of the model.
    """
    settings, instrument = plan.settings, worst_case.instrument
    ny, nx = instrument.shape
    cut = [min(n, settings.region or n) for n in (nx, ny)]
    size = f"{nx} x {ny}" if settings.region is None else f"{cut[0]} x {cut[1]} of {nx} x {ny}"
    yield f"pixels: {size}{_cost(worst_case, settings, 'region')}"
    own = own_pad(instrument)
    pad = own if settings.pad is None else settings.pad
    yield f"padding: {pad} pixels on each side, of its own {own}{_cost(worst_case, settings, 'pad')}"
    if instrument.spectrum is not None:
        count = len(instrument.spectrum.wavelengths)
        used = settings.samples or count
        yield f"wavelengths: {used}, of its own {count}{_cost(worst_case, settings, 'samples')}"
    if instrument.pupil is not None:
        side = len(instrument.pupil.opd) // settings.binning
        yield f"pupil: {side} x {side} samples{_cost(worst_case, settings, 'binning')}"
        yield from _aberrations(worst_case, plan)
    yield _jitter(worst_case, settings)
    yield f"fits end when a step is below {settings.tolerance:g} of an error"


def _cost(worst_case: WorstCase, settings: Settings, name: str) -> str:
    """Return the loss with the next cheaper value of a setting, as text."""
    value, values = getattr(settings, name), GRID[name]
    cheaper = [one for one in values if can_be_had(name, one, worst_case.instrument)]
    if value is not None:
        cheaper = cheaper[: cheaper.index(value)]
    elif name == "region":
        cheaper = [side for side in cheaper if side < max(worst_case.instrument.shape)]
    elif name == "pad":
        cheaper = [pad for pad in cheaper if pad < own_pad(worst_case.instrument)]
    elif name == "samples" and worst_case.instrument.spectrum is not None:
        cheaper = [count for count in cheaper if count < len(worst_case.instrument.spectrum.wavelengths)]
    if not cheaper:
        return ""
    loss = worst_case.loss(replace(settings, **{name: cheaper[-1]}, without=()))
    next_value = f"{cheaper[-1]} x {cheaper[-1]} of them as one" if name == "binning" else cheaper[-1]
    return (
        f"; {next_value} would cost {angle_size(loss, 2)}"
        if math.isfinite(loss)
        else f"; {next_value} will not do"
    )


def _aberrations(worst_case: WorstCase, plan: Plan) -> Iterator[str]:
    names, without = worst_case.instrument.aberrations, plan.settings.without
    if not names:
        return
    fitted = [name for name in names if name not in without]
    text = f"fitted: {', '.join(fitted) or 'none'}"
    if without:
        cost = angle_size(worst_case.cost_of(without, plan.settings), 2)
        text += f"; left out: {', '.join(without)}, which may cost {cost}"
    yield f"aberrations {text}"
    known = worst_case.instrument.aberration_sigma
    if known is None:
        limit, end = _UNKNOWN, "; with aberration_sigma in the instrument's file it would be held to that"
    else:
        limit, end = _HELD * known, f": it is held to the {known:g} nm of the instrument's file"
    for one in worst_case.examples:
        unknown = [name for name in fitted if not one.result.error(name) <= limit]  # NaN of what is blind
        if unknown:
            yield f"{one.raw.name} does not determine {', '.join(unknown)} to {limit:.3g} nm{end}"


def _jitter(worst_case: WorstCase, settings: Settings) -> str:
    """Return what was fitted of the jitter, by whose choice, and what it costs to leave it out, or would."""
    counted = Counter((one.result.locus, len(one.truth.locus.names)) for one in worst_case.examples)
    found = ", ".join(f"{name} ({size} parameters) in {n}" for (name, size), n in counted.items())
    auto = worst_case.examples[0].processor.locus == "auto"
    who = "; every frame gets what it shows, and no more" if auto else ", as --locus says"
    cost = worst_case.cost_of_jitter(settings)
    price = angle_size(cost, 2)
    if settings.jitter == "seen":
        who, price = "", f"; a frame that shows none gets no parameters of it, which may cost {price}"
    else:
        price = f"; one that shows none gets three, for {price} might be lost without"
    return f"jitter: {found} of the fitted frames{who}{price if cost < math.inf else ''}"
