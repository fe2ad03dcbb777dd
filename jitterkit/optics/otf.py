"""The optics as the detector meets them: a polychromatic transfer function on the frame's grid.

The image of a point source is band-limited: no frequency above ``diameter / wavelength`` reaches
the focal plane.  Sampled at least twice as finely, its transfer function is therefore the whole
truth about the optics, and everything that follows (diffused charge, pixels, jitter, stars) multiplies it.

:func:`~jitterkit.optics.expansion.expand` computes an :class:`OTF` from a pupil, with its exact derivatives
with respect to the aberrations; :meth:`OTF.at` uses them for small changes.  A fit expands again where it has
moved, so that its fixed point is exact.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from jitterkit.loci.elliptic import Mvn
from jitterkit.optics.colours import WAVELENGTH, Colours
from jitterkit.optics.grid import Grid
from jitterkit.precision import from_parts, to_parts

if TYPE_CHECKING:
    from jitterkit.scene import Scene


PLATE_SCALE = "plate_scale_shift"
"""Name of the relative shift of the plate scale: positions and the image of a star in pixels shrink by it."""

_BLIND = 1e-9
"""Change of the transfer function per nm up to which an aberration does not show."""


class OTF(eqx.Module):
    """A telescope's transfer function about one state of its aberrations.

    Attributes
    ----------
    value : (My, Mx//2 + 1) complex array
        Transfer function about the optical axis; at zero frequency, the share of the light that
        falls inside the padded grid.
    slopes : (k, 2, My, Mx//2 + 1) array
        Real and imaginary parts of the derivative with respect to each aberration, per nm; with respect to a
        mode of the amplitude, per unit.  Sums over them are then real products of matrices, several times as
        fast as complex ones.
    state : (k,) array
        The aberrations it was computed at, nm.
    grid : Grid
        Sampling.
    names : tuple of str
        Names of the aberrations, each with a row of the slopes: the modes of the pupil, then a shift of the
        wavelength and one of the plate scale, if they may vary.  Last, without rows, what the wavefront of B
        has more of a mode than that of A, nm.
    pixel_included : bool
        True for an empirical PSF, which has already been integrated over the pixels.
    tints : (1 + k, 2, My, Mx//2 + 1) array or None
        Parts of the derivative by the spectral index of a source, and of its own derivatives with respect to
        the aberrations; None where the colour of a source does not matter.
    colours : Colours or None
        What is known of the indices.
    sigmas : tuple of float
        Standard deviations, about zero, of those of the names that are no modes of the wavefront.  A frame's
        parameters may lack them all.
    of_b : tuple of int
        Places of the modes in which the wavefronts of B and A may differ.
    difference : (My, Mx//2 + 1) complex array or None
        Transfer function of B at the state, less that of A; None where they are the same.
    bend : (My, Mx//2 + 1) complex array or None
        Second derivative by the shift of the wavelength, per nm²; None where it does not vary.
    coarse : OTF or None
        The same in 32 bits on a grid with less padding, for the derivatives of images.  With it, the modes of
        the pupil have no rows in the slopes and tints here.
    """

    value: Complex[Array, "my mx"]
    slopes: Float[Array, "k 2 my mx"]
    state: Float[Array, " k"]
    grid: Grid = eqx.field(static=True)
    names: tuple[str, ...] = eqx.field(static=True)
    pixel_included: bool = eqx.field(static=True, default=False)
    tints: Float[Array, "k1 2 my mx"] | None = None
    colours: Colours | None = eqx.field(static=True, default=None)
    sigmas: tuple[float, ...] = eqx.field(static=True, default=())
    of_b: tuple[int, ...] = eqx.field(static=True, default=())
    difference: Complex[Array, "my mx"] | None = None
    bend: Complex[Array, "my mx"] | None = None
    coarse: OTF | None = None

    @property
    def jacobian(self) -> Complex[Array, "k my mx"]:
        """Derivative with respect to each aberration, as complex numbers."""
        if self.coarse is None:
            return from_parts(self.slopes)
        rows = self._finely(from_parts(self.coarse.slopes[: self.apart]))
        return jnp.concatenate([rows, from_parts(self.slopes)])

    @property
    def chromatic(self) -> Complex[Array, "k1 my mx"] | None:
        """The tints as complex numbers, if the colour of a source matters."""
        if self.tints is None or self.coarse is None or self.coarse.tints is None:
            return None if self.tints is None else from_parts(self.tints)
        rows, tints = self._finely(from_parts(self.coarse.tints[1 : self.apart + 1])), from_parts(self.tints)
        return jnp.concatenate([tints[:1], rows, tints[1:]])

    def _finely(self, spectra: Complex[Array, "*n my mx"]) -> Complex[Array, "*n ny nx"]:
        """Return spectra on the coarse grid on that of these optics."""
        assert self.coarse is not None
        return resized(spectra, self.coarse.grid, self.grid).astype(self.value.dtype)

    @property
    def modes(self) -> tuple[str, ...]:
        """Return the names that are modes of the wavefront."""
        return self.names[: len(self.names) - len(self.sigmas)]

    @property
    def further(self) -> tuple[str, ...]:
        """Return the names that are not modes of the wavefront."""
        return self.names[len(self.names) - len(self.sigmas) :]

    def varied(self, scene: Scene) -> tuple[str, ...]:
        """Return the names that have an effect on a scene: without B, its own parameters have none."""
        return self.names if len(scene.colours) > 1 else self.names[: len(self.names) - len(self.of_b)]

    def plate_scale_shift(self, aberrations: Float[Array, " k"]) -> Float[Array, ""] | None:
        """Return the relative shift of the plate scale among some aberrations; None where there is none."""
        if PLATE_SCALE not in self.names or len(aberrations) < len(self.names):
            return None
        return aberrations[self.names.index(PLATE_SCALE)]

    def at(self, aberrations: Float[Array, " k"]) -> Complex[Array, "my mx"]:
        """Return the transfer function at nearby aberrations [nm], to first order about ``state``.

        A shift of the wavelength counts to second order, because nothing is expanded again about it.  What is
        left out shows in a bright frame 5 nm from the state, so expand again.
        """
        if not self.names:
            return self.value
        change = self._change(aberrations)
        value = self.value + _combined(change[self.apart :], self.slopes)
        if self.coarse is not None:
            value += self._finely(_combined(change[: self.apart], self.coarse.slopes))
        if self.bend is None or (index := self.names.index(WAVELENGTH)) >= len(change):
            return value
        return value + change[index] ** 2 / 2 * self.bend

    def chromatic_at(self, aberrations: Float[Array, " k"]) -> Complex[Array, "my mx"] | None:
        """Derivative by the spectral index at nearby aberrations [nm], if it matters; to first order."""
        if self.tints is None:
            return None
        change = self._change(aberrations) if self.names else self.state[:0]
        one = jnp.ones(1, change.dtype)
        value = _combined(jnp.concatenate([one, change[self.apart :]]), self.tints)
        if self.coarse is None or self.coarse.tints is None:
            return value
        weights = jnp.concatenate([0 * one, change[: self.apart]])
        return value + self._finely(_combined(weights, self.coarse.tints))

    def _change(self, aberrations: Float[Array, " k"]) -> Float[Array, " r"]:
        """Return the distance from the state of the parameters that have a row of the slopes."""
        rows = min(len(aberrations), self.rows)
        return aberrations[:rows] - self.state[:rows]

    @property
    def rows(self) -> int:
        """Return how many of the names have a row of the slopes, here or on the coarse grid."""
        return len(self.names) - len(self.of_b)

    @property
    def apart(self) -> int:
        """Return how many of the names, the first ones, have a row of the slopes on the coarse grid only."""
        return self.rows - len(self.slopes)

    @property
    def modes_held(self) -> OTF:
        """Return the optics with what has a row on the coarse grid only, and the wavefront of B, as they are.

        Parameters to go with it lack those aberrations.
        """
        own = slice(self.apart, self.rows)
        return replace(self, state=self.state[own], names=self.names[own], sigmas=(), of_b=(), coarse=None)

    def difference_at(self, aberrations: Float[Array, " k"]) -> Complex[Array, "my mx"] | None:
        """Transfer function of B less that of A at nearby aberrations [nm]; None where they are the same."""
        if self.difference is None or not self.of_b or len(aberrations) < len(self.names):
            return self.difference
        change, rows = (aberrations - self.state)[-len(self.of_b) :], np.array(self.of_b)
        if self.coarse is None:
            return self.difference + _combined(change, self.slopes[rows])
        return self.difference + self._finely(_combined(change, self.coarse.slopes[rows]))

    def with_colours(self, scene: Scene) -> Scene:
        """Return a scene with the indices that are known beforehand, where colour matters and it has none."""
        if self.tints is None or self.colours is None or scene.indices is not None:
            return scene
        return scene.coloured(self.colours.of(len(scene.colours)))

    def multiplied(self, factor) -> OTF:
        """Return the optics with another factor (My, Mx//2 + 1) in the transfer function of every source."""
        tints = None if self.chromatic is None else to_parts(self.chromatic * factor)
        difference = None if self.difference is None else self.difference * factor
        bend = None if self.bend is None else self.bend * factor
        value, slopes = self.value * factor, to_parts(self.jacobian * factor)
        here = replace(self, value=value, slopes=slopes, coarse=None)
        return replace(here, tints=tints, difference=difference, bend=bend)

    def diffused(self, sigma: float) -> OTF:
        """Return the optics with charge diffusion: a round normal, ``sigma`` arcsec along each axis."""
        fy, fx = self.grid.frequencies
        return self.multiplied(Mvn.of(sigma).transfer(fx, fy))

    def blind(self) -> tuple[str, ...]:
        """Aberrations that do not change the image to first order: a micron of them would not show."""
        every = [np.asarray(self.slopes)]
        if self.coarse is not None:
            every.insert(0, np.asarray(self.coarse.slopes)[: self.apart])
        if min(_largest([rows[:, :, :2] for rows in every]), default=1.0) > _BLIND:  # most show in any row
            return ()
        return tuple(name for name, slope in zip(self.names, _largest(every), strict=False) if slope < _BLIND)

    def psf(self) -> Float[Array, "my mx"]:
        """Point spread function at the state, on the fine grid, centred as the frame is."""
        fy, fx = self.grid.frequencies
        cy, cx = self.grid.centre
        centred = self.value * np.exp(-2j * np.pi * fy * cy) * np.exp(-2j * np.pi * fx * cx)
        return jnp.fft.irfft2(centred, s=self.grid.fine_shape)


def _largest(blocks: list[np.ndarray]) -> list[float]:
    """Return the largest magnitude in every row of some arrays."""
    return [float(x) for rows in blocks for x in np.abs(rows).max(axis=(1, 2, 3), initial=0.0)]


def _combined(weights: Float[Array, " r"], parts: Float[Array, "n 2 my mx"]) -> Complex[Array, "my mx"]:
    """Sum the first rows with weights."""
    # a slice is copied, which takes longer than the sum
    weights = jnp.concatenate([weights, jnp.zeros(len(parts) - len(weights), weights.dtype)])
    # one row by a matrix, whose adjoint is too; that of a vector by a matrix would transpose it
    total = weights[None] @ jnp.reshape(parts, (len(parts), math.prod(parts.shape[1:])))
    return from_parts(jnp.reshape(total, parts.shape[1:]))


def resized(spectra: Complex[Array, "*n my mx"], grid: Grid, other: Grid) -> Complex[Array, "*n ny nx"]:
    """Return the spectra of point spread functions, cut where another grid ends or zero beyond their own.

    The pixels of both grids are the same, and their fine sides are even or odd alike.
    """
    if grid.fine_shape == other.fine_shape:
        return spectra
    psf = jnp.fft.irfft2(spectra / grid.centring.astype(spectra.dtype), s=grid.fine_shape)
    beside = [((m - n) // 2, (m - n) // 2, 0) for n, m in zip(grid.fine_shape, other.fine_shape, strict=True)]
    there = jax.lax.pad(psf, jnp.zeros((), psf.dtype), [(0, 0, 0)] * (spectra.ndim - 2) + beside)
    return jnp.fft.rfft2(there) * other.centring.astype(spectra.dtype)
