"""The optics as the detector meets them: a polychromatic transfer function on the frame's grid.

The image of a point source is band-limited: no frequency above ``diameter / wavelength`` reaches
the focal plane.  Sampled at least twice as finely, its transfer function is therefore the whole
truth about the optics, and everything that follows (diffused charge, pixels, jitter, stars) multiplies it.

:func:`~jitterkit.optics.expansion.expand` computes an :class:`OTF` from a pupil, with its exact derivatives
with respect to the aberrations; :meth:`OTF.at` uses them for small changes.  A fit expands again where it has
moved, so that its fixed point is exact.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from jitterkit.loci.mvn import Mvn
from jitterkit.optics.colours import WAVELENGTH, Colours
from jitterkit.optics.grid import Grid

if TYPE_CHECKING:
    from jitterkit.scene import Scene

__all__ = ["OTF", "with_shift"]


_BLIND = 1e-9
"""Change of the transfer function per nm up to which an aberration does not show."""


class OTF(eqx.Module):
    """A telescope's transfer function about one state of its aberrations.

    Attributes
    ----------
    value : (My, Mx//2 + 1) complex array
        Transfer function about the optical axis; at zero frequency, the share of the light that
        falls inside the padded grid.
    jacobian : (k, My, Mx//2 + 1) complex array
        Derivative with respect to each aberration, per nm.
    state : (k,) array
        The aberrations it was computed at, nm.
    grid : Grid
        Sampling.
    names : tuple of str
        Names of the aberrations; then that of the shift of the wavelength, if it may vary.
    pixel_included : bool
        True for an empirical PSF, which has already been integrated over the pixels.
    chromatic : (1 + k, My, Mx//2 + 1) complex array or None
        Derivative by the spectral index of a source, and its own derivatives with respect to the
        aberrations; None where the colour of a source does not matter.
    colours : Colours or None
        What is known of the indices.
    wavelength_sigma : float
        Standard deviation of the shift of the wavelength, nm.
    """

    value: Complex[Array, "my mx"]
    jacobian: Complex[Array, "k my mx"]
    state: Float[Array, " k"]
    grid: Grid = eqx.field(static=True)
    names: tuple[str, ...] = eqx.field(static=True)
    pixel_included: bool = eqx.field(static=True, default=False)
    chromatic: Complex[Array, "k1 my mx"] | None = None
    colours: Colours | None = eqx.field(static=True, default=None)
    wavelength_sigma: float = eqx.field(static=True, default=np.inf)

    @property
    def shifts(self) -> bool:
        """Whether the wavelength may vary: the last of the names, which a frame's parameters may lack."""
        return self.names[-1:] == (WAVELENGTH,)

    def at(self, aberrations: Float[Array, " k"]) -> Complex[Array, "my mx"]:
        """Transfer function at nearby aberrations [nm], to first order about ``state``.

        The error is second order: 5 nm from the state it shows in a bright frame, so expand anew.
        """
        if not self.names:
            return self.value
        n = len(aberrations)
        return self.value + jnp.tensordot(aberrations - self.state[:n], self.jacobian[:n], 1)

    def chromatic_at(self, aberrations: Float[Array, " k"]) -> Complex[Array, "my mx"]:
        """Derivative by the spectral index at nearby aberrations [nm], to first order about ``state``."""
        assert self.chromatic is not None
        if not self.names:
            return self.chromatic[0]
        n = len(aberrations)
        return self.chromatic[0] + jnp.tensordot(aberrations - self.state[:n], self.chromatic[1 : 1 + n], 1)

    def with_colours(self, scene: Scene) -> Scene:
        """Return a scene with the indices that are known beforehand, where colour matters and it has none."""
        if self.chromatic is None or self.colours is None or scene.indices is not None:
            return scene
        return scene.coloured(self.colours.of(len(scene.colours)))

    def multiplied(self, factor) -> OTF:
        """The same with another factor (My, Mx//2 + 1) in the transfer function of every source."""
        chromatic = None if self.chromatic is None else self.chromatic * factor
        return replace(self, value=self.value * factor, jacobian=self.jacobian * factor, chromatic=chromatic)

    def diffused(self, sigma: float) -> OTF:
        """The same with charge diffused in the detector: a round normal, ``sigma`` arcsec along each axis."""
        fy, fx = self.grid.frequencies
        return self.multiplied(Mvn.of(sigma).transfer(fx, fy))

    def blind(self) -> tuple[str, ...]:
        """Aberrations that do not change the image to first order: a micron of them would not show."""
        slopes = np.asarray(self.jacobian)
        if np.all(np.abs(slopes[:, :2]).max(axis=(1, 2), initial=0.0) > _BLIND):  # most show in any row
            return ()
        largest = np.abs(slopes).max(axis=(1, 2), initial=0.0)
        return tuple(name for name, slope in zip(self.names, largest, strict=True) if slope < _BLIND)

    def psf(self) -> Float[Array, "my mx"]:
        """Point spread function at the state, on the fine grid, centred as the frame is."""
        fy, fx = self.grid.frequencies
        cy, cx = self.grid.centre
        return jnp.fft.irfft2(
            self.value * np.exp(-2j * np.pi * fy * cy) * np.exp(-2j * np.pi * fx * cx), s=self.grid.fine_shape
        )


def with_shift(otf: OTF, slope: Complex[Array, "my mx"], mean: float) -> OTF:
    """The same optics whose wavelength may vary.

    Parameters
    ----------
    otf : OTF
    slope : (My, Mx//2 + 1) array
        Derivative by a shift of the wavelength, per nm.
    mean : float
        Mean wavelength, nm.
    """
    assert otf.colours is not None
    assert otf.chromatic is not None
    return replace(
        otf,
        jacobian=jnp.concatenate([otf.jacobian, slope[None]]),
        state=jnp.append(otf.state, 0.0),
        names=(*otf.names, WAVELENGTH),
        chromatic=jnp.concatenate([otf.chromatic, jnp.zeros_like(slope)[None]]),
        wavelength_sigma=otf.colours.wavelength_err * mean,
    )
