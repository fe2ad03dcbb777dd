"""The blur of a photograph from itself alone: the best fit of a streak's nulls to the power spectrum.

    power(f) = scene(f) sinc²(f.n L) + noise

The scene's spectrum is not modelled but followed: a running geometric mean over two and a half periods
of the nulls, which knows how the spectrum falls and no more.  What remains is maximised in
``(L, angle)`` from the peaks of the cepstrum's comb.  Then the question is asked whether the answer
explains the image: the nulls must be as deep as the model says, and not merely the best of bad ones.

This is the one to reach for.  Those of :mod:`~jitterkit.extended.textbook` are for comparison.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize

from jitterkit.errors import ErrorCode, UndeterminedError
from jitterkit.extended.spectrum import PowerSpectrum, apart, power_spectrum, smoothed, streak_estimate
from jitterkit.extended.textbook import comb_peaks, longest
from jitterkit.kernel_estimate import KernelEstimate
from jitterkit.vision import box_mean

_TAIL = np.float32(2.0)
"""Of the scene's own scatter about its smooth spectrum: lines and lattices are twenty times above it."""

_LOG_MEAN = np.float32(0.5772)
"""The mean logarithm of a power lies that much below the logarithm of its mean (Euler's constant)."""

_WIDEST = 6.0
"""Pixels: the scene's spectrum is never smoothed more than a streak of this length asks for."""

_GATE = 4.5
"""Pixels: below, scenes have nulls of their own (see ``scripts/extended_study``)."""

_LEAST_AGREEMENT = 0.65
"""Gain over the same streak turned by 90 degrees, in units of what a true one gains."""

_RIVAL, _APART = 0.05, 1.5
"""Lead over another streak, ending so many pixels elsewhere, in units of that gain: in 223 images of the
study it was 0.1 or more where the answer was right, and -0.03 where a lattice in the scene had won."""

_REACH = 0.2
"""Pixels: to either side of the maximum, where the likelihood's curvature is taken."""

_INFLATION = 12.0
"""Of the curvature's errors: the scene's own features are no noise; with 4 the study's pulls were 3.5."""

_LEAST_ERROR = 0.02
"""Pixels: the streak as sampled, its ends inside a pixel, is not known better."""


@dataclass(frozen=True)
class _Streak:
    """A candidate: pixels, degrees, log-likelihood."""

    length: float
    angle: float
    value: float


def estimate_blind(image: np.ndarray, *, plate_scale: float = 1.0) -> KernelEstimate:
    """Estimate a uniform streak from one image of an extended scene.

    Parameters
    ----------
    image : (ny, nx) array
        A photograph, a planet's disc, the ground: linear in the light, up to a factor and an offset.
    plate_scale : float
        Arcsec/pixel; without one, a pixel counts as an arcsec.

    Returns
    -------
    estimate : KernelEstimate
        ``locus`` is a :class:`~jitterkit.loci.Linear`.

    Raises
    ------
    UndeterminedError
        If the best streak is shorter than 4.5 pixels or longer than 120 or 0.3 of the image's shorter side,
        does not explain the image's nulls, or another explains them as well.

    Notes
    -----
    *Assumes* uniform motion along a line, the same all over the image, and white noise.  *Fails when* the
    image is sharpened, compressed or resampled after the blur: that moves or fills the nulls.
    """
    spectrum = power_spectrum(image)
    limit = longest(spectrum.shape)
    starts = [(length, angle) for length, angle, _ in comb_peaks(spectrum)]
    found = [_maximised(spectrum, *start, max(0.7, 0.05 * start[0]), 25) for start in starts]
    found = [streak for streak in found if streak.length < limit]
    if not found:
        problem = f"The image shows no streak's nulls: no candidate stays within {limit:.0f} pixels."
        raise UndeterminedError(ErrorCode.NOT_CONSTRAINED, problem)
    best = _refined(spectrum, max(found, key=lambda streak: streak.value))
    _check(spectrum, best, found, limit)
    return streak_estimate(best.length, best.angle, "blind", _errors(spectrum, best), plate_scale)


def _is_another(streak: _Streak, best: _Streak) -> bool:
    return bool(apart(streak.length, streak.angle, best.length, best.angle) > _APART)


def _refined(spectrum: PowerSpectrum, streak: _Streak) -> _Streak:
    return _maximised(spectrum, streak.length, streak.angle, 0.2, 40)


