"""Aberrations that an image shows by their squares.

A pupil that is its own mirror image shows focus and astigmatism by their squares and products, which widen
the image.  No fit makes a square negative: where noise asks for that, zero is the least, and so on average
too much is taken from the jitter.  Moments of a still star behind 18 hexagons were low by 0.6 of an error, in
every frame alike.  :func:`free_squares` lets squares and products have either sign.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import replace
from itertools import combinations_with_replacement
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jitterkit.forward import Parameters, held_with, parameter_names, to_vector
from jitterkit.likelihood import Data, normal_equations
from jitterkit.loci.base import moments_and_slope
from jitterkit.metric import Prior, invert_information
from jitterkit.optics import AnchoredOptics, OpticalSystem, Optics
from jitterkit.optics.otf import OTF

_REACH = 4.0
"""Of the spread of a mode that only its square shows: noise hardly makes larger values."""

_STEP = 0.03
"""rad rms of a mode, for second derivatives, which are off by the square of it."""

_SEEN = 3.0
"""Times that such a spread must be as large as the error by the mode's effect in proportion, about zero, for
the square not to matter: its share of the effect of an error is the inverse square of this."""


class FreeSquares(NamedTuple):
    """Hold what changes if squares and products of aberrations may have either sign.

    Attributes
    ----------
    places : (k,) int array
        Of the parameters that change, among those that were fitted: all but such aberrations.
    change : (k,) array
        In the units of the parameters.
    covariance : (k, k) array
        Of their new values.
    names : tuple of str
        Of everything that the step varies, such aberrations and their products included.
    step : (q,) array
        The way from there.
    whole : (q, q) array
        Covariance of their new values.
    moments : (3, q) array
        Derivatives of the moments ``(Sxx, Sxy, Syy)`` by them.
    frame : _Frame
        Where the frame was fitted.
    """

    places: np.ndarray
    change: np.ndarray
    covariance: np.ndarray
    names: tuple[str, ...]
    step: np.ndarray
    whole: np.ndarray
    moments: np.ndarray
    frame: _Frame

    def added_to(
        self, parameters: Parameters, names: tuple[str, ...], aberrations: tuple[str, ...]
    ) -> Parameters:
        """Return the parameters with the changes, where those of the given names were fitted."""
        vector, rebuild = to_vector(parameters)
        every = parameter_names(parameters, aberrations)
        values = np.array(vector)
        values[[every.index(names[i]) for i in self.places]] += self.change
        return jax.tree.map(np.asarray, rebuild(values))  # what follows are small sums

    def score_of(self, data: Data) -> np.ndarray:
        """Return the slope (q,) of other data's log-likelihood, where the frame was fitted."""
        frame = self.frame
        score, _ = _told(frame.parameters, frame.otf, frame.names, data)
        return score[[frame.names.index(name) for name in self.names]]


PriorOver = Callable[..., Prior]
"""The prior on parameters of given names, and on what a locus fits where one is given too."""


def free_squares(
    parameters: Parameters,
    names: tuple[str, ...],
    data: Data,
    optics: Optics,
    hold: Collection[str] = (),
    prior_over: PriorOver = lambda names, locus=None: Prior.none(len(names)),
) -> FreeSquares | None:
    """Take a step of scoring from a fit in everything that was fitted, with squares and products free.

    Parameters
    ----------
    parameters : Parameters
        That fit the frame.
    names : tuple of str
        Of those that were fitted.
    data : Data
        That were fitted.
    optics : Optics
    hold : collection of str
        Parameters that were kept.
    prior_over : callable
        As :meth:`jitterkit.refit.Priors.over`; by default nothing is known.

    Returns
    -------
    free : FreeSquares or None
        None if no mode shows by its square only, or the frame does not determine them all.

    Notes
    -----
    A mode does if its own effect about zero tells less of it than three times what its square does, and if
    its value may be noise.  One that is known better beforehand does not matter.  Left out are modes in which
    B differs, and data that allow for an error of the model.
    """
    system = optics.system
    if not isinstance(system, OpticalSystem) or data.model_variance is not None:
        return None
    modes, value, held = system.names, np.array(parameters.aberrations), held_with(hold)
    even = chosen = [i for i in system.even_modes if modes[i] not in held]
    if not even:
        return None
    every = tuple(dict.fromkeys((*names, *modes)))
    known = dict(zip(every, np.diag(prior_over(every).precision), strict=True))
    otf = _with_squares(optics, value, even, system.mode_phases)
    while chosen:
        frame = _Frame.of(parameters, names, data, _about_zero(otf, value, even, chosen), even)
        by_itself, by_square = frame.information_on(chosen, names, prior_over)
        spread = by_square**-0.25
        unseen = [
            i
            for i, size, told in zip(chosen, spread, by_itself, strict=True)
            if abs(value[i]) < _REACH * size and told * size**2 < _SEEN**2 and known[modes[i]] * size**2 < 1
        ]
        if unseen == chosen:
            bounds = dict(zip(chosen, _REACH * spread, strict=True))
            return frame.solved(parameters, names, prior_over, bounds)
        chosen = unseen
    return None


