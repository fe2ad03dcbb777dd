"""A blur that is not its own mirror image, to catch whoever flips a kernel."""

import jax.numpy as jnp
import numpy as np
import pytest

from jitterkit.loci import Locus

PLACES, SHARES = np.array([[-1.0, -1.0], [3.0, 3.0]]), np.array([0.75, 0.25])


class Hop(Locus):
    """Three quarters of the time at (-s, -s), one quarter at (3s, 3s); the coordinate is s, arcsec."""

    names = ("hop",)

    def transfer(self, fx, fy):
        phases = [
            share * jnp.exp(-2j * jnp.pi * self.coords[0] * (x * fx + y * fy)) for share, (x, y) in self.stays
        ]
        return sum(phases)

    @property
    def stays(self):
        return list(zip(SHARES, PLACES, strict=True))

    def moments(self):
        return 3 * self.coords[0] ** 2 * jnp.ones(3)  # 0.75 * 1 + 0.25 * 9

    def describe(self):
        return {"hop": float(self.coords[0])}

    @classmethod
    def near(cls, moments):
        return cls(jnp.sqrt(moments[:1] / 3))

    def points(self, n):
        return float(self.coords[0]) * np.repeat(PLACES, [3, 1], axis=0)

    def trace(self, n, rng):
        return self.points(n)


@pytest.fixture
def hop():
    """Makes one of a given size."""
    return lambda size: Hop(jnp.array([float(size)]))
