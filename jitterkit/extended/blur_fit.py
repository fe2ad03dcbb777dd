"""The search for the blur between two frames of one scene, and the choice of its kind.

:func:`normal`, :func:`streak`, :func:`drift` and :func:`vibration` are the kinds: their transfer functions,
with the derivatives by their parameters.  :func:`fit_blur` chooses among them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import j0, j1

from jitterkit.errors import ErrorCode, UndeterminedError
from jitterkit.extended.comparison import Comparison, Fit, Slopes, Transfer
from jitterkit.loci.base import axis_variances, principal_axes


def normal(q: np.ndarray, fx: np.ndarray, fy: np.ndarray) -> tuple[np.ndarray, Slopes]:
    """Return the transfer function of a normal of moments ``q`` (sxx, sxy, syy), and its derivatives."""
    exponent = -2 * np.pi**2 * (q[0] * fx**2 + 2 * q[1] * fx * fy + q[2] * fy**2)
    transfer = np.exp(np.clip(exponent, -60, 2))  # a reference that is blurrier must not overflow

    def slopes() -> list[np.ndarray]:
        slope = -2 * np.pi**2 * transfer
        return [slope * fx**2, 2 * slope * fx * fy, slope * fy**2]

    return transfer, slopes


def streak(q: np.ndarray, fx: np.ndarray, fy: np.ndarray) -> tuple[np.ndarray, Slopes]:
    """Return the transfer function of a streak from ``-q/2`` to ``q/2`` (x, y), and its derivatives."""
    phase = q[0] * fx + q[1] * fy
    transfer = np.sinc(phase)

    def slopes() -> list[np.ndarray]:
        slope = _slope_of_sinc(phase)
        return [slope * fx, slope * fy]

    return transfer, slopes


def _slope_of_sinc(phase: np.ndarray) -> np.ndarray:
    small = np.abs(phase) < 1e-6
    return np.where(small, 0.0, (np.cos(np.pi * phase) - np.sinc(phase)) / np.where(small, 1.0, phase))


def drift(q: np.ndarray, fx: np.ndarray, fy: np.ndarray) -> tuple[np.ndarray, Slopes]:
    """Return the transfer function of a streak under a normal, and its derivatives.

    ``q`` is (sxx, sxy, syy) of both together [pixel²], and the streak from end to end (x, y) [pixels].
    """
    return _under_normal(np.sinc, _slope_of_sinc, 1 / 12, q, fx, fy)


def vibration(q: np.ndarray, fx: np.ndarray, fy: np.ndarray) -> tuple[np.ndarray, Slopes]:
    """Return the transfer function of a sine under a normal, and its derivatives: ``q`` as in `drift`."""
    return _under_normal(lambda u: j0(np.pi * u), lambda u: -np.pi * j1(np.pi * u), 1 / 8, q, fx, fy)


def _under_normal(form, slope, share, q, fx, fy) -> tuple[np.ndarray, Slopes]:
    """Return the transfer function of a motion along ``q[3:]``, with a share of its square as variance."""
    phase = q[3] * fx + q[4] * fy
    exponent = q[0] * fx**2 + 2 * q[1] * fx * fy + q[2] * fy**2 - share * phase**2
    rest = np.exp(np.clip(-2 * np.pi**2 * exponent, -60, 2))
    transfer = form(phase) * rest

    def slopes() -> list[np.ndarray]:
        turn = -2 * np.pi**2 * transfer
        along = slope(phase) * rest - 2 * share * phase * turn
        return [turn * fx**2, 2 * turn * fx * fy, turn * fy**2, along * fx, along * fy]

    return transfer, slopes


_LEAST_FREQUENCIES = 50
"""That must rise above the noise in the sharp frame."""

_SEARCHED = 256
"""Side of the part in which starts are sought [pixels]; the winners are fitted to the whole frames."""

_LENGTHS, _REFINED = np.geomspace(0.3, 150.0, 60), 3
"""Streaks [pixels] that are compared, a tenth apart, and how many of the best are refined: every null of the
transfer function makes a maximum of its own, and a tenth is less than half the distance of two."""

_STARTS = -0.3, 0.05, 0.3, 1.0, 4.0
"""Moments to start from, in units of the widest normal that the data show: nulls make local minima, and those
of a blurrier reference hide behind a positive one."""

_SIGMAS = 3.0
"""Extent of a normal."""

_SEARCH_BORDER = 0.125
"""Share of a side that is left out while the blur's extent is unknown."""


@dataclass(frozen=True, eq=False)
class Blur:
    """What was found of a blur.

    Attributes
    ----------
    best : Fit
        The one that describes the frames best.
    normal : Fit
    left : float
        Share of the difference of the aligned frames that the best one leaves; 0 where noise may be all.
    excess : float
        Share of that difference which is left beyond noise and its error.
    rival : Fit or None
        The best of the other kinds, if any comes near.
    odds : float
        Of the rival against the best one, at most 1, by Akaike's criterion.
    """

    best: Fit
    normal: Fit
    left: float
    excess: float
    rival: Fit | None
    odds: float


_PENALTIES: dict[Transfer, float] = {normal: 0.0, streak: 2.0, drift: 10.0, vibration: 10.0}
"""Half of chi-squared that a kind must fit better by than a normal.

A normal's moments may have either sign: of no blur they scatter about zero, where a streak's are positive.
Two more parameters gain 10 by chance in one of 20,000 frames.
"""

_CLEAR = 20.0
"""Half of chi-squared by which a kind is worse in the part and is left out: the whole frames show more."""

_NOTICED = 0.5
"""Share of the noise (it was measured at the highest frequencies) from which an excess of power is none."""