def _product(names: tuple[str, ...], i: int, j: int) -> str:
    """Return the name of the product of two modes."""
    return f"{names[i]} {names[j]}"


def _with_squares(optics: Optics, state: np.ndarray, even: list[int], phase: np.ndarray) -> OTF:
    """Return optics about a state whose first aberrations are changes of products of pairs of modes [nm²]."""
    otf, pairs = optics.otf(state), list(combinations_with_replacement(even, 2))
    rows_of = otf.coarse or otf
    if isinstance(optics, AnchoredOptics):
        i, j = np.transpose(pairs)
        halves = np.where(i == j, 0.5, 1.0)[:, None, None, None]
        rows = np.asarray(optics.anchor.second.rows(i, j, rows_of.grid)) * halves
    else:
        products = np.stack(_products(optics.system, otf, state, pairs, _STEP / phase))
        rows = np.stack([products.real, products.imag], axis=1)
    tints, slopes = rows_of.tints, np.asarray(rows_of.slopes)
    if tints is not None:
        tints = jnp.asarray(np.insert(tints, np.ones(len(pairs), int), 0.0, axis=0))
    rows_of = replace(
        rows_of, slopes=jnp.asarray(np.concatenate([rows.astype(slopes.dtype), slopes])), tints=tints
    )

    def named(one: OTF) -> OTF:
        state = jnp.asarray(np.concatenate([np.zeros(len(pairs), one.state.dtype), one.state]))
        names = (*(_product(one.names, i, j) for i, j in pairs), *one.names)
        return replace(one, state=state, names=names, of_b=tuple(place + len(pairs) for place in one.of_b))

    return named(rows_of) if otf.coarse is None else replace(named(otf), coarse=named(rows_of))


def _about_zero(otf: OTF, state: np.ndarray, even: list[int], modes: list[int]) -> OTF:
    """Return such optics with the slopes that modes [nm] have where they are zero.

    A step from the fit is right where they are real; from zero, it would be off by their fourth powers.
    """
    pairs, rows_of = list(combinations_with_replacement(even, 2)), otf.coarse or otf
    slopes = np.array(rows_of.slopes)
    for row, (i, j) in zip(slopes, pairs, strict=False):
        if i in modes and j in modes:
            slopes[len(pairs) + i] -= row * state[j]
            slopes[len(pairs) + j] -= row * state[i]
    rows_of = replace(rows_of, slopes=jnp.asarray(slopes))
    return rows_of if otf.coarse is None else replace(otf, coarse=rows_of)


def _products(optics: Optics, otf: OTF, state: np.ndarray, pairs: list[tuple[int, int]], steps: np.ndarray):
    """Return the changes of a transfer function by products of modes, per nm², by differences of itself.

    It is exact, and cheap beside its derivatives.
    """

    def even_part(modes: set[int]):
        step = np.zeros_like(state)
        step[list(modes)] = steps[list(modes)]
        nearby = (optics.otf(state + way, derivatives=False) for way in (step, -step))
        ahead, behind = (np.asarray(one.value) for one in nearby)
        return (ahead + behind) / 2 - np.asarray(otf.value)

    alone = {i: even_part({i}) for i, j in pairs if i == j}
    both = (alone[i] if i == j else even_part({i, j}) - alone[i] - alone[j] for i, j in pairs)
    return [change / (steps[i] * steps[j]) for change, (i, j) in zip(both, pairs, strict=True)]


