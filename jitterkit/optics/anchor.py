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
from jitterkit.optics.colours import Colours
from jitterkit.optics.expansion import derivatives_at, shift_effects
from jitterkit.optics.further import Further, with_further
from jitterkit.optics.grid import Grid
from jitterkit.optics.otf import OTF, resized
from jitterkit.optics.system import OpticalSystem
from jitterkit.precision import from_parts, single, to_parts


class SecondOrder(eqx.Module):
    """Second derivatives of a transfer function by the aberrations, per nm², in 32 bits.

    Attributes
    ----------
    curvature : (k, k, 2, My, Mx//2 + 1) array
        Real and imaginary parts; with both halves, because sums over one of them take longer.
    chromatic : (k (k + 1)/2, 2, My, Mx//2 + 1) array or None
        Of the derivative by the spectral index, of the pairs (i, j >= i); None where colour does not matter.
    grid : Grid
        It may be smaller than that of the value: of TOLIMAN's pairs, at the edge of the anchor's reach, an
        image is then off by 8e-5 sigmas of the whole, and by 0.023 with the pair 53 pixels off the middle.
    """

    curvature: Float[Array, "k k 2 my mx"]
    chromatic: Float[Array, "pairs 2 my mx"] | None
    grid: Grid = eqx.field(static=True)

    def rows(self, i, j, grid: Grid) -> Float[Array, "n 2 ny nx"]:
        """Return the second derivatives by pairs of modes, on another grid."""
        return _parts_on(self.curvature[i, j], self.grid, grid)


class Anchor(eqx.Module):
    """A telescope's transfer function to second order about one state of its aberrations.

    Of every spectrum there are real and imaginary parts, (2, My, Mx//2 + 1), below (m).

    Attributes
    ----------
    value : (m) array
    slopes : (k, m) array
        First derivatives, per nm.
    second : SecondOrder
    state : (k,) array
        nm.
    chromatic : (1 + k, m) array or None
        Derivatives of value and slopes by the spectral index of a source, in 32 bits; None where its colour
        does not matter.
    shifts : (1 + k, s, m) array
        Derivatives of value and slopes by the shifts of the wavelength and of the plate scale, those there
        are.
    tinted_shifts : (s, m) array or None
        Derivative of that of the value by the spectral index.
    bend : (m) array or None
        Second derivative of the value by the shift of the wavelength, in 32 bits.
    grid : Grid
    names : tuple of str
        Of the aberrations.
    colours : Colours or None
    further : Further
        What may vary beside them.
    """

    value: Float[Array, "2 my mx"]
    slopes: Float[Array, "k 2 my mx"]
    second: SecondOrder
    state: Float[Array, " k"]
    chromatic: Float[Array, "k1 2 my mx"] | None
    shifts: Float[Array, "k1 s 2 my mx"]
    tinted_shifts: Float[Array, "s 2 my mx"] | None
    bend: Float[Array, "2 my mx"] | None
    grid: Grid = eqx.field(static=True)
    names: tuple[str, ...] = eqx.field(static=True)
    colours: Colours | None = eqx.field(static=True)
    further: Further = eqx.field(static=True)

    @classmethod
    def at(cls, system: OpticalSystem, state) -> Anchor:
        """Expand a system about a state [nm]."""
        grid, names = system.grid, system.pupil.names
        state, k = jnp.asarray(system.further.split(state, len(names))[0]), len(names)
        tinted = system.colours is not None
        spectra = derivatives_at(system.pupil, system.spectrum, grid, state, order=2, chromatic=tinted)
        where = system.pupil, system.spectrum, grid, state, system.further
        shifts, bend = shift_effects(*where, spectra[0, 0], order=1, chromatic=tinted)
        if system.diffusion:
            fy, fx = grid.frequencies
            blur = Mvn.of(system.diffusion).transfer(fx, fy)
            spectra, shifts = spectra * blur, shifts * blur
            bend = None if bend is None else bend * blur
        parts = to_parts(spectra)
        tints = parts[1].astype(jnp.float32) if tinted else None
        curvature = parts[0, k + 1 :].astype(jnp.float32)[_pairs(k)]
        return cls(
            parts[0, 0],
            parts[0, 1 : k + 1],
            SecondOrder(curvature, None if tints is None else tints[k + 1 :], grid),
            state,
            None if tints is None else tints[: k + 1],
            jnp.swapaxes(to_parts(shifts[0]), 0, 1),
            to_parts(shifts[1, :, 0]) if tinted else None,
            None if bend is None else to_parts(bend).astype(jnp.float32),
            grid,
            names,
            system.colours,
            system.further,
        )

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
        state, beside = self.further.split(aberrations, len(self.names))
        return _renewed(self, state.astype(self.state.dtype), beside.astype(self.state.dtype), coarse)

    def within(self, grid: Grid) -> Anchor:
        """Return the anchor on a smaller grid of the same pixels, whose fine sides are even or odd alike.

        The point spread function is cut there; what it has beyond is lost.
        """
        return _cut(self, grid)


