"""Fisher scoring with optics that are exact where it ends.

Optics are expanded to first order about a state of the aberrations (:class:`~jitterkit.optics.otf.OTF`).
:func:`relinearised_scoring` maximises the posterior, expands the optics again at the maximum, and so on,
until the error of the expansion cannot be seen.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Array, Float

from jitterkit.forward import Parameters
from jitterkit.likelihood import POOR, Data
from jitterkit.metric import Prior
from jitterkit.optics.otf import OTF
from jitterkit.optics.system import Optics
from jitterkit.scoring import fisher_scoring
from jitterkit.scoring_loop import ScoringResult

LINEARISATION_TOLERANCE = 0.1
"""Largest error of linearised optics at the end of a fit, in sigmas of the whole image."""

_FAST_CONVERGENCE, _FARTHEST_AHEAD, _FARTHEST_BACK = 1 / 16, 1.0, 0.9
"""Ratio of successive errors below which expansions need no extrapolation; how far ahead of the last
maximum, and back to the one before, the next may be expanded, in distances between the two.  Of 480 faint
and bright frames of a small telescope that were started up to 2 rad from their wavefront all settled, after
3.4 expansions each."""

_NEAR = 0.15
"""Rms phase [rad] up to which the derivatives of another wavefront do for a rough maximum.  Those of a flat
one through a symmetric pupil are zero for focus and astigmatism; a star of 0.4 rad was not found."""

_APPROACHING, _UNCERTAIN = 0.5, 4
"""Ratio to the best error before of that of two rounds, above which maxima do not approach each other; and
rounds before this is asked.  Of 192 fits near the resolution limit this ends 63: 28 would have settled, in
3.3 further rounds on the average; 35 took 5.4 in vain."""

_STALLED_RATIO, _STALLED_ROUNDS = 0.9, 2
"""A maximisation has stalled if it does not reduce the deviance below that share.  After so many in a row a
fit is abandoned that would still be poor if all that are left did as well as the best of these."""


LOST, _SETTLING = 100.0, 5.0
"""Deviance by which another model is better beyond doubt: odds of e^50, where priors of three parameters more
or fewer make up to e^25; and ratio of what is left to what the latest round changed.  Of 94 fits of one star
to frames near the resolution limit 77 were given up: later rounds of 51 of these brought at most a third of
what they lacked."""


class Stall:
    """Whether rounds that each lower the deviance per pixel may still end at a frame's noise.

    Parameters
    ----------
    level : float
        Of the start; infinite if there is none.
    """

    def __init__(self, level: float = np.inf) -> None:
        self._level, self._ratios = level, [0.0]

    def is_hopeless(self, level: float, left: int) -> bool:
        """Return whether the deviance per pixel stays poor in all rounds that are left, as of the latest."""
        self._ratios = [*self._ratios, level / self._level][-_STALLED_ROUNDS:]
        self._level, rate = level, min(1.0, *self._ratios)
        return rate > _STALLED_RATIO and level * rate**left > POOR


class Losing:
    """Whether rounds that settle will end far above the deviance that another model of the frame has.

    Parameters
    ----------
    rival : float
        That deviance; infinite if there is none.
    """

    def __init__(self, rival: float) -> None:
        self._rival, self._least, self._latest = rival, np.inf, np.inf

    def is_certain(self, deviance: float) -> bool:
        """Return whether nothing of what a round changes brings the deviance, the latest, near the rival."""
        moved, self._latest = abs(deviance - self._latest), deviance
        self._least = min(self._least, deviance)
        return bool(np.isfinite(moved)) and self._least - self._rival > max(LOST, _SETTLING * moved)


class Expanded(NamedTuple):
    """Hold the maximum, and the optics in which it was found.

    Attributes
    ----------
    end : ScoringResult
        ``converged`` only if the optics are exact enough there.
    otf : OTF
        The optics of the last maximisation.
    iterations : int
        Of all maximisations.
    is_hopeless : bool
        Whether it was given up because it would end far above the noise, or a rival.
    """

    end: ScoringResult
    otf: OTF
    iterations: int
    is_hopeless: bool = False


def relinearised_scoring(
    start: Parameters,
    otf: OTF,
    optics: Optics,
    data: Data,
    free: tuple[int, ...],
    prior: Prior,
    *,
    max_error: float = LINEARISATION_TOLERANCE,
    max_expansions: int = 10,
    max_steps: int = 50,
    tolerance: float = 1e-4,
    known: Float[Array | np.ndarray, "p p"] | None = None,
    errors: bool = True,
    keep_slopes: bool = False,
    rival: float = np.inf,
    patient: bool = True,
) -> Expanded:
    """Maximise the posterior, and expand the optics again at the maximum, until the expansion is exact there.

    Where the maxima of two expansions do not approach each other quickly (in a faint frame, or where an
    aberration shows to second order first, each overshoots), the next is at the extrapolation of both.

    Parameters
    ----------
    start, otf, data, free, prior, max_steps, tolerance, known, errors
        As for :func:`~jitterkit.scoring.fisher_scoring`.
    optics : Optics
        Expanded again where ``otf`` is not exact enough.
    max_error : float
        Largest error of the expansion, in sigmas of the whole image (:func:`linearisation_error`).
    max_expansions : int
        Largest number of maximisations.
    keep_slopes : bool
        Whether to expand again without the derivatives while the wavefront is near that of the last ones: a
        tenth of the work, for a rough maximum.
    rival : float
        Deviance of another model of the frame: a fit that settles far above it is given up.
    patient : bool
        Whether to go on where the maxima do not approach each other.

    Returns
    -------
    expanded : Expanded
    """
    iterations, misses, way, slopes_at = 0, [np.inf], None, np.asarray(otf.state)
    stall, losing = Stall(), Losing(rival)
    for left in reversed(range(max_expansions)):
        end = fisher_scoring(
            start,
            otf,
            data,
            free,
            prior,
            max_steps=max_steps,
            tolerance=tolerance,
            known=known,
            errors=errors,
        )
        iterations += int(end.iterations)
        start, known = end.parameters, end.information
        error = linearisation_error(optics, start, otf)
        if error < max_error:
            return Expanded(end, otf, iterations)
        level = float(end.objective) / int(np.sum(np.asarray(data.used)))
        hopeless = stall.is_hopeless(level, left) or losing.is_certain(float(end.objective))
        misses.append(error)
        if hopeless or not left or not (patient or _approach(misses[1:])):
            break
        here = (np.asarray(otf.state), np.asarray(start.aberrations))
        there = here[1] if way is None or error < _FAST_CONVERGENCE * misses[-2] else _extrapolated(way, here)
        way = here
        if keep_slopes and optics.phase(there - slopes_at) < _NEAR:
            otf = optics.near(there, otf)
        else:
            otf, slopes_at = optics.otf(there), there
    return Expanded(end._replace(converged=np.asarray(False)), otf, iterations, hopeless)


def _approach(misses: list[float]) -> bool:
    """Return whether the maxima of the latest rounds approach each other, or it is too early to say."""
    return len(misses) < _UNCERTAIN or min(misses[-2:]) < _APPROACHING * min(misses[:-2])


def _extrapolated(before: tuple[np.ndarray, np.ndarray], now: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Return the fixed point of a straight line through two maximisations, each ``(start, end)``.

    Anderson's mixing with a memory of one (J. ACM 12, 547, 1965), kept from running away.
    """
    moved, turned = now[1] - now[0], now[1] - now[0] - (before[1] - before[0])
    length = turned @ turned
    share = np.clip(moved @ turned / length, -_FARTHEST_AHEAD, _FARTHEST_BACK) if length > 0 else 0.0
    return now[1] - share * (now[1] - before[1])


