"""A detector of a dozen lines, written without the package: what the frames say is known."""

from dataclasses import dataclass

import numpy as np
import pytest

from jitterkit.calibration import Stack


@dataclass
class Camera:
    """Every truth in electrons; ``read`` is the whole physics."""

    rng: np.random.Generator
    size: int = 128
    gain: float = 3.7
    noise: float = 2.4
    well: float = 15000.0
    top: float = 65535.0
    bend: float = 0.0
    prnu: float = 0.006
    tilt: float = 0.0
    rays: float = 0.0
    hot: int = 0
    dead: int = 0

    def __post_init__(self):
        n = self.size
        self.offset = 100 + self.rng.normal(0, 0.3, (n, n))
        self.dark = 0.8 * np.exp(0.2 * self.rng.normal(size=(n, n)))
        x = np.linspace(-1, 1, n)
        self.response = (1 + self.prnu * self.rng.normal(size=(n, n))) * (1 + self.tilt * x)
        positions = self.rng.choice(n * n, self.hot + self.dead, replace=False)
        self.hot_places, self.dead_places = positions[: self.hot], positions[self.hot :]
        self.dark.flat[self.hot_places] = self.rng.uniform(20, 200, self.hot)
        self.response.flat[self.dead_places] = self.rng.uniform(0, 0.3, self.dead)

    def read(self, electrons):
        charge = self.rng.poisson(electrons).astype(float)
        hit = self.rng.random(charge.shape) < self.rays
        charge[hit] += self.rng.uniform(300, 3000, hit.sum())
        charge = np.minimum(charge, self.well)
        charge = charge * (1 + self.bend * charge) + self.rng.normal(0, self.noise, charge.shape)
        return np.clip(np.rint(self.offset + charge / self.gain), 0, self.top).astype(np.uint16)

    def biases(self, count):
        return Stack.of("bias", self.read(np.zeros((count, self.size, self.size))))

    def darks(self, count, seconds):
        shape = (count, self.size, self.size)
        return Stack.of("dark", self.read(np.broadcast_to(self.dark * seconds, shape)), seconds)

    def flats(self, count, seconds, rate=14000.0, drift=0.004):
        lamp = rate * seconds * (1 + drift * self.rng.normal(size=(count, 1, 1)))
        return Stack.of("flat", self.read(lamp * self.response + self.dark * seconds), seconds)


@pytest.fixture
def camera(rng):
    return Camera(rng)


@pytest.fixture
def a_camera(rng):
    """A camera of given properties."""
    return lambda **properties: Camera(rng, **properties)