@eqx.filter_jit
def _cut(anchor: Anchor, grid: Grid) -> Anchor:
    second = jax.tree.map(lambda rows: _parts_on(rows, anchor.second.grid, grid), anchor.second)
    first = eqx.tree_at(lambda a: (a.state, a.second), anchor, (None, None))
    first = jax.tree.map(lambda rows: _parts_on(rows, anchor.grid, grid), first)
    return replace(first, state=anchor.state, second=replace(second, grid=grid), grid=grid)


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
    slopes : (k, m) array
    tint : (m) array or None
        To the derivative by the spectral index.
    """

    values: Array
    slopes: Array
    tint: Array | None


@eqx.filter_jit
def _renewed(anchor: Anchor, aberrations, beside, coarse: Anchor | None) -> OTF:
    change, second = aberrations - anchor.state, (coarse or anchor).second
    own = change[None]
    if anchor.further.of_b:
        own = jnp.stack([change, change.at[_positions(anchor)].add(beside)])
    bends = _bends(second, own.astype(second.curvature.dtype))
    where = aberrations, beside, own, bends
    if coarse is None:
        return _expansion(anchor, second.grid, *where)
    modes = _expansion(coarse, second.grid, *single(where))
    return replace(_expansion(anchor, second.grid, *where, apart=True), coarse=modes)


def _bends(second: SecondOrder, own) -> _Bends:
    """Return what the second order adds at some distances (1 or 2, k) from the state."""
    slopes = _sums(own, second.curvature)
    values = jnp.stack([_sums(one / 2, bend) for one, bend in zip(own, slopes, strict=True)])
    if second.chromatic is None:
        return _Bends(values, slopes[0], None)
    change, (i, j) = own[0], np.triu_indices(own.shape[1])
    weights = change[i] * change[j] / np.where(i == j, 2, 1).astype(change.dtype)
    return _Bends(values, slopes[0], _sums(weights, second.chromatic))


def _expansion(
    anchor: Anchor, grid: Grid, aberrations, beside, own, bends: _Bends, *, apart: bool = False
) -> OTF:
    """Return the expansion of the first order and of what the second adds, which is on a grid.

    Rows of the modes are left out where they are apart.
    """
    change, further, kind = own[0], anchor.further, own.dtype

    def here(parts):
        return _parts_on(parts, grid, anchor.grid).astype(kind)

    values = from_parts(anchor.value + jnp.tensordot(own, anchor.slopes, 1) + here(bends.values))
    tints = None
    if anchor.chromatic is not None:
        assert bends.tint is not None
        weights = jnp.concatenate([jnp.ones(1, kind), change]).astype(anchor.chromatic.dtype)
        tints = (_sums(weights, anchor.chromatic).astype(kind) + here(bends.tint))[None]
        tints = tints if apart else jnp.concatenate([tints, anchor.chromatic[1:].astype(kind)])
    otf = OTF(
        values[0],
        anchor.slopes[:0] if apart else anchor.slopes + here(bends.slopes),
        aberrations,
        anchor.grid,
        anchor.names,
        tints=tints,
        colours=anchor.colours,
        sigmas=further.sigmas[: further.shadings],
    )
    if not further.names:
        return otf
    shifts = [_sums(jnp.concatenate([jnp.ones(1, kind), change]), anchor.shifts)]
    shifts += [] if anchor.tinted_shifts is None else [anchor.tinted_shifts]
    bend = None if anchor.bend is None else from_parts(anchor.bend).astype(values.dtype)
    return with_further(otf, further, jnp.stack(shifts), bend, beside, values[1] if further.of_b else None)


def _sums(weights, rows):
    """Sum rows with weights; a GPU would take half the digits."""
    return jnp.tensordot(weights, rows, 1, precision="highest")


def _pairs(k: int) -> np.ndarray:
    """Positions (k, k) of pairs of modes among the pairs (i, j >= i) in order."""
    positions = np.zeros((k, k), int)
    i, j = np.triu_indices(k)
    positions[i, j] = positions[j, i] = np.arange(len(i))
    return positions


def _positions(anchor: Anchor) -> np.ndarray:
    """Return the indices of the modes in which B may differ."""
    return np.array([anchor.names.index(name) for name in anchor.further.of_b], int)