def linearisation_error(optics: Optics, parameters: Parameters, otf: OTF) -> float:
    """Return the error of first-order optics in the image, in sigmas of all its photons together.

    A change of the wavefront by a phase of rms ``q`` changes the image by about ``q²`` of itself beyond
    first order, more in its dark parts; its N photons show a share of ``1/sqrt(N)``.
    """
    if not otf.names:
        return 0.0
    state = np.asarray(otf.state)[: len(parameters.aberrations)]
    return error_per_square(parameters) * optics.phase(np.asarray(parameters.aberrations) - state) ** 2


def error_per_square(parameters: Parameters) -> float:
    """Return the error of first-order optics, in sigmas of the whole image, per squared rms phase [rad²].

    The factor three was measured, on defocus and astigmatism of a plain telescope, where it is worst.
    """
    return 3 * float(np.sqrt(abs(float(parameters.scene.flux))))


_STALE = 0.03
"""Rms phase [rad] by which the optics may have changed since their derivatives were computed, which are then
off by 3 %: of 16 TOLIMAN frames the separation moved by 0.0008 of its error, the error by 8e-6."""


class NearbyOptics:
    """Optics of one frame after the other: exact at each, with derivatives computed now and then.

    Parameters
    ----------
    optics : Optics
    """

    def __init__(self, optics: Optics) -> None:
        self.optics = optics
        self._slopes = self._here = optics.nominal

    def at(self, parameters: Parameters) -> OTF:
        """Return the optics for parameters whose aberrations are held."""
        aberrations = parameters.aberrations
        if self.optics.phase(np.asarray(aberrations - self._slopes.state)) > _STALE:
            self._slopes = self._here = self.optics.otf(aberrations)
        elif linearisation_error(self.optics, parameters, self._here) > LINEARISATION_TOLERANCE:
            self._here = self.optics.near(aberrations, self._slopes)
        return self._here
