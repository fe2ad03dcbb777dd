"""The optics about one state, to second order: the exact transfer functions of all states nearby, cheaply.

A telescope changes little from frame to frame.  An :class:`Anchor` costs as much as four first-order
expansions and then replaces those of thousands of frames: one matrix product each, a hundredth of the work.
:class:`AnchoredOptics` stands in for an :class:`~jitterkit.optics.system.OpticalSystem` wherever one is asked
for, and is as exact.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jitterkit.loci.elliptic import Mvn
from jitterkit.optics.colours import Colours
from jitterkit.optics.expansion import centring, derivatives_at, shift_effects
from jitterkit.optics.grid import Grid
from jitterkit.optics.otf import OTF, Further, with_further
from jitterkit.optics.system import OpticalSystem
from jitterkit.precision import from_parts, to_parts

_THIRD_ORDER = 1.5
"""What the second order leaves out of an image, as a share of it, by the cube of the phase's rms [rad]: 0.5
to 1.2 for every mode of TOLIMAN's pupil and for mixtures of them."""

_UNSEEN = 0.05
"""Sigmas of the whole image that may be left out: half of what a fit's own linearisation may."""

_SLOPES = 0.1
"""Rms phase [rad] up to which the derivatives are taken from the anchor, where the value no longer can be:
they are off by up to 2 % there."""


