"""Climb with optics that are exact where the climb ends.

Optics are expanded to first order about a state of the aberrations (:class:`~jitterkit.optics.otf.OTF`).
:func:`climb_and_expand` climbs, expands them anew where that led, and so on, until what the expansion leaves
out cannot be seen.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jitterkit.forward import Parameters
from jitterkit.likelihood import Data
from jitterkit.optics.otf import OTF
from jitterkit.optics.system import Optics
from jitterkit.scoring import Climb, Prior, climb

__all__ = ["SETTLED", "Expanded", "climb_and_expand", "linearisation_error"]

SETTLED = 0.1
"""Sigmas of the whole image that linearised optics may be off by where a fit has ended."""

_FAST, _AHEAD, _BACK = 1 / 16, 1.0, 0.9
"""Share of its error that an expansion leaves where those that follow need no help; how far ahead of the
last climb, and back to the one before, the next may be expanded, in distances of their ends.  Of 480 faint
and bright frames of a small telescope that were started up to 2 rad from their wavefront all settled, after
3.4 expansions each."""

_HOPELESS, _GAIN, _IDLE = 30.0, 0.9, 2
"""Deviance per pixel from which a fit is given up when so many climbs in a row have not brought it below that
share of what it was: it would end far above what passes for a fit, after twenty seconds."""


class Expanded(NamedTuple):
    """Where the climbs ended.

    Attributes
    ----------
    end : Climb
        ``converged`` only if the optics serve there.
    otf : OTF
        In which the last climb was made.
    iterations : int
        Of all climbs.
    """

    end: Climb
    otf: OTF
    iterations: int


def climb_and_expand(
    start: Parameters,
    otf: OTF,
    optics: Optics,
    data: Data,
    free: tuple[int, ...],
    prior: Prior,
    *,
    enough: float = SETTLED,
    expansions: int = 10,
    steps: int = 50,
    tolerance: float = 1e-4,
    known: Float[Array | np.ndarray, "p p"] | None = None,
) -> Expanded:
    """Climb, and expand the optics where that led, until the expansion serves where the climb ends.

    Where the climbs of two expansions do not close in on one another quickly (in a faint frame, or where an
    aberration shows to second order first, each overshoots), the next is at the place that both point to.

    Parameters
    ----------
    start, otf, data, free, prior, steps, tolerance, known
        As for :func:`~jitterkit.scoring.climb`.
    optics : Optics
        Expanded anew where ``otf`` does not serve.
    enough : float
        Sigmas of the whole image that the expansion may be off by, as :func:`linearisation_error` has it.
    expansions : int
        Climbs at most.

    Returns
    -------
    expanded : Expanded
    """
    iterations, before, way = 0, np.inf, None
    idle, last = 0, np.inf
    for left in reversed(range(expansions)):
        end = climb(start, otf, data, free, prior, steps=steps, tolerance=tolerance, known=known)
        end = jax.tree.map(np.asarray, end)  # what follows are small sums, which JAX does slowly
        iterations += int(end.iterations)
        start, known = end.parameters, end.information
        error = linearisation_error(optics, start, otf)
        if error < enough:
            return Expanded(end, otf, iterations)
        level = float(end.objective) / int(np.sum(np.asarray(data.used)))
        idle, last = 0 if level < _GAIN * last else idle + 1, level
        if not left or (idle >= _IDLE and level > _HOPELESS):
            break
        here = (np.asarray(otf.state), np.asarray(start.aberrations))
        there = here[1] if way is None or error < _FAST * before else _both_point_to(way, here)
        otf, before, way = optics.otf(there), error, here
    return Expanded(end._replace(converged=jnp.asarray(False)), otf, iterations)


def _both_point_to(before: tuple[np.ndarray, np.ndarray], now: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Where a climb would end where it began, by a straight line through two: ``(began, ended)`` each.

    Anderson's mixing with a memory of one (J. ACM 12, 547, 1965), kept from running away.
    """
    moved, turned = now[1] - now[0], now[1] - now[0] - (before[1] - before[0])
    length = turned @ turned
    share = np.clip(moved @ turned / length, -_AHEAD, _BACK) if length > 0 else 0.0
    return now[1] - share * (now[1] - before[1])


def linearisation_error(optics: Optics, parameters: Parameters, otf: OTF) -> float:
    """What the first-order optics get wrong about the image, in sigmas of all its photons together.

    A change of the wavefront by a phase of rms ``q`` changes the image by about ``q²`` of itself beyond
    first order, more in its dark parts; its N photons show a share of ``1/sqrt(N)``.  The factor three
    was measured, on defocus and astigmatism of a plain telescope, where it is worst.
    """
    if not otf.names:
        return 0.0
    phase = optics.phase(np.asarray(parameters.aberrations - otf.state[: len(parameters.aberrations)]))
    return 3 * float(np.sqrt(abs(float(parameters.scene.flux)))) * phase**2
