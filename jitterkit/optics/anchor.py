"""The optics about one state, to second order: the exact transfer functions of all states nearby, cheaply.

A telescope changes little from frame to frame.  An :class:`Anchor` costs as much as four first-order
expansions and then replaces those of thousands of frames: one matrix product each, a hundredth of the work.
:class:`AnchoredOptics` stands in for an :class:`~jitterkit.optics.system.OpticalSystem` wherever one is asked
for, and is as exact.
"""

from __future__ import annotations

from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jitterkit.loci.mvn import Mvn
from jitterkit.optics.colours import Colours
from jitterkit.optics.expansion import centring, derivatives_at, shift_slopes, wavelength_curvature
from jitterkit.optics.further import Further
from jitterkit.optics.grid import Grid
from jitterkit.optics.otf import OTF, with_further
from jitterkit.optics.system import OpticalSystem

__all__ = ["Anchor", "AnchoredOptics"]

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

    Of every spectrum there are m = 2 My (Mx//2 + 1) numbers: its real parts, and then its imaginary ones.

    Attributes
    ----------
    value : (m,) array
    slopes : (k, m) array
        First derivatives, per nm.
    curvature : (k (k + 1)/2, m) array
        Second derivatives by pairs (i, j >= i), per nm², in 32 bits.
    state : (k,) array
        nm.
    chromatic : (1 + k + k (k + 1)/2, m) array or None
        Derivatives of all of these by the spectral index of a source, in 32 bits; None where its colour does
        not matter.
    shifts : (s, 1 + k, m) array
        Derivatives of value and slopes by the shifts of the wavelength and of the plate scale, those there
        are.
    tinted_shifts : (s, m) array or None
        Derivative of that of the value by the spectral index.
    bend : (m,) array or None
        Second derivative of the value by the shift of the wavelength, in 32 bits.
    grid : Grid
    names : tuple of str
        Of the aberrations.
    colours : Colours or None
    further : Further
        What may vary beside them.
    """

    value: Float[Array, " m"]
    slopes: Float[Array, "k m"]
    curvature: Float[Array, "p m"]
    state: Float[Array, " k"]
    chromatic: Float[Array, "q m"] | None
    shifts: Float[Array, "s k1 m"]
    tinted_shifts: Float[Array, "s m"] | None
    bend: Float[Array, " m"] | None
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
        shifts = shift_slopes(*where, order=1, chromatic=tinted)
        bend = wavelength_curvature(*where[:-1]) if system.further.wavelength_sigma else None
        if system.diffusion:
            fy, fx = grid.frequencies
            blur = Mvn.of(system.diffusion).transfer(fx, fy)
            spectra, shifts = spectra * blur, shifts * blur
            bend = None if bend is None else bend * blur
        parts = _real(spectra)
        return cls(
            parts[0, 0],
            parts[0, 1 : k + 1],
            parts[0, k + 1 :].astype(jnp.float32),
            state,
            parts[1].astype(jnp.float32) if tinted else None,
            _real(shifts[0]),
            _real(shifts[1, :, 0]) if tinted else None,
            None if bend is None else _real(bend).astype(jnp.float32),
            grid,
            names,
            system.colours,
            system.further,
        )

    @property
    def nbytes(self) -> int:
        """Memory that it takes."""
        return sum(part.nbytes for part in jax.tree.leaves(self))

    def otf(self, aberrations) -> OTF:
        """Return the first-order expansion about aberrations [nm] near the state.

        Its value is off by what is of third order in their distance, its derivatives by what is of second.
        """
        return _renewed(self, *self.further.split(aberrations, len(self.names)))

    def within(self, grid: Grid) -> Anchor:
        """Return the anchor on a smaller grid of the same pixels, whose fine sides are even or odd alike.

        The point spread function is cut there; what it has beyond is lost.
        """
        return _cut(self, grid)


@eqx.filter_jit
def _cut(anchor: Anchor, grid: Grid) -> Anchor:
    first = [(n - m) // 2 for n, m in zip(anchor.grid.fine_shape, grid.fine_shape, strict=True)]
    (ny, nx), (my, mx) = anchor.grid.fine_shape, grid.fine_shape

    def cut(parts):
        halves = jnp.reshape(parts, (len(parts), 2, ny, nx // 2 + 1))
        spectra = jax.lax.complex(halves[:, 0], halves[:, 1]) / centring(anchor.grid)
        psf = jnp.fft.irfft2(spectra, s=(ny, nx))[:, first[0] : first[0] + my, first[1] : first[1] + mx]
        flat = jnp.reshape(jnp.fft.rfft2(psf) * centring(grid), (len(parts), my * (mx // 2 + 1)))
        return jnp.concatenate([flat.real, flat.imag], axis=1).astype(parts.dtype)

    value, slopes, curvature = (cut(part) for part in (anchor.value[None], anchor.slopes, anchor.curvature))
    chromatic = None if anchor.chromatic is None else cut(anchor.chromatic)
    count, rows, size = anchor.shifts.shape
    shifts = cut(jnp.reshape(anchor.shifts, (count * rows, size)))
    shifts = jnp.reshape(shifts, (count, rows, shifts.shape[1]))
    tinted = None if anchor.tinted_shifts is None else cut(anchor.tinted_shifts)
    bend = None if anchor.bend is None else cut(anchor.bend[None])[0]
    known = anchor.names, anchor.colours, anchor.further
    return Anchor(value[0], slopes, curvature, anchor.state, chromatic, shifts, tinted, bend, grid, *known)


@eqx.filter_jit
def _renewed(anchor: Anchor, aberrations, beside) -> OTF:
    change, k, further = aberrations - anchor.state, len(anchor.state), anchor.further
    i, j = np.triu_indices(k)
    pair = np.arange(len(i))

    def turned(change):
        """Return the matrix from the curvature to the change of each slope."""
        return jnp.zeros((k, len(i))).at[i, pair].set(change[j]).at[j, pair].set(change[i])

    turns = turned(change)
    own = jnp.stack([change, change.at[_positions(anchor)].add(beside)]) if further.of_b else change[None]
    halves = jnp.stack([one @ turned(one) / 2 for one in own])
    rows = jnp.concatenate([turns, halves]).astype(anchor.curvature.dtype)
    bends = jnp.matmul(rows, anchor.curvature, precision="highest")  # a GPU would take half the digits
    values = anchor.value + own @ anchor.slopes + bends[k:]
    spectra = _complex(jnp.concatenate([anchor.slopes + bends[:k], values]), anchor.grid)
    chromatic = None
    if anchor.chromatic is not None:
        # all rows in one product: a part of them would be copied first, which takes longer
        weights = jnp.concatenate([jnp.ones(1, rows.dtype), change.astype(rows.dtype), rows[k]])
        tint = jnp.matmul(weights, anchor.chromatic, precision="highest")
        tints = jnp.concatenate([tint[None], anchor.chromatic[1 : k + 1]]).astype(values.dtype)
        chromatic = _complex(tints, anchor.grid)
    otf = OTF(
        spectra[k],
        spectra[:k],
        aberrations,
        anchor.grid,
        anchor.names,
        chromatic=chromatic,
        colours=anchor.colours,
        sigmas=further.sigmas[: further.shadings],
    )
    if not further.names:
        return otf
    shifts = [anchor.shifts[:, 0] + jnp.tensordot(change, anchor.shifts[:, 1:], (0, 1))]
    shifts += [] if anchor.tinted_shifts is None else [anchor.tinted_shifts]
    slopes = jnp.stack([_complex(parts, anchor.grid) for parts in shifts])
    bend = None if anchor.bend is None else _complex(anchor.bend[None].astype(values.dtype), anchor.grid)[0]
    return with_further(otf, further, slopes, bend, beside, spectra[k + 1] if further.of_b else None)


def _positions(anchor: Anchor) -> np.ndarray:
    """Return the indices of the modes in which B may differ."""
    return np.array([anchor.names.index(name) for name in anchor.further.of_b], int)


def _real(spectra):
    """Real and then imaginary parts (..., m) of spectra (..., My, Mx//2 + 1)."""
    flat = jnp.reshape(spectra, (*spectra.shape[:-2], spectra.shape[-2] * spectra.shape[-1]))
    return jnp.concatenate([flat.real, flat.imag], axis=-1)


def _complex(parts, grid: Grid):
    """Return the spectra (n, My, Mx//2 + 1) from their real and their imaginary parts (n, m)."""
    half = parts.shape[1] // 2
    ny, nx = grid.fine_shape
    return jnp.reshape(jax.lax.complex(parts[:, :half], parts[:, half:]), (len(parts), ny, nx // 2 + 1))


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
    """

    system: OpticalSystem
    anchor: Anchor
    photons: float
    nominal: OTF

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