_CHANCE = 11.0
"""Share of the noise, times the root of the number of pixels, beyond which an excess counts as an error: 1.5
standard errors of the noise, a median over a third of the frequencies in a window that ties four of them."""


def fit_blur(frames: Comparison, shift: tuple[float, float]) -> Blur:
    """Fit a normal, a streak, and a streak and a sine under a normal.

    Parameters
    ----------
    frames : Comparison
    shift : (float, float)
        Start of the shift (x, y) [pixels].

    Raises
    ------
    UndeterminedError
        If the sharp frame does not rise above its noise, or the blur reaches over the frames.
    """
    if frames.frequencies < _LEAST_FREQUENCIES:
        found = f"Only {frames.frequencies} frequencies of the sharp frame rise above its noise"
        raise UndeterminedError(ErrorCode.NO_SIGNAL, f"{found}; the fit needs {_LEAST_FREQUENCIES}.")
    part = frames.part(_SEARCHED)
    broad = _best_normal(part, shift)
    angle = np.radians(principal_axes(broad[3:])[2])
    axis = np.array([np.cos(angle), np.sin(angle)])
    ranked = _compared(part, [np.array([*broad[:3], *(length * axis)]) for length in _LENGTHS])
    refined = [part.fit(streak, p, window).p for _, p, window in ranked[:_REFINED]]
    compared = _compared(part, refined)
    if not compared:
        raise UndeterminedError(ErrorCode.TOO_FEW, _reaching_over(frames))
    line = compared[0][1]
    extents = [_extent(streak, line), _extent(normal, broad)]
    window = part.window(*(extents if part.holds(*extents) else extents[:1]))
    fits = [part.fit(transfer, p, window) for transfer, p in _candidates(line, broad, axis)]
    normal_fit = part.with_error_of_noise(fits[0], window)
    kinds = {fit.transfer: fit for fit in sorted(fits, key=_price, reverse=True)}  # the best of each
    near = [fit for fit in kinds.values() if _price(fit) < min(map(_price, fits)) + _CLEAR]
    extents = [_extent(fit.transfer, fit.p) for fit in near]
    if not frames.holds(*extents):
        raise UndeterminedError(ErrorCode.TOO_FEW, _reaching_over(frames))
    window = frames.window(*extents)
    fits = [frames.fit(fit.transfer, fit.p, window) for fit in near]
    best = min(fits, key=_price)
    rival = min((fit for fit in fits if fit is not best), key=_akaike, default=None)
    odds = 0.0 if rival is None else float(np.exp(min(_akaike(best) - _akaike(rival), 0.0)))
    best = frames.with_error_of_noise(best, window)
    rest, noise_share = frames.unexplained(best.transfer, best.p, window)[0], frames.noise_share(best, window)
    sharp = frames.unexplained(normal, np.array([*best.p[:3], 0.0, 0.0, 0.0]), window)[0]
    excess, chance = rest - noise_share, noise_share * _CHANCE / np.sqrt(frames.one.size)
    return Blur(
        best,
        normal_fit,
        excess / sharp if excess > _NOTICED * noise_share else 0.0,
        max(excess - chance, 0.0) / sharp,
        rival,
        odds,
    )


def _price(fit: Fit) -> float:
    return fit.cost + _PENALTIES[fit.transfer]


def _akaike(fit: Fit) -> float:
    """Return half of Akaike's criterion."""
    return fit.cost + len(fit.p)


def _reaching_over(frames: Comparison) -> str:
    sides = " x ".join(map(str, frames.one.shape[::-1]))
    return f"The blur and the shift reach over the frames of {sides} pixels; give larger frames."


def _candidates(line: np.ndarray, broad: np.ndarray, axis: np.ndarray) -> list[tuple[Transfer, np.ndarray]]:
    """Return every kind of blur, from the best streak and the best normal."""
    x, y = line[3:]
    thin = np.array([x * x, x * y, y * y]) / 12
    major, minor, _ = axis_variances(broad[3:])
    wide = np.sqrt(12 * max(major - minor, 1e-4)) * axis
    return [
        (normal, broad),
        (streak, line),
        (drift, np.array([*line[:3], *thin, *(0.9 * line[3:])])),
        (drift, np.array([*broad, *(0.7 * wide)])),
        (vibration, np.array([*line[:3], *thin, *(0.8 * line[3:])])),
        (vibration, np.array([*broad, *(0.6 * wide)])),
    ]


def _best_normal(frames: Comparison, shift: tuple[float, float]) -> np.ndarray:
    """Return the parameters of the best normal."""
    window = frames.window(_SEARCH_BORDER * np.array(frames.one.shape[::-1]))
    starts = [np.array([0.0, *shift, moment, 0.0, moment]) for moment in np.multiply(_STARTS, frames.widest)]
    for start in starts:
        start[0] = frames.unexplained(normal, start, window)[1]
    return min((frames.fit(normal, start, window) for start in starts), key=lambda fit: fit.cost).p


def _compared(frames: Comparison, lines: list[np.ndarray]) -> list[tuple[float, np.ndarray, np.ndarray]]:
    """Return what streaks that fit in leave unexplained, their parameters and windows, best first."""
    compared = []
    for p in lines:
        if frames.holds(_extent(streak, p)):
            window = frames.window(_extent(streak, p))
            rest, gain = frames.unexplained(streak, p, window)
            compared.append((rest, np.array([gain, *p[1:]]), window))
    return sorted(compared, key=lambda found: found[0])


def _extent(transfer: Transfer, p: np.ndarray) -> np.ndarray:
    """How far (x, y) a blur and a shift carry light [pixels]."""
    half = np.abs(p[3:]) / 2 if transfer is streak else _SIGMAS * np.sqrt(np.maximum(p[[3, 5]], 0))
    return half + np.abs(p[1:3]) + 1
