"""What a plan leaves out of the model, and what that costs, in sentences."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace

from jitterkit.report.words import angle_size
from jitterkit.trade.grid import GRID, can_be_had
from jitterkit.trade.plan import Plan
from jitterkit.trade.settings import Settings, own_pad
from jitterkit.trade.worst_case import WorstCase

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
