"""Fit a star that dwells at two places during the exposure: its image is that of a close pair.

A path that starts near a line through its moments ends at another, worse maximum of the likelihood.  Here it
starts at the pair that was fitted instead (:func:`fit_dwelling_star`): it stays where the pair's stars are,
at each place for as long as its star is bright.

An image shows where a path stays, but hardly in which order, while the blur is smaller than the resolution.
Many orders are then maxima of their own, and the evidence of a path is their sum (:func:`over_orders`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from jitterkit.forward import Parameters, free_parameters
from jitterkit.loci import Path, principal_axes
from jitterkit.optics.otf import OTF
from jitterkit.refit.fit import fit_and_allow
from jitterkit.refit.locus_fit import FrameFits
from jitterkit.refit.result import FitResult, Status
from jitterkit.refit.weigh import weight_of_evidence
from jitterkit.scene import Binary, Star
from jitterkit.scoring import fisher_scoring

_KNOTS = (6, 8)
"""Positions of the paths that are started: with four, a stay is too short."""

_TRIAL_STEPS, _REACH = 12, 100.0
"""Steps of a trial, and the deviance by which it may then be above the pair for a fit to be worth its time: a
walk that looks like a pair was 3 and 22 above (eight and six positions), a true pair 192 and 252; to fit one
that is thousands above takes 15 s."""

_ORDERS = 5
"""Orders of the positions that are fitted, a second each.  Evidences of those of a walk that looks like a
pair scattered by 1.5, so that their median is known to 0.8."""

_ROUGHLY = 0.3
"""Standard errors to which these are fitted: that takes 0.6 of the time of 0.03, and moved the deviances of
five by -3 to +1."""

_MAXIMA = 100.0
"""Maxima that the orders of six positions or more lead to, for a walk that looks like a pair: of fits from 36
orders of six positions four pairs ended at one maximum, of eight seven, which makes some 160 and 90.  All
others were nine standard errors apart or more."""


def fit_dwelling_star(frame: FrameFits, pair: FitResult, star: FitResult) -> FitResult | None:
    """Fit one star on a path that starts with stays where a pair's stars are.

    Parameters
    ----------
    frame : FrameFits
    pair : FitResult
        Of two stars.
    star : FitResult
        Of one; it competes if it is on a path.

    Returns
    -------
    path : FitResult or None
        The most probable path; None where none comes near to the pair.
    """
    if pair.parameters is None:
        return None
    limit, otf = pair.objective + _REACH, frame.optics.otf(pair.parameters.aberrations)
    fits = [star] if star.locus == "path" and star.objective < limit else []
    for start in _dwelling_stars(pair.parameters):
        names, free = free_parameters(start, otf, frame.options.hold)
        prior = frame.options.priors.over(names, start.locus)
        trial = fisher_scoring(start, otf, frame.data, free, prior, max_steps=_TRIAL_STEPS)
        if float(trial.objective) < limit and (fit := _fit(frame, trial.parameters, otf)) is not None:
            fits.append(fit)
    return max(fits, key=weight_of_evidence, default=None)


def over_orders(frame: FrameFits, path: FitResult) -> tuple[FitResult, float]:
    """Return the evidence of a path and of those with its positions in other orders.

    Parameters
    ----------
    frame : FrameFits
    path : FitResult
        Of a star on a path.

    Returns
    -------
    best : FitResult
        The most probable that was met.
    evidence : float
        Its logarithm: their median times the number of maxima, but no less than the best by itself.  A mean
        would count one that stands out among five as a fifth of all: so two true pairs were read as one star.
    """
    assert path.parameters is not None
    locus, rng = path.parameters.locus, np.random.default_rng(0)
    assert isinstance(locus, Path)
    positions = np.array(list(locus.describe().values())).reshape(-1, 2)
    rough = replace(frame, options=replace(frame.options, tolerance=max(_ROUGHLY, frame.options.tolerance)))
    orders = (Path.of(rng.permutation(positions)).sampled(locus.nodes) for _ in range(_ORDERS))
    others = [_fit(rough, path.parameters.with_locus(order)) for order in orders]
    found = [fit for fit in others if fit is not None]
    best = max([path, *found], key=weight_of_evidence)
    if best is not path and best.parameters is not None:
        best = _fit(frame, best.parameters) or best
    known = [weight_of_evidence(fit) for fit in found] + [-math.inf] * (_ORDERS - len(found))
    return best, max(weight_of_evidence(best), float(np.median(known)) + log_maxima(path))


def log_maxima(path: FitResult) -> float:
    """Return the logarithm of the number of maxima of paths that pass positions in any order."""
    assert path.parameters is not None
    orders = math.factorial(path.parameters.locus.knots) / 2  # type: ignore[attr-defined]  # a way there is one back
    return math.log(min(_MAXIMA, orders))


def _fit(frame: FrameFits, start: Parameters, otf: OTF | None = None) -> FitResult | None:
    try:
        fit, *_ = fit_and_allow(frame.data, frame.optics, start, otf, frame.options)
    except (ArithmeticError, ValueError, np.linalg.LinAlgError):
        return None
    return replace(fit, locus="path") if fit.status is Status.OK else None


def _dwelling_stars(pair: Parameters) -> Iterator[Parameters]:
    """Yield stars on paths that leave nearly the image of a pair.

    At each place they go to and fro as far as the pair's blur is wide.
    """
    scene = pair.scene
    assert isinstance(scene, Binary)
    x, y, flux = (np.asarray(part)[:2] for part in scene.sources())
    star = Star(flux @ x / flux.sum(), flux @ y / flux.sum(), flux.sum())
    if scene.indices is not None:
        star = star.coloured((float(flux @ np.asarray(scene.indices)[:2] / flux.sum()),))
    major, _, angle = principal_axes(pair.locus.moments())
    aside = major * np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
    for knots in _KNOTS:
        number = np.arange(knots)[:, None]
        first = np.clip(round(knots * float(flux[0] / flux.sum())), 1, knots - 1)
        places = np.where(number < first, [x[0], y[0]], [x[1], y[1]])
        yield replace(pair, scene=star, locus=Path.of(places + (-1.0) ** number * aside))