def _check(spectrum: PowerSpectrum, best: _Streak, found: list[_Streak], limit: float) -> None:
    """Refuse what is too short or too long, what the image's nulls do not bear out, and what has a rival."""
    if best.length > limit:
        grown = f"the best candidate grows to {best.length:.0f} pixels"
        problem = f"The image shows no streak's nulls: {grown}, and no more than {limit:.0f} can be measured."
        raise UndeterminedError(ErrorCode.NOT_CONSTRAINED, problem)
    if best.length < _GATE:
        problem = f"The blur, some {best.length:.2f} pixels long, is too small to distinguish its nulls"
        message = f"{problem} from the scene's own (it takes {_GATE:g})."
        raise UndeterminedError(ErrorCode.NOT_CONSTRAINED, message)
    # what a streak gains over itself turned by 90 degrees, and what it would gain where the model is true
    gain = best.value - _likelihood(spectrum, best.length, best.angle + 90)
    mean = _expected_power(spectrum, best.length, best.angle)
    ideal = replace(spectrum, power=mean * np.exp(-_LOG_MEAN), local=mean)
    along, across = (_likelihood(ideal, best.length, best.angle + turn) for turn in (0, 90))
    agreement = gain / (along - across)
    if agreement < _LEAST_AGREEMENT:
        nulls = f"The nulls of the best streak ({best.length:.1f} pixels at {best.angle:.0f} degrees)"
        problem = f"{nulls} explain only {max(agreement, 0):.0%} of what they should"
        message = f"{problem}: the image is not blurred by a uniform streak."
        raise UndeterminedError(ErrorCode.MODEL_MISMATCH, message)
    # the most likely streak that differs from the best, refined like it
    others = sorted((s for s in found if _is_another(s, best)), key=lambda streak: -streak.value)
    ends = (_refined(spectrum, streak) for streak in others)
    rival = next((end for end in ends if end.length < limit and _is_another(end, best)), None)
    if rival is not None and best.value - rival.value < _RIVAL * gain:
        both = f"{best.length:.1f} pixels at {best.angle:.0f} degrees and {rival.length:.1f} at"
        problem = f"Two streaks explain the image's nulls alike: {both} {rival.angle:.0f}."
        raise UndeterminedError(ErrorCode.AMBIGUOUS, problem)


def _expected_power(spectrum: PowerSpectrum, length: float, angle: float) -> np.ndarray:
    """Return the mean power (ny, nx) with the nulls of a streak, the scene's spectrum following the data."""
    x, y = length * np.cos(np.radians(angle)), length * np.sin(np.radians(angle))
    transfer = np.sinc(np.float32(x) * spectrum.fx + np.float32(y) * spectrum.fy)
    nulls = _seen_through_window(transfer**2)
    scale, weight, noise = max(length, _WIDEST), spectrum.weight, np.float32(spectrum.noise)
    share = np.maximum(smoothed(weight, spectrum.shape, scale), 1e-4)
    logarithm = np.log(spectrum.power + np.float32(0.05) * noise)
    scene = spectrum.local / np.maximum(_seen_through_window(nulls), 1e-3)
    for _ in range(2):  # what the noise fills of the nulls depends on the scene
        rest = weight * (logarithm - np.log(nulls + noise / scene))
        scene = np.exp(smoothed(rest, spectrum.shape, scale) / share + _LOG_MEAN)
        scene = np.maximum(scene, np.float32(0.1) * noise)
    return scene * nulls + noise


def _seen_through_window(nulls: np.ndarray) -> np.ndarray:
    """Smooth by the Hann window's power, (1, 4, 1)/6 along either axis, which fills the nulls a little."""
    for box in ((1, 3), (3, 1)):
        nulls = (nulls + box_mean(nulls, box)) / 2
    return nulls


def _likelihood(spectrum: PowerSpectrum, length: float, angle: float) -> float:
    """Return the logarithm of the power's probability, exponential about a mean that itself scatters."""
    mean = _expected_power(spectrum, length, angle)
    terms = np.log(mean) + (1 + _TAIL) * np.log1p(spectrum.power / (_TAIL * mean))
    return -float((spectrum.weight * terms).sum(dtype=float))


def _maximised(spectrum: PowerSpectrum, length: float, angle: float, step: float, calls: int) -> _Streak:
    """Maximise the likelihood in the streak's end, along and across it."""

    def position(q: np.ndarray) -> tuple[float, float]:
        return max(float(q[0]), 0.3), angle + float(np.degrees(q[1] / length))

    simplex = [[length, 0.0], [length - step, 0.0], [length, 0.5 * step]]
    options = {"initial_simplex": simplex, "xatol": 0.05 * step, "fatol": 0.05, "maxfev": calls}
    end = minimize(
        lambda q: -_likelihood(spectrum, *position(q)), simplex[0], method="Nelder-Mead", options=options
    )
    at, turned = position(end.x)
    return _Streak(at, turned % 180, -float(end.fun))


def _errors(spectrum: PowerSpectrum, best: _Streak) -> tuple[float, float]:
    """Standard errors of the streak's end along and across it, pixels, from the likelihood's curvature."""
    turn = float(np.degrees(_REACH / best.length))
    sides = [
        [_likelihood(spectrum, best.length + sign * _REACH, best.angle) for sign in (-1, 1)],
        [_likelihood(spectrum, best.length, best.angle + sign * turn) for sign in (-1, 1)],
    ]
    falls = [max(best.value - sum(pair) / 2, 1e-3) for pair in sides]
    along, across = (_INFLATION * _REACH / np.sqrt(2 * fall) for fall in falls)
    return max(along, _LEAST_ERROR), max(across, _LEAST_ERROR)