def _told(
    parameters: Parameters, otf: OTF, names: tuple[str, ...], data: Data
) -> tuple[np.ndarray, np.ndarray]:
    """Return what data say of parameters of some names: score (q,) and information (q, q)."""
    every = parameter_names(parameters, otf.names)
    free = tuple(every.index(name) for name in names)
    equations = normal_equations(parameters, otf, data, free, exact=False)
    return np.asarray(equations.score), np.asarray(equations.information)


class _Frame(NamedTuple):
    """Hold what a frame says, about a fit, of everything that was fitted and of products of modes.

    Attributes
    ----------
    parameters : Parameters
        With products of modes, which are zero.
    otf : OTF
        That has them.
    optics : tuple of str
        Names of the aberrations.
    names : tuple of str
        Of what follows: what was fitted, modes that may show by their squares, and their products.
    values, score, information : (q,), (q,), (q, q) array
    """

    parameters: Parameters
    otf: OTF
    optics: tuple[str, ...]
    names: tuple[str, ...]
    values: np.ndarray
    score: np.ndarray
    information: np.ndarray

    @classmethod
    def of(
        cls,
        parameters: Parameters,
        names: tuple[str, ...],
        data: Data,
        otf: OTF,
        even: list[int],
    ) -> _Frame:
        """Evaluate a fit by optics that have products of even modes."""
        count = len(otf.names) - len(parameters.aberrations)
        products, optics = otf.names[:count], otf.names[count:]
        aberrations = np.concatenate([np.zeros(count), parameters.aberrations])
        parameters = eqx.tree_at(lambda p: p.aberrations, parameters, aberrations)
        every = parameter_names(parameters, otf.names)
        wanted = {*names, *products, *(optics[i] for i in even)}
        asked = tuple(name for name in every if name in wanted)
        values = np.asarray(to_vector(parameters)[0])[[every.index(name) for name in asked]]
        return cls(parameters, otf, optics, asked, values, *_told(parameters, otf, asked, data))

    def information_on(
        self, modes: list[int], fitted: tuple[str, ...], prior_over: PriorOver
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the information on modes and on their squares, all else that was fitted unknown."""
        asked = [self.names.index(self.optics[i]) for i in modes]
        asked += [self.names.index(_product(self.optics, i, i)) for i in modes]
        others = [i for i, name in enumerate(self.names) if name in fitted and i not in asked]
        across, known = self.information[np.ix_(others, asked)], prior_over(self.names).precision
        inverse, _ = invert_information((self.information + known)[np.ix_(others, others)])
        told = np.diag(self.information)[asked] - np.sum(across * (inverse @ across), axis=0)
        by_itself, by_square = np.split(np.maximum(told, np.finfo(float).tiny), 2)
        return by_itself, by_square

    def solved(
        self,
        parameters: Parameters,
        fitted: tuple[str, ...],
        prior_over: PriorOver,
        bounds: dict[int, float],
    ) -> FreeSquares | None:
        """Return the changes by a step in which products of modes are free.

        Parameters
        ----------
        parameters, fitted, prior_over
            As for :func:`free_squares`.
        bounds : dict
            Of the modes, by their places: 1 sigma, nm.
        """
        weak = {self.optics[i]: bound for i, bound in bounds.items()}
        for i, j in combinations_with_replacement(bounds, 2):
            weak[_product(self.optics, i, j)] = bounds[i] * bounds[j]
        index = [i for i, name in enumerate(self.names) if name in fitted or name in weak]
        names, locus = tuple(self.names[i] for i in index), parameters.locus
        moments, by_coordinates = map(np.asarray, moments_and_slope(locus))
        slope = np.zeros((3, len(names)))
        for column, name in enumerate(locus.names):
            if name in names:
                slope[:, names.index(name)] = by_coordinates[:, column]
        prior = prior_over(names, locus)
        pull = prior.precision @ (self.values[index] - prior.mean)
        pull += slope.T @ prior.moments_precision @ (moments - prior.moments)
        known = prior.stiffness(slope) + np.diag([weak.get(name, np.inf) ** -2.0 for name in names])
        covariance, sound = invert_information(self.information[np.ix_(index, index)] + known)
        if not sound:
            return None
        step = covariance @ (self.score[index] - pull)
        free = np.array([i for i, name in enumerate(fitted) if name not in weak])
        mine = [names.index(fitted[i]) for i in free]
        own = covariance[np.ix_(mine, mine)]
        return FreeSquares(free, step[mine], own, names, step, covariance, slope, self)
