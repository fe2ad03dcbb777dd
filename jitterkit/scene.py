"""What the telescope looks at: one star, a pair, or several stars."""

from abc import abstractmethod
from collections.abc import Sequence
from typing import ClassVar, Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jitterkit.conventions import direction_angle
from jitterkit.precision import array_module, real


class FurtherStars(eqx.Module):
    """Stars beside those that a scene is named after.

    Attributes
    ----------
    x, y : (n,) array
        Offsets from the frame's centre, arcsec.
    flux : (n,) array
        Electrons per frame from each, inside the frame or not.
    """

    x: Float[Array, " n"]
    y: Float[Array, " n"]
    flux: Float[Array, " n"]

    def __init__(self, x, y, flux) -> None:
        self.x, self.y, self.flux = (jnp.atleast_1d(real(value)) for value in (x, y, flux))

    def named(self, first: int) -> tuple[str, ...]:
        """Names of the parameters, in their order, where the first of the stars has that number."""
        numbers = range(first, first + len(self.x))
        return tuple(f"{name}_{number}" for name in ("x", "y", "flux") for number in numbers)

    def brightest_first(self) -> Self:
        """The same stars in the order of their fluxes."""
        order = np.argsort(-np.asarray(self.flux), kind="stable")
        return type(self)(self.x[order], self.y[order], self.flux[order])


