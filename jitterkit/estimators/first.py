"""The frame that others repeat, its cut-out, and the blur that they are compared by.

Reach for :class:`~jitterkit.estimators.repeat.Repeat`, which is made of these.  A cut-out is periodic at its
rim: light that leaves on one side comes back on the other, so the rim is left out.
"""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float, Int

from jitterkit.forward import Parameters, to_vector
from jitterkit.loci import Shaped
from jitterkit.optics import Anchor
from jitterkit.optics.otf import OTF

__all__ = ["SPARE", "First", "Fourth", "invert", "moved", "offset_of", "within"]

SPARE = 3
"""Pixels by which the pair may be off its place in the cut-out before light returns within the rim."""


class Fourth(Shaped):
    """A normal, and what a small excess kurtosis changes in it: ``Shaped``, to first order and cheaply."""

    def transfer(self, fx, fy):
        w = 4 * jnp.pi**2 * self.variance_along(fx, fy)
        return jnp.exp(-w / 2 + self.coords[3] * w**2 / 24)


class First(eqx.Module):
    """The frame that others are compared with.

    Attributes
    ----------
    parameters : Parameters
        What fits it, about the centre of its cut-out.
    anchor : Anchor
        Of the optics, on the cut-out's pixels alone.
    otf : OTF
        The same at its state.
    values : (p,) array
        Those of the parameters that are fitted.
    slopes : (p, my, mx) array
        Derivatives of the expected image over its variance, within the rim.
    covariance : (p, p) array
        Of the values, the kurtosis held.
    whole : (ny, nx) array
        Expected image of the whole frame.
    matched : (ny, nx//2 + 1) complex array
        Conjugate of its spectrum, without its mean.
    corner : (2,) int array
        First pixel ``(y, x)`` of the cut-out.
    rim : (int, int)
        Pixels ``(y, x)`` along each side of the cut-out that are left out.
    free : tuple of int
        Positions of the values in the parameter vector.
    names : tuple of str
        Of the values.
    """

    parameters: Parameters
    anchor: Anchor
    otf: OTF
    values: Float[Array, " p"]
    slopes: Float[Array, "p my mx"]
    covariance: Float[Array, "p p"]
    whole: Float[Array, "ny nx"]
    matched: Complex[Array, "ny mx"]
    corner: Int[Array, "2"]
    rim: tuple[int, int] = eqx.field(static=True)
    free: tuple[int, ...] = eqx.field(static=True)
    names: tuple[str, ...] = eqx.field(static=True)

    @property
    def kurtosis(self) -> int:
        """Which value is the excess kurtosis; the three before it are the moments."""
        return self.names.index(Fourth.names[-1])

    def at(self, values) -> Parameters:
        """The parameters with other values."""
        vector, unravel = to_vector(self.parameters)
        return unravel(vector.at[np.asarray(self.free)].set(values))


def offset_of(corner, size, shape):
    """Of a cut-out's centre from the frame's, ``(y, x)`` [pixels]."""
    return corner + np.subtract(size, shape) / 2


def moved(parameters: Parameters, by) -> Parameters:
    """Parameters with the pair moved by ``(y, x)`` [arcsec]."""
    scene = parameters.scene
    return eqx.tree_at(lambda p: (p.scene.y, p.scene.x), parameters, (scene.y + by[0], scene.x + by[1]))


def within(rim: tuple[int, int], arrays):
    """Arrays (..., ny, nx) without their rim."""
    y, x = rim
    return arrays[..., y:-y, x:-x]


def invert(information, varied):
    """Covariance (p, p) of what is varied, zero elsewhere, and its standard errors (p,)."""
    scale = jnp.sqrt(jnp.diag(information))
    both = varied[:, None] & varied
    unit = jnp.where(both, information / jnp.outer(scale, scale), jnp.eye(len(scale)))
    covariance = jnp.where(both, jnp.linalg.inv(unit) / jnp.outer(scale, scale), 0.0)
    return covariance, jnp.sqrt(jnp.diag(covariance))
