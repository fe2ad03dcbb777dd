"""One class for all simple loci, so that a program is compiled once and serves each of them.

Most of a scoring loop is the same whatever the locus.  A program takes one to two seconds to compile, and the
first frame of a run needs up to five of these loci.
"""

from __future__ import annotations

from typing import ClassVar, Self

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jitterkit.loci.base import Locus, OfVariance, Stable
from jitterkit.loci.elliptic import Ellipse, Elliptic, Lissajous, Mvn
from jitterkit.loci.streak import Linear, Shm, Streak, straight_moments
from jitterkit.precision import array_module

_KINDS: tuple[type[OfVariance], ...] = (Stable, Mvn, Linear, Shm, Ellipse, Lissajous)
_PROFILES = tuple(dict.fromkeys(kind.profile for kind in _KINDS))
_MOST = 3  # coordinates


class AnySimple(OfVariance):
    """One of the simple loci, whichever it is.

    Attributes
    ----------
    coords : (3,) array
        Those of the locus, and then zeros, which have no effect.
    kind : int
        Which it is: a value to a compiled program, not another program.
    """

    coords: Float[Array | np.ndarray, "3"]
    kind: Int[Array | np.ndarray, ""]
    names: ClassVar[tuple[str, ...]] = ("simple_1", "simple_2", "simple_3")

    @classmethod
    def instead_of(cls, locus: Locus) -> AnySimple | None:
        """Return a locus in this form; None if it is not one of the simple ones."""
        if type(locus) not in _KINDS:
            return None
        lacking = _MOST - len(locus.names)
        join = array_module(locus.coords).concatenate
        coords = join([locus.coords, np.zeros(lacking)]) if lacking else locus.coords
        return cls(coords, np.asarray(_KINDS.index(type(locus))))

    def transfer(self, fx, fy):
        return _profile(jnp.asarray(_WHICH)[self.kind], self.variance_along(fx, fy))

    def moments(self):
        cosine, sine, _ = self.coords
        straight = straight_moments(cosine, sine, jnp.asarray(_STRAIGHT, self.coords.dtype)[self.kind])
        return jnp.where(jnp.asarray(_ELLIPTIC)[self.kind], self.coords, straight)

    def describe(self) -> dict[str, float]:
        return self._itself.describe()

    @classmethod
    def near(cls, moments) -> Self:
        return cls(Mvn.near(moments).coords, np.asarray(_KINDS.index(Mvn)))

    def points(self, n: int) -> np.ndarray:
        return self._itself.points(n)

    def trace(self, n: int, rng: np.random.Generator) -> np.ndarray:
        return self._itself.trace(n, rng)

    @property
    def _itself(self) -> Locus:
        """The locus that this stands for, outside a compiled program."""
        kind = _KINDS[int(self.kind)]
        return kind(self.coords[: len(kind.names)])


_WHICH = tuple(_PROFILES.index(kind.profile) for kind in _KINDS)
_STRAIGHT = tuple(kind.variance if issubclass(kind, Streak) else 0.0 for kind in _KINDS)
_ELLIPTIC = tuple(issubclass(kind, Elliptic) for kind in _KINDS)


@jax.custom_jvp
def _profile(which, variance):
    return jax.lax.switch(which, _PROFILES, variance)


@_profile.defjvp
def _push(values, changes):
    """Differentiate within the branch that counts: outside, each leaves what its derivative needs."""
    which, variance = values
    one = jnp.ones_like(variance)
    slopes = [lambda v, profile=profile: jax.jvp(profile, (v,), (one,)) for profile in _PROFILES]
    value, slope = jax.lax.switch(which, slopes, variance)
    return value, slope * changes[1]