class Scene(eqx.Module):
    """Point sources.

    Attributes
    ----------
    x, y : float
        Its place: offset from the frame's centre, arcsec.
    flux : float
        Electrons per frame from the stars that the scene is named after, inside the frame or not.
    indices : (m,) array or None
        Spectral indices, as :mod:`jitterkit.optics.colours` has them: one for the star, two for A and B, one
        for all stars of a field; further stars of a pair have zero.  None if every source has the
        instrument's spectrum.
    others : FurtherStars or None
    name : str
        Of the scene, in tables and options (class attribute).
    own : tuple of str
        Names of the parameters that every scene of the class has, in their order (class attribute).
    colours : tuple of str
        Names of the spectral indices, one for each of its stars (class attribute).
    """

    x: eqx.AbstractVar[Float[Array, ""]]
    y: eqx.AbstractVar[Float[Array, ""]]
    flux: eqx.AbstractVar[Float[Array, ""]]
    indices: eqx.AbstractVar[Float[Array, " m"] | None]
    others: eqx.AbstractVar[FurtherStars | None]
    name: ClassVar[str]
    own: ClassVar[tuple[str, ...]]
    colours: ClassVar[tuple[str, ...]] = ("spectral_index_a",)

    @abstractmethod
    def stars(self) -> tuple[Float[Array, " s"], Float[Array, " s"], Float[Array, " s"]]:
        """Offsets x and y [arcsec] and fluxes [electrons] of the stars that the scene is named after."""

    @abstractmethod
    def is_valid(self) -> Bool[Array, ""]:
        """Return whether a scene is possible: a fit must not step where it is not."""

    def canonical(self) -> Self:
        """The same sources by the parameters a person would give."""
        return self

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all parameters; those of further stars end in the number of the star: ``flux_3``."""
        coloured = () if self.indices is None else self.colours
        further = () if self.others is None else self.others.named(len(self.colours) + 1)
        return (*self.own, *coloured, *further)

    @property
    def values(self) -> dict[str, float]:
        """All parameters by name."""
        vector = np.concatenate([np.ravel(part) for part in jax.tree.leaves(self)])
        return dict(zip(self.names, vector.tolist(), strict=True))

    def sources(self) -> tuple[Float[Array, " s"], Float[Array, " s"], Float[Array, " s"]]:
        """Offsets x and y from the frame's centre [arcsec] and fluxes [electrons] of every source."""
        x, y, flux = self.stars()
        if self.others is None:
            return x, y, flux
        more = jax.tree.leaves(self.others)
        join = array_module(x, y, flux, *more).concatenate
        x, y, flux = map(join, zip((x, y, flux), more, strict=True))
        return x, y, flux

    def source_indices(self) -> Float[Array, " s"] | None:
        """Spectral index of every source; None if all have the instrument's spectrum."""
        if self.indices is None or self.others is None:
            return self.indices
        return jnp.concatenate([self.indices, jnp.zeros_like(self.others.flux)])

    def coloured(self, indices: Sequence[float] | None) -> Self:
        """The same sources with other spectral indices (m,); None for the instrument's spectrum."""
        coloured = None if indices is None else real(np.asarray(indices, float))
        return eqx.tree_at(lambda s: s.indices, self, coloured, is_leaf=lambda leaf: leaf is None)

    def at(self, values: Sequence[float]) -> Self:
        """The same scene with other parameters, in the order of the names."""
        leaves, structure = jax.tree.flatten(self)
        shapes, values = [np.shape(leaf) for leaf in leaves], real(values)
        ends = np.cumsum([np.prod(shape, dtype=int) for shape in shapes])[:-1]
        parts = array_module(values).split(values, ends)
        return jax.tree.unflatten(structure, [p.reshape(s) for p, s in zip(parts, shapes, strict=True)])

    def shifted(self, x, y) -> Self:
        """All sources moved [arcsec]."""
        moved = eqx.tree_at(lambda s: (s.x, s.y), self, (self.x + x, self.y + y))
        if self.others is None:
            return moved
        others = FurtherStars(self.others.x + x, self.others.y + y, self.others.flux)
        return eqx.tree_at(lambda s: s.others, moved, others)

    def joined(self, others: FurtherStars) -> "Scene":
        """The same with further stars."""
        if self.others is not None:
            both = zip(jax.tree.leaves(self.others), jax.tree.leaves(others), strict=True)
            others = FurtherStars(*map(jnp.concatenate, both))
        return self._with(others.brightest_first())

    def with_others(self, kept: np.ndarray) -> "Scene":
        """The same with some of its further stars, which are marked true."""
        assert self.others is not None
        return self._with(FurtherStars(*(part[np.asarray(kept)] for part in jax.tree.leaves(self.others))))

    @abstractmethod
    def _with(self, others: FurtherStars) -> "Scene":
        """The same with these further stars and no other."""

    def brightened(self, factor) -> Self:
        """All sources with so many times the light."""
        bright = eqx.tree_at(lambda s: s.flux, self, self.flux * factor)
        if self.others is None:
            return bright
        return eqx.tree_at(lambda s: s.others.flux, bright, self.others.flux * factor)


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
    others : FurtherStars or None
        From the third star on.
    """

    separation: Float[Array, ""]
    theta: Float[Array, ""]
    x: Float[Array, ""]
    y: Float[Array, ""]
    flux: Float[Array, ""]
    contrast: Float[Array, ""]
    indices: Float[Array, "2"] | None
    others: FurtherStars | None
    name: ClassVar[str] = "binary"
    own: ClassVar[tuple[str, ...]] = ("separation", "theta", "x", "y", "flux", "contrast")
    colours: ClassVar[tuple[str, ...]] = ("spectral_index_a", "spectral_index_b")

    def __init__(self, separation, theta, x, y, flux, contrast, others=None, indices=None) -> None:
        self.separation, self.theta, self.x, self.y = map(real, (separation, theta, x, y))
        self.flux, self.contrast, self.others = real(flux), real(contrast), others
        self.indices = None if indices is None else real(indices)

    def stars(self) -> tuple[Float[Array, "2"], Float[Array, "2"], Float[Array, "2"]]:
        """Return the offsets x and y [arcsec] and fluxes of A and B."""
        xp = array_module(*vars(self).values())
        angle = xp.radians(self.theta)
        side = xp.stack([-self.separation, self.separation]) / 2
        faint = 1 / (1 + self.contrast)  # not 1 - share, which rounds a faint star away
        fluxes = self.flux * xp.stack([self.contrast * faint, faint])
        return self.x + side * xp.cos(angle), self.y + side * xp.sin(angle), fluxes

    def _with(self, others: FurtherStars) -> "Binary":
        own = {name: getattr(self, name) for name in self.own}
        return type(self)(**own, others=others, indices=self.indices)

    def is_valid(self) -> Bool[Array, ""]:
        """Light comes from both stars."""
        return (self.flux > 0) & (self.contrast > 0)

    def canonical(self) -> Self:
        """Return the pair with A the brighter, a positive separation, its direction in [0, 360)."""
        contrast, separation = float(self.contrast), float(self.separation)
        turn = 180.0 * ((contrast < 1) != (separation < 0))
        return type(self)(
            abs(separation),
            direction_angle(float(self.theta) + turn),
            self.x,
            self.y,
            self.flux,
            contrast if contrast >= 1 else 1 / contrast,
            self.others,
            self.indices if self.indices is None or contrast >= 1 else self.indices[::-1],
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
    indices: Float[Array, "1"] | None
    others: FurtherStars | None
    name: ClassVar[str] = "star"
    own: ClassVar[tuple[str, ...]] = ("x", "y", "flux")

    def __init__(self, x, y, flux, indices=None) -> None:
        self.x, self.y, self.flux = map(real, (x, y, flux))
        self.indices = None if indices is None else real(indices)
        self.others = None

    def stars(self) -> tuple[Float[Array, "1"], Float[Array, "1"], Float[Array, "1"]]:
        """Return the offsets x and y [arcsec] and flux of the star."""
        return self.x[None], self.y[None], self.flux[None]

    def _with(self, others: FurtherStars) -> "Stars":
        return Stars(self.x, self.y, self.flux, others, self.indices)

    def is_valid(self) -> Bool[Array, ""]:
        """It shines."""
        return self.flux > 0


class Stars(Star):
    """Several point sources of any positions and fluxes.

    Attributes
    ----------
    x, y, flux : float
        Of the brightest star.
    others : FurtherStars
        From the second star on.
    """

    name: ClassVar[str] = "stars"

    def __init__(self, x, y, flux, others: FurtherStars, indices=None) -> None:
        super().__init__(x, y, flux, indices)
        self.others = others

    def source_indices(self) -> Float[Array, " s"] | None:
        """One spectral index of all sources; None if they have the instrument's spectrum."""
        if self.indices is None or self.others is None:
            return self.indices
        return jnp.broadcast_to(self.indices, (1 + len(self.others.flux),))

    @classmethod
    def of(cls, x, y, flux, indices=None) -> "Stars":
        """From positions [arcsec] and fluxes [electrons] (n,) of all stars, in any order."""
        every = jax.tree.leaves(FurtherStars(x, y, flux).brightest_first())
        (x, *_), (y, *_), (flux, *_) = every
        return cls(x, y, flux, FurtherStars(*(part[1:] for part in every)), indices)

    def canonical(self) -> "Stars":
        """Return the stars, the brightest first."""
        return self.of(*self.sources(), self.indices)
