"""Refit a frame: every parameter of scene, optics and jitter at once, by maximum likelihood.

The optics are expanded to first order about a state of the aberrations, the likelihood is climbed,
and the optics are expanded anew where the climb ended, until what the linearisation leaves out cannot
be seen in the image.
"""

from __future__ import annotations

import time
from collections.abc import Collection
from dataclasses import dataclass, field, replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jitterkit.forward import Parameters, expected_image, free_parameters
from jitterkit.likelihood import Data, pearson
from jitterkit.loci import Locus, Streak
from jitterkit.metric import invert_information
from jitterkit.optics.otf import OTF
from jitterkit.optics.system import Optics
from jitterkit.refit.contradiction import CONTRADICTED, prior_chance
from jitterkit.refit.leashes import leashes
from jitterkit.refit.priors import Priors
from jitterkit.refit.result import POOR, FitResult, Status
from jitterkit.refit.tip import at_the_tip
from jitterkit.scoring import DROWNED, Climb, climb

__all__ = [
    "SETTLED",
    "FitOptions",
    "fit_and_expand",
    "fit_frame",
    "linearisation_error",
    "settled",
    "unfinished",
]

_MISFIT = 5.0  # standard deviations of chi-squared beyond which the frame is flagged
_EXPANSIONS = 10
_CLEARINGS = 3  # times that the fit may move the edge of what comes near the ceiling: once is usual
SETTLED, _USUAL = 0.1, 1e-4
"""Sigmas of the whole image that the linearised optics may be off by, in a fit to that tolerance or a looser
one; the tighter, the less."""
_SHOWN = 0.1
"""Errors of the separation for each of these sigmas, at most: 0.096 in 92 states of eleven telescopes, 0.005
of TOLIMAN's."""
_FAST, _AHEAD, _BACK = 1 / 16, 1.0, 0.9
"""Share of its error that an expansion leaves where those that follow need no help; how far ahead of the
last climb, and back to the one before, the next may be expanded, in distances of their ends.  Of 480 faint
and bright frames of a small telescope that were started up to 2 rad from their wavefront all settled, after
3.4 expansions each."""
_HOPELESS, _GAIN, _IDLE = 30.0, 0.9, 2
"""Deviance per pixel from which a fit is given up when so many climbs in a row have not brought it below that
share of what it was: it would end far above what passes for a fit, after twenty seconds."""
_TURNING = {"separation", "theta", "contrast"}
"""What says which star is A: where all of it is held, it stays as it was given."""
_PATIENCE, _SLACK = 100, 0.03
"""Steps and tolerance for a locus on a leash, whose likelihood has long flat valleys: what remains of the
way, in standard errors, lies along the valley and moves the separation by less than 0.01 of its error."""
_CONTRADICTION = (
    "The frame contradicts its prior: look where the prior comes from, or fit without; values and errors "
    "assume that both are right."
)
_AT_REST, _NEAR = 0.01, 0.1
"""Standard errors that everything else may have to go: where a streak is at its tip, and in a valley where
the steps ran out (one frame in a hundred)."""


@dataclass(frozen=True)
class FitOptions:
    """What to fit, and what is known.

    Attributes
    ----------
    hold : collection of str
        Parameters to keep at their starting value.  The background is held at zero by default,
        because a detector's bias is subtracted; free it (``hold=()``) where there is sky.
    priors : Priors
    tolerance : float
        Length of a step, in standard errors, below which the fit has arrived; below 1e-4 the optics are as
        much more exact where it ends.
    nodes : int or None
        Of the integral over time, in loci that have no formula and are started by name, as
        :func:`~jitterkit.refit.choose.fit_locus` does; None for as many as they have themselves.
    may_be_still : bool
        Whether :func:`~jitterkit.refit.choose.fit_best_locus` may fit no jitter to a frame that shows none.
    """

    hold: Collection[str] = ("background",)
    priors: Priors = field(default_factory=Priors)
    tolerance: float = _USUAL
    nodes: int | None = None
    may_be_still: bool = False


def unfinished(tolerance: float, locus: Locus, aberrations: bool) -> float:
    """Standard errors by which the separation of a fit may be off where it ends.

    By the tolerance; by rounding, in 32 bits; because a locus is on a leash; and by the linearisation of the
    optics where aberrations vary.  (Where a pixel reaches the floor of the likelihood the way has a kink, at
    which 1e-4 may be left.)
    """
    ends = max(tolerance, _floor(locus))
    return ends + (_SHOWN * settled(ends) if aberrations else 0.0)


