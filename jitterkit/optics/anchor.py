"""The optics about one state, to second order: the exact transfer functions of all states nearby, cheaply.

A telescope changes little from frame to frame.  An :class:`Anchor` costs as much as four first-order
expansions and then replaces those of thousands of frames: one matrix product each, a hundredth of the work.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jitterkit.loci.elliptic import Mvn
from jitterkit.optics.expansion import derivatives_at, shifted
from jitterkit.optics.further import Further
from jitterkit.optics.grid import Grid
from jitterkit.optics.otf import OTF, resized
from jitterkit.optics.system import OpticalSystem
from jitterkit.precision import from_parts, single, to_parts


class SecondOrder(eqx.Module):
    """Second derivatives of a transfer function about a state of its aberrations, per nm², in 32 bits.

    Attributes
    ----------
    curvature : (k, k + s, 2, My, Mx//2 + 1) array
        Derivatives by the k modes of the slopes: of those by the modes, and of those by the s shifts of the
        wavelength and of the plate scale that there are.  Real and imaginary parts; of the modes with both
        halves, because sums over one of them take longer.
    chromatic : (k (k + 1)/2, 2, My, Mx//2 + 1) array or None
        Of the derivative by the spectral index, of the pairs (i, j >= i); None where colour does not matter.
    grid : Grid
        It may be smaller than that of the value: of TOLIMAN's pairs, at the edge of the anchor's reach, an
        image is then off by 8e-5 sigmas of the whole, and by 0.023 with the pair 53 pixels off the middle.
    """

    curvature: Float[Array, "k ks 2 my mx"]
    chromatic: Float[Array, "pairs 2 my mx"] | None
    grid: Grid = eqx.field(static=True)

    @classmethod
    def at(cls, system: OpticalSystem, state: Float[Array, " k"], grid: Grid) -> SecondOrder:
        """Differentiate a system's transfer function at a state [nm], on a grid of its pixels."""
        k, tinted = len(state), system.colours is not None
        where = system.pupil, system.spectrum, grid, state
        spectra = derivatives_at(*where, order=2, chromatic=tinted)[:, k + 1 :]
        pairs = shifted(*where, system.further, order=1)
        shifts = [(ahead - behind)[0, 1:] / (2 * step) for ahead, behind, step in pairs]
        if system.diffusion:
            fy, fx = grid.frequencies
            blur = Mvn.of(system.diffusion).transfer(fx, fy)
            spectra, shifts = spectra * blur, [slopes * blur for slopes in shifts]
        parts = to_parts(spectra).astype(jnp.float32)
        every = [parts[0][_pairs(k)], *(to_parts(slopes).astype(jnp.float32)[:, None] for slopes in shifts)]
        return cls(jnp.concatenate(every, axis=1), parts[1] if tinted else None, grid)

    def rows(self, i, j, grid: Grid) -> Float[Array, "n 2 ny nx"]:
        """Return the second derivatives by pairs of modes, on another grid."""
        return _parts_on(self.curvature[i, j], self.grid, grid)


class Anchor(eqx.Module):
    """A telescope's transfer function to second order about one state of its aberrations.

    Attributes
    ----------
    first : OTF
        The expansion to first order, with tints in 32 bits.
    second : SecondOrder
    further : Further
        What may vary beside the k modes of the pupil.
    """

    first: OTF
    second: SecondOrder
    further: Further = eqx.field(static=True)

    @classmethod
    def at(cls, system: OpticalSystem, state, grid: Grid | None = None) -> Anchor:
        """Expand a system about a state [nm], to second order on a grid, which may be smaller."""
        first = system.otf(state)
        modes = first.state[: len(system.pupil.names)]
        first = replace(first, tints=single(first.tints), difference=None)
        return cls(first, SecondOrder.at(system, modes, grid or system.grid), system.further)

    @property
    def state(self) -> Float[Array, " k"]:
        """Return the modes of the pupil that it is about, nm."""
        return self.first.state[: len(self.second.curvature)]

    def otf(self, aberrations, coarse: Anchor | None = None) -> OTF:
        """Return the first-order expansion about aberrations [nm] near the state.

        Its value is off by what is of third order in their distance, its derivatives by what is of second.

        Parameters
        ----------
        aberrations : (k,) array
            nm.
        coarse : Anchor, optional
            The same on the grid of the second derivatives: the modes then have derivatives on that grid only.
        """
        state, beside = self.further.split(aberrations, len(self.state))
        kind = self.first.state.dtype
        return _renewed(self, state.astype(kind), beside.astype(kind), coarse)

    def within(self, grid: Grid) -> Anchor:
        """Return the anchor on a smaller grid of the same pixels, whose fine sides are even or odd alike.

        The point spread function is cut there; what it has beyond is lost.
        """
        second = self.second if self.second.grid == grid else _second_on(self.second, grid)
        return Anchor(_first_on(self.first, grid), second, self.further)


@eqx.filter_jit
def _second_on(second: SecondOrder, grid: Grid) -> SecondOrder:
    return replace(jax.tree.map(lambda rows: _parts_on(rows, second.grid, grid), second), grid=grid)


@eqx.filter_jit
def _first_on(first: OTF, grid: Grid) -> OTF:
    return replace(
        first,
        value=resized(first.value, first.grid, grid),
        slopes=_parts_on(first.slopes, first.grid, grid),
        tints=None if first.tints is None else _parts_on(first.tints, first.grid, grid),
        bend=None if first.bend is None else resized(first.bend, first.grid, grid),
        grid=grid,
    )


def _parts_on(parts, grid: Grid, other: Grid):
    """Return parts of spectra on another grid."""
    if grid.fine_shape == other.fine_shape:
        return parts
    return to_parts(resized(from_parts(parts), grid, other)).astype(parts.dtype)


@eqx.filter_jit
def on_grid(otf: OTF, grid: Grid) -> OTF:
    """Return optics without derivatives on a grid, which may be smaller as in :meth:`Anchor.within`."""
    return OTF(resized(otf.value, otf.grid, grid), otf.slopes[:0], otf.state[:0], grid, ())


class _Bends(NamedTuple):
    """Hold what the second order adds, on its grid.

    Attributes
    ----------
    values : (1 or 2, m) array
        To the value for A, and for B where its wavefront may differ.
    slopes : (k + s, m) array
    tint : (m) array or None
        To the derivative by the spectral index.
    """

    values: Array
    slopes: Array
    tint: Array | None


@eqx.filter_jit
def _renewed(anchor: Anchor, state, beside, coarse: Anchor | None) -> OTF:
    change, second = state - anchor.state, (coarse or anchor).second
    own = change[None]
    if anchor.further.of_b:
        own = jnp.stack([change, change.at[np.array(anchor.first.of_b)].add(beside)])
    bends = _bends(second, own.astype(second.curvature.dtype))
    everything = jnp.concatenate([state, jnp.zeros(len(bends.slopes) - len(state)), beside])
    where = everything, own, bends
    if coarse is None:
        return _expansion(anchor.first, second.grid, *where)
    modes = _expansion(coarse.first, second.grid, *single(where))
    return replace(_expansion(anchor.first, second.grid, *where, apart=True), coarse=modes)


def _bends(second: SecondOrder, own) -> _Bends:
    """Return what the second order adds at some distances (1 or 2, k) from the state."""
    k, slopes = own.shape[1], _sums(own, second.curvature)
    values = jnp.stack([_first_sum(one / 2, bend) for one, bend in zip(own, slopes, strict=True)])
    if second.chromatic is None:
        return _Bends(values, slopes[0], None)
    change, (i, j) = own[0], np.triu_indices(k)
    weights = change[i] * change[j] / np.where(i == j, 2, 1).astype(change.dtype)
    return _Bends(values, slopes[0], _sums(weights, second.chromatic))


def _expansion(first: OTF, grid: Grid, state, own, bends: _Bends, *, apart: bool = False) -> OTF:
    """Return an expansion at another state: what the second order adds to the first is on a grid.

    Rows of the modes are left out where they are apart.
    """
    change, kind, k = own[0], own.dtype, own.shape[1]

    def here(parts):
        return _parts_on(parts, grid, first.grid).astype(kind)

    rows, tints = slice(k if apart else 0, None), first.tints
    values = from_parts(to_parts(first.value) + _first_sum(own, first.slopes) + here(bends.values))
    if tints is not None:
        weights = jnp.concatenate([jnp.ones(1, kind), change]).astype(tints.dtype)
        tint = _first_sum(weights, tints).astype(kind) + here(bends.tint)
        tints = jnp.concatenate([tint[None], tints[1:][rows].astype(kind)])
    return replace(
        first,
        value=values[0],
        slopes=first.slopes[rows] + here(bends.slopes[rows]),
        state=state,
        tints=tints,
        difference=values[1] - values[0] if first.of_b else None,
    )


def _sums(weights, rows):
    """Sum rows with weights; a GPU would take half the digits."""
    return jnp.tensordot(weights, rows, 1, precision="highest")


def _first_sum(weights, rows):
    """Sum the first rows with weights."""
    # a slice is copied, which takes longer than the sum
    none = jnp.zeros((*weights.shape[:-1], len(rows) - weights.shape[-1]), weights.dtype)
    return _sums(jnp.concatenate([weights, none], axis=-1), rows)


def _pairs(k: int) -> np.ndarray:
    """Positions (k, k) of pairs of modes among the pairs (i, j >= i) in order."""
    positions = np.zeros((k, k), int)
    i, j = np.triu_indices(k)
    positions[i, j] = positions[j, i] = np.arange(len(i))
    return positions
