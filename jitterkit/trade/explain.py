"""Explain a plan in sentences: what is modelled of a scene, what is not, and what that costs."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace

from jitterkit.report.words import angle_size
from jitterkit.trade.grid import GRID, can_be_had
from jitterkit.trade.plan import Plan
from jitterkit.trade.settings import Settings, own_values
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
    own = own_values(instrument)
    pad = own["pad"] if settings.pad is None else settings.pad
    yield f"padding: {pad} pixels on each side, of its own {own['pad']}{_cost(worst_case, settings, 'pad')}"
    if instrument.spectrum is not None:
        used, count = settings.samples or own["samples"], own["samples"]
        yield f"wavelengths: {used}, of its own {count}{_cost(worst_case, settings, 'samples')}"
    if instrument.pupil is not None:
        side = len(instrument.pupil.opd) // settings.binning
        yield f"pupil: {side} x {side} samples{_cost(worst_case, settings, 'binning')}"
        yield from _aberrations(worst_case, plan)
    yield _jitter(worst_case, settings)
    yield f"fits end when a step is below {settings.tolerance:g} of an error"


def _cost(worst_case: WorstCase, settings: Settings, name: str) -> str:
    """Return the loss with the next cheaper value of a setting, as text."""
    value, instrument = getattr(settings, name), worst_case.instrument
    cheaper = [one for one in GRID[name] if can_be_had(name, one, instrument)]
    if value is not None:
        cheaper = cheaper[: cheaper.index(value)]
    elif cheaper:
        own = own_values(instrument)[name]
        cheaper = [one for one in cheaper if one < own]
    if not cheaper:
        return ""
    loss = worst_case.loss(replace(settings, **{name: cheaper[-1]}, without=()))
    next_value = f"{cheaper[-1]} x {cheaper[-1]} of them as one" if name == "binning" else cheaper[-1]
    verdict = f"would cost {angle_size(loss, 2)}" if math.isfinite(loss) else "will not do"
    return f"; {next_value} {verdict}"


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
