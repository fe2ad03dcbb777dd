"""What the telescope looks at: a binary."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

__all__ = ["Binary"]


class Binary(eqx.Module):
    """Two point sources: the brighter, A, and the fainter, B.

    Attributes
    ----------
    separation : float
        Angular distance from A to B, arcsec.
    theta : float
        Direction from A to B, degrees counter-clockwise from +x.
    x, y : float
        Midpoint of the pair (not its photocentre), offset from the frame's centre, arcsec.
    flux : float
        Electrons per frame from both stars, inside the frame or not.
    contrast : float
        Flux of A over flux of B.
    """

    separation: Float[Array, ""]
    theta: Float[Array, ""]
    x: Float[Array, ""]
    y: Float[Array, ""]
    flux: Float[Array, ""]
    contrast: Float[Array, ""]

    def __init__(self, separation, theta, x, y, flux, contrast) -> None:
        self.separation, self.theta = jnp.asarray(separation, float), jnp.asarray(theta, float)
        self.x, self.y = jnp.asarray(x, float), jnp.asarray(y, float)
        self.flux, self.contrast = jnp.asarray(flux, float), jnp.asarray(contrast, float)

    def sources(self) -> tuple[Float[Array, "2"], Float[Array, "2"], Float[Array, "2"]]:
        """Offsets x and y [arcsec] and fluxes of A and B."""
        angle = jnp.radians(self.theta)
        side = jnp.array([-0.5, 0.5]) * self.separation
        share = self.contrast / (1 + self.contrast)
        fluxes = self.flux * jnp.stack([share, 1 - share])
        return self.x + side * jnp.cos(angle), self.y + side * jnp.sin(angle), fluxes