def settled(tolerance: float) -> float:
    """Sigmas of the whole image that linearised optics may be off by where a fit to some tolerance ends."""
    return SETTLED * min(1.0, tolerance / _USUAL)


def _floor(locus: Locus) -> float:
    """Standard errors by which no fit ends better."""
    return max(DROWNED if jnp.zeros(()).dtype == jnp.float32 else 0.0, _slack(locus))


def _slack(locus: Locus) -> float:
    return _SLACK if leashes(locus) else 0.0


def fit_frame(
    data: Data,
    optics: Optics,
    start: Parameters,
    otf: OTF | None = None,
    options: FitOptions | None = None,
) -> FitResult:
    """Fit a frame with the locus that ``start`` carries.

    Parameters
    ----------
    data : Data
    optics : Optics
    start : Parameters
        From :func:`jitterkit.locate.locate_binary`, with the locus to fit.
    otf : OTF, optional
        Optics already expanded, about any state.
    options : FitOptions, optional

    Returns
    -------
    result : FitResult
        Its ``crlb`` is the Cramér-Rao bound of this frame; without priors its errors equal it.

    Raises
    ------
    ConfigurationError
        If an option names a parameter that there is not.  A frame that cannot be fitted does not
        raise: its result says so.
    """
    return fit_and_expand(data, optics, start, otf, options)[0]


def fit_and_expand(
    data: Data,
    optics: Optics,
    start: Parameters,
    otf: OTF | None = None,
    options: FitOptions | None = None,
) -> tuple[FitResult, OTF]:
    """Fit a frame, and return the optics expanded where the fit ended too: the next locus starts there."""
    began = time.perf_counter()
    options = FitOptions() if options is None else options
    otf = optics.otf(start.aberrations) if otf is None else otf
    names, free = free_parameters(start, otf, options.hold)
    if int(np.sum(np.asarray(data.used))) <= len(free):
        few = f"{Status.NO_DATA.value}: fewer than the {len(free)} parameters."
        return FitResult(Status.NO_DATA, few), otf
    prior = options.priors.over(names, start.locus)

    def climb_from(data: Data, start: Parameters, otf: OTF) -> tuple[Climb, OTF, int]:
        return _climb_and_expand(data, optics, start, otf, free, prior, options.tolerance)

    clear = data.clear(expected_image(start, otf)) if data.trims else data
    end, otf, iterations = climb_from(clear, start, otf)
    for _ in range(_CLEARINGS if data.trims else 0):
        again = data.clear(expected_image(end.parameters, otf))
        if np.array_equal(again.used, clear.used):
            break
        clear = again
        end, otf, more = climb_from(clear, end.parameters, otf)
        iterations += more
    tidy = end.parameters.scene.tidied() if set(names) & _TURNING else end.parameters.scene
    if not eqx.tree_equal(tidy, end.parameters.scene):  # the covariance must be that of the tidy parameters
        tidied = eqx.tree_at(lambda p: p.scene, end.parameters, tidy)
        end, otf, more = climb_from(clear, tidied, otf)
        iterations += more
    result = _conclude(clear, otf, end, names, iterations, time.perf_counter() - began)
    return _heed(result, options.priors, free, end), otf


def _climb_and_expand(data, optics, start, otf, free, prior, tolerance) -> tuple[Climb, OTF, int]:
    """Climb, and expand the optics where that led, until the expansion serves where the climb ends.

    Where the climbs of two expansions do not close in on one another quickly (in a faint frame, or where an
    aberration shows to second order first, each overshoots), the next is at the place that both point to.
    """
    iterations, before, way, known = 0, np.inf, None, None
    idle, last = 0, np.inf
    enough, tolerance = settled(max(_floor(start.locus), tolerance)), max(_slack(start.locus), tolerance)
    steps = _PATIENCE if leashes(start.locus) else 50
    for _ in range(_EXPANSIONS):
        end = climb(start, otf, data, free, prior, steps=steps, tolerance=tolerance, known=known)
        iterations += int(end.iterations)
        start, known = end.parameters, end.information
        error = linearisation_error(optics, start, otf)
        if error < enough:
            return end, otf, iterations
        level = float(end.objective) / int(np.sum(np.asarray(data.used)))
        idle, last = 0 if level < _GAIN * last else idle + 1, level
        if idle >= _IDLE and level > _HOPELESS:
            break
        here = (np.asarray(otf.state), np.asarray(start.aberrations))
        there = here[1] if way is None or error < _FAST * before else _both_point_to(way, here)
        otf, before, way = optics.otf(there), error, here
    return end._replace(converged=jnp.asarray(False)), otf, iterations


