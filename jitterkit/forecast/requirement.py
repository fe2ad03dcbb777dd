"""The inverse question: how much jitter may there be, for a loss that can be afforded.

Reach for :func:`jitter_requirements`.  The loss is observing time, if every frame is fitted with the locus
that its motion draws, or bias of the separation, if it is fitted with another.  A vibration is asked about
by its cycles in an exposure, the three regimes of the paper; its phase is different in every frame, so the
loss is that of the mean over phases.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
import scipy.optimize

from jitterkit.detectors import Detector
from jitterkit.errors import ConfigurationError, ErrorCode, positive
from jitterkit.forecast.bound import expected_data, forecast
from jitterkit.forecast.kinds import jitter_of_kind
from jitterkit.forward import Parameters, free_parameters
from jitterkit.loci import Locus, PartialShm, Stable, locus_class, principal_axes
from jitterkit.optics.otf import OTF
from jitterkit.refit import FitOptions
from jitterkit.scoring import fisher_scoring

CYCLES = (0.05, 0.1, 0.2, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0)
"""Of a vibration in one exposure, that stand for its regimes: low to 0.2, high from 3."""

_PHASES, _SHARES = (-90.0, -45.0, 0.0, 45.0, 90.0), (1.0, 2.0, 2.0, 2.0, 1.0)
"""Degrees at mid-exposure, and how many of eight equal steps round the circle look like each."""

_LONGEST = 7.5
"""arcsec times cycles: at 3 cycles and 2.5 arcsec the integral is good to 1e-6 at TOLIMAN's cutoff."""

_GUESS = 0.08
"""arcsec: rms where the search begins."""

_LEAST, _MOST, _STEP, _EXACT = 1e-9, 30.0, 1.5, 1e-3
"""arcsec: between which a size is sought; the factor by which the search goes; how exactly its logarithm is
found."""

_LEAST_SHARE = 1e-6
"""Share of the time below which a loss is refused: rounding comes near, and nobody plans for so little."""

_MAX_STEPS, _NEAR = 400, 1e-4
"""Steps at most (a round blur fitted with a streak takes 280), and the standard errors that may remain."""

MOTIONS = ("linear", "shm", "mvn,shear=0", "mvn,shear=0.7", "ellipse,ratio=0.5")
"""Kinds of jitter that are asked about, as :func:`jitterkit.forecast.jitter_of_kind` makes them."""


class Requirement(NamedTuple):
    """The largest jitter of one kind.

    Attributes
    ----------
    motion : str
        A name in :data:`MOTIONS`, or ``"vibration"``.
    cycles : float
        Of a vibration in one exposure; NaN for others.
    angle : float
        Of the motion, degrees from the pair's own direction.
    size : float
        arcsec: the whole extent of the kind, or a vibration's peak to peak (of its whole motion, not of the
        part that an exposure sees).  Infinite where nothing up to 30 arcsec costs as much; NaN where a frame
        stops telling before.
    rms : float
        One sigma of the pointing along its major axis within an exposure, arcsec.
    """

    motion: str
    cycles: float
    angle: float
    size: float
    rms: float


def jitter_requirements(
    still: Parameters,
    otf: OTF,
    allowed: float,
    detector: Detector | None = None,
    *,
    fitted: str | None = None,
    angles: Sequence[float] = (0.0, 45.0, 90.0),
    cycles: Sequence[float] = CYCLES,
    options: FitOptions | None = None,
    exposure: float = 0.0,
) -> list[Requirement]:
    """Find the largest jitter of every kind whose loss can be afforded.

    Parameters
    ----------
    still : Parameters
        Scene and optics; its locus does not count.
    otf : OTF
        Expanded at its aberrations.
    allowed : float
        The loss: a share of the observing time without jitter (0.1: a tenth more of it), or with ``fitted``
        a bias of the separation, arcsec.
    detector : Detector, optional
    fitted : str, optional
        Name of the locus that all motions are fitted with; by default each is fitted with its own.
    angles : sequence of float
        Of the motion from the pair's direction, degrees.
    cycles : sequence of float
        Of a vibration in one exposure.
    options : FitOptions, optional
    exposure : float
        s, for a dark current.

    Returns
    -------
    requirements : list of Requirement

    Raises
    ------
    ConfigurationError
        If nothing is allowed, or the frame does not determine its parameters without jitter.
    """
    positive("allowed loss", allowed)
    theta = float(still.binary.theta)

    def error_under(locus: Locus) -> float:
        found = forecast(still.with_locus(locus), otf, detector, options, exposure=exposure)
        return found.error("separation")

    def time_lost(loci: list[Locus]) -> float:
        if any(_beyond_quadrature(one) for one in loci):
            return math.nan
        # the information of frames adds up
        information = _over_phases([error_under(one) ** -2.0 for one in loci])
        return 1 / (alone**2 * information) - 1

    def bias(loci: list[Locus]) -> float:
        assert fitted is not None
        frame = otf, detector, options, exposure
        each = [moment_bias(still.with_locus(one), fitted, *frame) for one in loci]
        return abs(_over_phases(each))

    alone = error_under(Stable.of())
    if not math.isfinite(alone):
        problem = "The frame does not determine its parameters even without jitter"
        remedy = "look at flux, contrast and saturation"
        raise ConfigurationError(ErrorCode.NOT_CONSTRAINED, f"{problem}; {remedy}.")
    least = _LEAST_SHARE if fitted is None else _NEAR * alone
    if allowed < least:
        of, unit = ("a share of the time", "") if fitted is None else ("a bias", " arcsec")
        problem = f"{allowed:g}{unit} is too small for {of}, which is computed to {least:.2g}{unit}"
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, f"{problem}; allow more.")
    loss = time_lost if fitted is None else bias
    questions = [*((kind, math.nan) for kind in MOTIONS), *(("vibration", cycle) for cycle in cycles)]
    found: list[Requirement] = []
    for angle in angles:
        rms = _GUESS
        for motion, cycle in questions:
            build = partial(_loci, motion, cycle, theta + angle)
            guess = rms / _rms(build(1.0))  # motions of the same rms cost about the same
            size = largest_size(_after(loss, build), allowed, guess)
            finite = 0 < size < math.inf
            rms = _rms(build(size)) if finite else rms
            found.append(Requirement(motion, cycle, angle, size, rms if finite else size))
    return sorted(found, key=_order)


