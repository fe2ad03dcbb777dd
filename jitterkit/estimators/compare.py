"""The one compiled program that compares frames with the one that they repeat.

Reach for :class:`~jitterkit.estimators.repeat.Repeat`, which judges what comes of it.  Frames and
derivatives, what is summed over pixels and what is only to come near are in 32 bits; the images at the end,
and what moves them, are not.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from operator import itemgetter
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jitterkit.estimators.first import (
    SPARE,
    First,
    Fourth,
    invert,
    moved,
    offset_of,
    within,
)
from jitterkit.estimators.register import at_first, cut_out
from jitterkit.estimators.shape import is_decisive
from jitterkit.forward import Parameters, expected_image, image_and_jacobian
from jitterkit.likelihood import Data, chi_squared, equations_of, is_clear
from jitterkit.loci import Shaped
from jitterkit.optics.otf import OTF
from jitterkit.precision import in_single, single

__all__ = ["SETTLED", "End", "compared", "several"]

_PIXELS, _MOST = 2**18, 16
"""Pixels of the frames that are compared together, and how many of these there are at most: the smaller they
are, the more of the time is Python's."""

_FAR, _CLOSE = 4, 2
"""Steps by the derivatives of the first frame, and by its own."""

SETTLED = 0.05
"""Standard errors that a further step may be long."""

_SHAPELESS = 0.2
"""Excess kurtosis up to which the derivatives at none serve."""

_NEARBY, _EXPANSIONS = 3.0, 4
"""Standard errors that the step from an expansion may be long, and how often one is made: from 4 to
36 away the errors are off by 3 to 10 %, and from 400 away a shape seems to be told."""

_AT_ONCE = 0.5
"""Standard errors that the step from an expansion at a blur's own shape may be long: its errors are those of
where it is made, and one from a normal's shape is off by up to 4 %."""

_BRIGHTER = 3.0
"""Factor by which light may differ: a cut-out that does for a faint frame leaves out much of a bright one."""


class End(NamedTuple):
    """Where a few steps of scoring lead, and what is left there.

    Attributes
    ----------
    parameters : Parameters
        With a ``Shaped`` locus.
    values : (p,) array
        Those of the parameters that are fitted; no kurtosis (zero) while it says little.
    score : (p,) array
    remains : float
        Length of the next step, in standard errors.
    excess : float
        Of chi-squared over what is expected of it, in standard deviations; infinite where the frame is too
        unlike the first for the rest to be believed.
    information : (p, p) array
        At the normal blur; at the blur's own, where its shape is told and is another.
    """

    parameters: Parameters
    values: Float[Array, " p"]
    score: Float[Array, " p"]
    remains: Float[Array, ""]
    excess: Float[Array, ""]
    information: Float[Array, "p p"]