def _both_point_to(before: tuple[np.ndarray, np.ndarray], now: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Where a climb would end where it began, by a straight line through two: ``(began, ended)`` each.

    Anderson's mixing with a memory of one (J. ACM 12, 547, 1965), kept from running away.
    """
    moved, turned = now[1] - now[0], now[1] - now[0] - (before[1] - before[0])
    length = turned @ turned
    share = np.clip(moved @ turned / length, -_AHEAD, _BACK) if length > 0 else 0.0
    return now[1] - share * (now[1] - before[1])


def linearisation_error(optics, parameters: Parameters, otf: OTF) -> float:
    """What the first-order optics get wrong about the image, in sigmas of all its photons together.

    A change of the wavefront by a phase of rms ``q`` changes the image by about ``q²`` of itself beyond
    first order, more in its dark parts; its N photons show a share of ``1/sqrt(N)``.  The factor three
    was measured, on defocus and astigmatism of a plain telescope, where it is worst.
    """
    if not otf.names:
        return 0.0
    phase = optics.phase(np.asarray(parameters.aberrations - otf.state))
    return 3 * float(np.sqrt(abs(float(parameters.scene.flux)))) * phase**2


def _conclude(data, otf, end: Climb, names, iterations, seconds) -> FitResult:
    image = np.asarray(expected_image(end.parameters, otf))
    misfit = pearson(image, data)
    dof = misfit.pixels - len(names)
    covariance, sound = invert_information(end.curvature)
    crlb, _ = invert_information(end.information)
    locus = end.parameters.locus
    tips = at_the_tip(locus, names, covariance) if sound and not bool(end.converged) else set()
    leashed = set(leashes(locus))
    restless = tips | leashed
    tolerance = _NEAR if leashed else _AT_REST
    arrived = bool(end.converged) or (sound and bool(restless) and _arrived(end, names, restless, tolerance))
    flags = [] if abs(misfit.chi2 - dof) < _MISFIT * misfit.spread else ["misfit"]
    flags += [] if sound else ["degenerate"]
    flags += ["jitter_undetected"] if arrived and tips and isinstance(locus, Streak) else []
    flags += ["aberrations_held"] if not set(otf.names) <= set(names) else []
    chi2_dof = misfit.chi2 / dof if dof > 0 else np.nan
    status, message = _verdict(arrived, chi2_dof, sound)
    return FitResult(
        status,
        message,
        tuple(flags),
        parameters=end.parameters,
        names=names,
        covariance=covariance,
        crlb=np.sqrt(np.diag(crlb)),
        chi2=misfit.chi2,
        dof=dof,
        image=image,
        residual=misfit.residual,
        iterations=iterations,
        seconds=seconds,
        objective=float(end.objective),
    )


def _heed(result: FitResult, priors: Priors, free: tuple[int, ...], end: Climb) -> FitResult:
    """The result, with a remark where the frame contradicts the priors it was fitted with."""
    if priors == Priors():
        return result
    at_rest = bool(end.converged)
    ended = at_rest or result.status is Status.OK
    if result.parameters is None or not ended or not np.all(np.isfinite(result.covariance)):
        return result
    remains = np.asarray(end.score) if at_rest else None
    known = (result.parameters, result.names, free, result.covariance, remains)
    if prior_chance(priors, *known) >= CONTRADICTED:
        return result
    message = f"{result.message} {_CONTRADICTION}"
    return replace(result, message=message, flags=(*result.flags, "prior_contradicted"))


def _arrived(end: Climb, names: tuple[str, ...], restless: set[str], tolerance: float) -> bool:
    """Whether everything has come to rest but streaks at their tips and what is on a leash."""
    others = [i for i, name in enumerate(names) if name not in restless]
    score, curvature = np.asarray(end.score)[others], np.asarray(end.curvature)[np.ix_(others, others)]
    return bool(score @ np.linalg.solve(curvature, score) < tolerance**2)


def _verdict(converged: bool, chi2_dof: float, sound: bool) -> tuple[Status, str]:
    if not np.isfinite(chi2_dof) or chi2_dof > POOR:
        return Status.POOR_FIT, f"{Status.POOR_FIT.value}: chi²/dof is {chi2_dof:.4g}."
    if not sound:
        return (
            Status.NOT_CONVERGED,
            "the frame does not determine its parameters: the information is singular.",
        )
    if not converged:
        return Status.NOT_CONVERGED, f"{Status.NOT_CONVERGED.value}."
    return Status.OK, f"{Status.OK.value}: chi²/dof is {chi2_dof:.4g}."