class Anchor(eqx.Module):
    """A telescope's transfer function to second order about one state of its aberrations.

    Of every spectrum there are real and imaginary parts, (2, My, Mx//2 + 1), below (m).

    Attributes
    ----------
    value : (m) array
    slopes : (k, m) array
        First derivatives, per nm.
    curvature : (k, k, m) array
        Second derivatives, per nm², in 32 bits; with both halves, because sums over one of them take longer.
    state : (k,) array
        nm.
    chromatic : (1 + k + k (k + 1)/2, m) array or None
        Derivatives of all of these by the spectral index of a source, in 32 bits; None where its colour does
        not matter.
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
    curvature: Float[Array, "k k 2 my mx"]
    state: Float[Array, " k"]
    chromatic: Float[Array, "q 2 my mx"] | None
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
        return cls(
            parts[0, 0],
            parts[0, 1 : k + 1],
            parts[0, k + 1 :].astype(jnp.float32)[_pairs(k)],
            state,
            parts[1].astype(jnp.float32) if tinted else None,
            jnp.swapaxes(to_parts(shifts[0]), 0, 1),
            to_parts(shifts[1, :, 0]) if tinted else None,
            None if bend is None else to_parts(bend).astype(jnp.float32),
            grid,
            names,
            system.colours,
            system.further,
        )

    def otf(self, aberrations) -> OTF:
        """Return the first-order expansion about aberrations [nm] near the state.

        Its value is off by what is of third order in their distance, its derivatives by what is of second.
        """
        state, beside = self.further.split(aberrations, len(self.names))
        return _renewed(self, state.astype(self.state.dtype), beside.astype(self.state.dtype))

    def within(self, grid: Grid) -> Anchor:
        """Return the anchor on a smaller grid of the same pixels, whose fine sides are even or odd alike.

        The point spread function is cut there; what it has beyond is lost.
        """
        return _cut(self, grid)


@eqx.filter_jit
def _cut(anchor: Anchor, grid: Grid) -> Anchor:
    def cut(parts):
        return to_parts(_cut_spectra(from_parts(parts), anchor.grid, grid)).astype(parts.dtype)

    arrays = jax.tree.map(cut, eqx.tree_at(lambda a: a.state, anchor, None))
    return replace(arrays, state=anchor.state, grid=grid)


def _cut_spectra(spectra, grid: Grid, smaller: Grid):
    """Return the spectra of point spread functions that are cut to a smaller grid."""
    y, x = ((n - m) // 2 for n, m in zip(grid.fine_shape, smaller.fine_shape, strict=True))
    psf = jnp.fft.irfft2(spectra / centring(grid), s=grid.fine_shape)
    my, mx = smaller.fine_shape
    return jnp.fft.rfft2(psf[..., y : y + my, x : x + mx]) * centring(smaller)


@eqx.filter_jit
def on_grid(otf: OTF, grid: Grid) -> OTF:
    """Return optics without derivatives on a grid, which may be smaller as in :meth:`Anchor.within`."""
    value = otf.value if grid == otf.grid else _cut_spectra(otf.value, otf.grid, grid)
    return OTF(value, otf.slopes[:0], otf.state[:0], grid, ())


@eqx.filter_jit
def _renewed(anchor: Anchor, aberrations, beside) -> OTF:
    change, k, further = aberrations - anchor.state, len(anchor.state), anchor.further
    own = jnp.stack([change, change.at[_positions(anchor)].add(beside)]) if further.of_b else change[None]
    bends = _sums(own.astype(anchor.curvature.dtype), anchor.curvature)
    halves = jnp.stack(
        [_sums(one.astype(bend.dtype) / 2, bend) for one, bend in zip(own, bends, strict=True)]
    )
    values = from_parts(anchor.value + jnp.tensordot(own, anchor.slopes, 1) + halves)
    tints = None
    if anchor.chromatic is not None:
        i, j = np.triu_indices(k)
        weights = jnp.concatenate(
            [jnp.ones(1, change.dtype), change, change[i] * change[j] / np.where(i == j, 2, 1)]
        )
        # all rows in one product: a part of them would be copied first, which takes longer
        tint = _sums(weights.astype(anchor.chromatic.dtype), anchor.chromatic)
        tints = jnp.concatenate([tint[None], anchor.chromatic[1 : k + 1]]).astype(change.dtype)
    otf = OTF(
        values[0],
        anchor.slopes + bends[0],
        aberrations,
        anchor.grid,
        anchor.names,
        tints=tints,
        colours=anchor.colours,
        sigmas=further.sigmas[: further.shadings],
    )
    if not further.names:
        return otf
    shifts = [_sums(jnp.concatenate([jnp.ones(1, change.dtype), change]), anchor.shifts)]
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


@dataclass(frozen=True)
class AnchoredOptics:
    """The optics of a frame that is one of many, near one state of the aberrations.

    Parameters
    ----------
    system : OpticalSystem
        Asked for what lies too far from the anchor.
    anchor : Anchor
    photons : float
        Of a frame: how small a change it shows.
    nominal : OTF
        Transfer function to start from.
    coarse : Anchor, optional
        The anchor on a grid with less padding, in 32 bits, for derivatives of images.
    """

    system: OpticalSystem
    anchor: Anchor
    photons: float
    nominal: OTF
    coarse: Anchor | None = None

    @classmethod
    def about(cls, system: OpticalSystem, anchor: Anchor, photons: float, start=None) -> AnchoredOptics:
        """To start from some aberrations [nm]; by default those of the anchor."""
        return cls(system, anchor, photons, anchor.otf(anchor.state if start is None else start))

    def phase(self, aberrations) -> float:
        """Rms phase [rad] of a wavefront error [nm] over the lit pupil, at the shortest wavelength."""
        return self.system.phase(aberrations)

    def otf(self, aberrations, *, derivatives: bool = True) -> OTF:
        """Return the transfer function about ``aberrations`` [nm]: as good as exact, with its derivatives."""
        if self._distance(aberrations) > _SLOPES:
            return self.system.otf(aberrations, derivatives=derivatives)
        here = self.anchor.otf(aberrations)
        if self.coarse is not None:
            here = replace(here, coarse=self.coarse.otf(aberrations))
        return here if self.reaches(aberrations) else self.system.near(aberrations, here)

    def reaches(self, aberrations) -> bool:
        """Return whether the anchor alone is as good as exact at ``aberrations`` [nm]."""
        return self.left_out(aberrations) < _UNSEEN

    def left_out(self, aberrations) -> float:
        """Return an upper bound on the anchor's error in the image, in sigmas of the whole."""
        return float(_THIRD_ORDER * np.sqrt(self.photons) * self._distance(aberrations) ** 3)

    def _distance(self, aberrations) -> float:
        """Return the rms phase [rad] from the anchor."""
        modes = len(self.anchor.state)
        state, beside = self.anchor.further.split(aberrations, modes)
        return self.system.phase_of(state - np.asarray(self.anchor.state), beside)

    def near(self, aberrations, slopes: OTF) -> OTF:
        """Expand the optics near a state, as :class:`Optics` has it; derivatives cost nothing here."""
        return self.otf(aberrations)
