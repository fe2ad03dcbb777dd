"""What the telescope looks at: a binary, or one star."""

from abc import abstractmethod
from typing import ClassVar, Self

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jitterkit.conventions import direction_angle
from jitterkit.precision import real

__all__ = ["Binary", "Scene", "Star"]


class Scene(eqx.Module):
    """Point sources with one spectrum.

    Attributes
    ----------
    x, y : float
        Its place: offset from the frame's centre, arcsec.
    flux : float
        Electrons per frame from all sources, inside the frame or not.
    name : str
        Of the scene, in tables and options (class attribute).
    names : tuple of str
        Of the parameters, in their order (class attribute).
    """

    x: eqx.AbstractVar[Float[Array, ""]]
    y: eqx.AbstractVar[Float[Array, ""]]
    flux: eqx.AbstractVar[Float[Array, ""]]
    name: ClassVar[str]
    names: ClassVar[tuple[str, ...]]

    @abstractmethod
    def sources(self) -> tuple[Float[Array, " s"], Float[Array, " s"], Float[Array, " s"]]:
        """Offsets x and y from the frame's centre [arcsec] and fluxes [electrons] of every source."""

    @abstractmethod
    def lawful(self) -> Bool[Array, ""]:
        """Whether such a scene can be: a fit must not step where it cannot."""

    def tidied(self) -> Self:
        """The same sources by the parameters a person would give."""
        return self


class Binary(Scene):
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
    name: ClassVar[str] = "binary"
    names: ClassVar[tuple[str, ...]] = ("separation", "theta", "x", "y", "flux", "contrast")

    def __init__(self, separation, theta, x, y, flux, contrast) -> None:
        self.separation, self.theta, self.x, self.y = map(real, (separation, theta, x, y))
        self.flux, self.contrast = real(flux), real(contrast)

    def sources(self) -> tuple[Float[Array, "2"], Float[Array, "2"], Float[Array, "2"]]:
        """Offsets x and y [arcsec] and fluxes of A and B."""
        angle = jnp.radians(self.theta)
        side = jnp.stack([-self.separation, self.separation]) / 2
        faint = 1 / (1 + self.contrast)  # not 1 - share, which rounds a faint star away
        fluxes = self.flux * jnp.stack([self.contrast * faint, faint])
        return self.x + side * jnp.cos(angle), self.y + side * jnp.sin(angle), fluxes

    def lawful(self) -> Bool[Array, ""]:
        """Light comes from both stars."""
        return (self.flux > 0) & (self.contrast > 0)

    def tidied(self) -> Self:
        """A the brighter, a positive separation, its direction in [0, 360)."""
        contrast, separation = float(self.contrast), float(self.separation)
        turn = 180.0 * ((contrast < 1) != (separation < 0))
        return type(self)(
            abs(separation),
            direction_angle(float(self.theta) + turn),
            self.x,
            self.y,
            self.flux,
            contrast if contrast >= 1 else 1 / contrast,
        )


class Star(Scene):
    """One point source.

    Attributes
    ----------
    x, y : float
        Offset from the frame's centre, arcsec.
    flux : float
        Electrons per frame, inside the frame or not.
    """

    x: Float[Array, ""]
    y: Float[Array, ""]
    flux: Float[Array, ""]
    name: ClassVar[str] = "star"
    names: ClassVar[tuple[str, ...]] = ("x", "y", "flux")

    def __init__(self, x, y, flux) -> None:
        self.x, self.y, self.flux = map(real, (x, y, flux))

    def sources(self) -> tuple[Float[Array, "1"], Float[Array, "1"], Float[Array, "1"]]:
        """Offsets x and y [arcsec] and flux of the star."""
        return self.x[None], self.y[None], self.flux[None]

    def lawful(self) -> Bool[Array, ""]:
        """It shines."""
        return self.flux > 0