def several(shape: tuple[int, ...]) -> int:
    """How many frames of a shape ``(ny, nx)`` are best compared together."""
    return int(np.clip(_PIXELS // (shape[0] * shape[1]), 1, _MOST))


def compared(first: First, frames: Sequence[Data], size: int) -> list[End]:
    """Find pair, wavefront and blur of frames that repeat the first one, in a few steps of scoring.

    Parameters
    ----------
    first : First
    frames : sequence of Data
        Of its shape.
    size : int
        How many are compared together; another number is another program to compile.

    Returns
    -------
    ends : list of End
        With arrays of NumPy's.
    """
    kinds: dict[bool, list[int]] = {}
    for place, data in enumerate(frames):
        kinds.setdefault(data.response is None, []).append(place)
    ends: dict[int, End] = {}
    for places in kinds.values():
        for some in (places[n : n + size] for n in range(0, len(places), size)):
            stack = _stack([frames[place] for place in some], size)
            found = jax.tree.map(np.asarray, _each(first, stack, len(some)))
            ends |= {place: jax.tree.map(itemgetter(n), found) for n, place in enumerate(some)}
    return [ends[place] for place in range(len(frames))]


def _stack(frames: Sequence[Data], size: int) -> Data:
    """Frames one above the other, and room for as many as there are at most; numbers in 32 bits.

    All have a response or none.  Where one has no ceiling it gets an infinite one, and what is full is left
    out with what is near the ceiling, so that one program does for all.
    """

    def stacked(*arrays):
        if any(array is None for array in arrays):
            return None
        stack = np.empty((size, *arrays[0].shape), in_single(arrays[0]))
        stack[: len(arrays)] = arrays
        return stack

    stack = jax.tree.map(stacked, *frames, is_leaf=lambda part: part is None)
    ceiling = np.full(stack.electrons.shape, np.inf, np.float32)
    for place, data in enumerate(frames):
        if data.ceiling is not None:
            ceiling[place] = data.ceiling
    return eqx.tree_at(
        lambda data: (data.ceiling, data.full), stack, (ceiling, None), is_leaf=lambda part: part is None
    )


@jax.jit
def _each(first: First, stack: Data, count) -> End:
    """Compare the first ``count`` of a stack of frames, one after the other."""

    def one(n):
        return _compared(first, jax.tree.map(itemgetter(n), stack))

    def put(n, ends):
        return jax.tree.map(lambda every, end: every.at[n].set(end), ends, one(n))

    none = _none_of(jax.eval_shape(one, 0), len(stack.used))
    return jax.lax.fori_loop(0, count, put, none)


def _none_of(shapes, *room):
    """Zeros for a loop to begin with, shaped as what it makes, with room for several."""
    return jax.tree.map(lambda shape: jnp.zeros((*room, *shape.shape), shape.dtype), shapes)


@jax.jit
def _compared(first: First, data: Data) -> End:
    size, whole = first.otf.grid.shape, data.used.shape
    data, near, corner, shift = cut_out(first, data)
    seen, light = at_first(data, near, shift)
    values, normal = _near(first, seen), np.arange(len(first.names)) != first.kurtosis
    places = np.array([first.names.index(name) for name in ("y", "x")])
    bright = np.array([name in ("flux", "background") for name in first.names])
    values = jnp.where(bright, light * values, values).at[places].add(shift * first.otf.grid.pitch)

    def by_a_normal(state):  # arrays of pixels are not carried on: they would be copied at each turn
        _, values, _, n = state
        here = _expanded(first, data, values)
        step = here.step(normal)
        _, errors = invert(here.information, normal | True)
        end = _closer(first, here, normal | is_decisive(errors[first.kurtosis]))
        return end, values + step, jnp.sqrt(here.score @ step), n + 1

    nothing = _none_of(jax.eval_shape(by_a_normal, (0, values, 0, 0))[0])
    begin = nothing, values, jnp.inf, 0
    end, _, length, _ = jax.lax.while_loop(
        lambda it: (it[2] > _NEARBY) & (it[3] < _EXPANSIONS), by_a_normal, begin
    )
    alike = jnp.all(jnp.abs(shift) < SPARE) & (light < _BRIGHTER) & (light > 1 / _BRIGHTER)
    alike &= length < _NEARBY

    _, errors = invert(end.information, normal | True)
    shape, shape_err = jnp.abs(end.values[first.kurtosis]), errors[first.kurtosis]
    far = (shape >= jnp.maximum(_SHAPELESS, 2 * shape_err)) | (end.remains >= SETTLED)

    def by_its_own_shape(state):
        end, _, n = state
        here = _expanded(first, data, end.values, Shaped)
        return _closer(first, here, normal | True), here.length(normal | True) > _AT_ONCE, n + 1

    start = end, is_decisive(shape_err) & far, 0
    end, far, _ = jax.lax.while_loop(lambda it: it[1] & (it[2] < _EXPANSIONS), by_its_own_shape, start)
    alike &= ~far
    offset = offset_of(corner, size, whole) * first.otf.grid.plate_scale
    excess = jnp.where(alike, end.excess, jnp.inf)
    return end._replace(parameters=moved(end.parameters, offset), excess=excess)


def _near(first: First, seen):
    """Values that nearly fit, by the derivatives of the first frame.

    With derivatives of another frame each step leaves a share of what was left before.  From the second on
    that share is foreseen along the last step (Anderson, J. ACM 12, 547, 1965): four such steps come as near
    as six plain ones.
    """
    values, before = first.values, None
    for _ in range(_FAR):
        image = expected_image(*single((first.at(values), first.otf)))
        score = jnp.tensordot(first.slopes, within(first.rim, seen - image), 2)
        step = first.covariance @ score.astype(values.dtype)
        there = (step, score, values + step)
        values = values + step
        if before is not None:
            turn, bend, way = (now - then for now, then in zip(there, before, strict=True))
            length = turn @ bend
            values = values - jnp.where(length > 0, turn @ score / length, 0.0) * way
        before = there
    return values


class _Expansion(NamedTuple):
    """A frame about values of what is fitted.

    Attributes
    ----------
    values : (p,) array
    otf : OTF
    seen : Data
        Of the frame, within the rim, with the pixels that are used there.
    jacobian : (p, my, mx) array
        Of the image, likewise.
    score : (p,) array
    information : (p, p) array
    """

    values: Float[Array, " p"]
    otf: OTF
    seen: Data
    jacobian: Float[Array, "p my mx"]
    score: Float[Array, " p"]
    information: Float[Array, "p p"]

    def step(self, varied):
        """The scoring step of what is varied."""
        return invert(self.information, varied)[0] @ self.score

    def length(self, varied):
        """Its length in standard errors."""
        return jnp.sqrt(self.score @ self.step(varied))


def _expanded(first: First, data: Data, values, locus: type[Shaped] = Fourth) -> _Expansion:
    here, inner = _with(locus, first.at(values)), partial(within, first.rim)
    otf = first.anchor.otf(here.aberrations)
    # in 32 bits the derivatives of a streak of three times the resolution are not good enough
    parameters, optics = (here, otf) if locus is Shaped else single((here, otf))
    cut = single(jax.tree.map(inner, image_and_jacobian(parameters, optics, first.free)))
    image, jacobian = jax.lax.optimization_barrier(cut)  # or it is cut out anew wherever it is used
    seen = jax.tree.map(inner, data)
    parts, clear = (lambda d: (d.used, d.ceiling, d.full)), (is_clear(image, seen), None, None)
    seen = eqx.tree_at(parts, seen, clear, is_leaf=lambda part: part is None)
    _, score, information = equations_of(image, jacobian, seen)
    kind = values.dtype
    return _Expansion(values, otf, seen, jacobian, score.astype(kind), information.astype(kind))


def _closer(first: First, here: _Expansion, varied) -> End:
    """A few steps of what is varied, by the derivatives of an expansion."""
    covariance, _ = invert(here.information, varied)
    values, score = here.values, here.score
    for _ in range(_CLOSE):
        values = values + covariance @ score
        end = _with(Shaped, first.at(values))
        image = single(within(first.rim, expected_image(end, here.otf)))
        score = equations_of(image, here.jacobian, here.seen).score
    chi2, pixels, spread = chi_squared(image, here.seen)
    remains = jnp.sqrt(score @ covariance @ score)
    return End(end, values, score, remains, (chi2 - pixels) / spread, here.information)


def _with(locus: type[Shaped], parameters: Parameters) -> Parameters:
    return parameters.with_locus(locus(parameters.locus.coords))