def _loci(motion: str, cycle: float, angle: float, size: float) -> list[Locus]:
    """Return the loci of a motion: of a vibration those of all phases."""
    if motion == "vibration":
        return [PartialShm.of(size, angle, cycle, phase) for phase in _PHASES]
    return [jitter_of_kind(motion, size, angle)]


def _beyond_quadrature(locus: Locus) -> bool:
    """Return whether a vibration is too long for the nodes of its integral over time, by its docstring."""
    sizes = locus.describe()
    return isinstance(locus, PartialShm) and sizes["length"] * sizes["cycles"] > _LONGEST


def _after(loss: Callable[[list[Locus]], float], build: Callable[..., list[Locus]]):
    """Return the loss as a function of the size."""
    return lambda size: loss(build(size))


def _order(one: Requirement) -> tuple[int, float]:
    """Motions as they stand in the list, vibrations by their cycles."""
    motions = [*MOTIONS, "vibration"]
    return motions.index(one.motion), 0.0 if math.isnan(one.cycles) else one.cycles


def _rms(loci: list[Locus]) -> float:
    every = np.array([np.asarray(locus.moments()) for locus in loci])
    return principal_axes([_over_phases(column) for column in every.T])[0]


def _over_phases(values: Sequence[float]) -> float:
    """Return the mean over the phases of a vibration; of another motion there is one value."""
    return float(np.average(values, weights=_SHARES if len(values) > 1 else None))


def largest_size(loss: Callable[[float], float], allowed: float, guess: float = 0.1) -> float:
    """Return the size at which a loss first reaches what is allowed.

    Parameters
    ----------
    loss : callable
        Of the size in arcsec; it grows with it.
    allowed : float
    guess : float
        arcsec; the nearer, the faster.

    Returns
    -------
    size : float
        arcsec, to 0.1 % of itself; infinite if the loss stays below up to 30 arcsec, NaN if it is not a
        number before; zero if it is above down to 1e-9.

    Examples
    --------
    >>> round(largest_size(lambda size: size**2, 0.25), 3)
    0.5
    """
    if math.isnan(first := loss(guess)):
        return math.nan
    enough = first >= allowed
    low, high = guess, guess
    while low > _LEAST and high < _MOST:
        down = _STEP * max(1.0, (first / allowed) ** 0.5)  # a loss rises by the square at least
        low, high = (low / down, low) if enough else (high, high * _STEP)
        if math.isnan(reached := loss(low if enough else high)):
            return math.nan
        first = reached
        if (reached >= allowed) != enough:
            span = math.log(low), math.log(high)
            return math.exp(scipy.optimize.brentq(lambda s: loss(math.exp(s)) - allowed, *span, xtol=_EXACT))
    return 0.0 if enough else math.inf


def moment_bias(
    truth: Parameters,
    fitted: str,
    otf: OTF,
    detector: Detector | None = None,
    options: FitOptions | None = None,
    exposure: float = 0.0,
) -> float:
    """Bias of the separation where one locus is fitted with another, from the true moments on [arcsec].

    Parameters
    ----------
    truth : Parameters
        What the frame shows.
    fitted : str
        Name of the locus that is fitted; the fit starts from the true second moments.
    otf, detector, options, exposure
        As for :func:`jitterkit.forecast.forecast`.

    Returns
    -------
    bias : float
        NaN where the frame does not tell, or the locus does not settle.

    Notes
    -----
    The optics stay linear in the aberrations: :func:`jitterkit.forecast.noise_free_fit` is exact where the
    locus is so wrong that it bends them (chi-squared of thousands), and dearer.
    """
    options, truth = FitOptions() if options is None else options, truth.completed(otf)
    data = expected_data(truth, otf, detector, exposure=exposure)
    start = truth.with_locus(locus_class(fitted).near(truth.locus.moments()))
    names, free = free_parameters(start, otf, options.hold)
    prior = options.priors.over(names, start.locus)
    end = fisher_scoring(start, otf, data, free, prior, max_steps=_MAX_STEPS, tolerance=_NEAR)
    settled = bool(end.converged) and np.all(np.isfinite(np.asarray(end.information)))
    return float(end.parameters.binary.separation - truth.binary.separation) if settled else math.nan
