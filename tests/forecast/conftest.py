"""Scenes of the one telescope, and the paper's."""

import equinox as eqx
import numpy as np
import pytest

from jitterkit.forward import Parameters
from jitterkit.loci import Stable
from jitterkit.optics import grid_for, lines
from jitterkit.optics.system import OpticalSystem
from jitterkit.scene import Binary


class Bench(eqx.Module):
    """Optics and the scene that they look at."""

    optics: OpticalSystem
    scene: Binary

    @property
    def otf(self):
        return self.optics.nominal

    def under(self, locus=None, **changes):
        """The scene under a jitter; what is named of it is changed."""
        values = {name: getattr(self.scene, name) for name in self.scene.names} | changes
        state = np.zeros(len(self.optics.pupil.names))
        return Parameters(Binary(**values), locus or Stable.of(), state)


@pytest.fixture(scope="session")
def bench(optics):
    return Bench(optics, Binary(5.0, 150.0, 0.3, -0.2, 3e6, 3.0))


@pytest.fixture(scope="session")
def paper(toliman):
    """The scene of the paper: a lamp of five lines, its own (too many) photons."""
    spectrum = lines(*np.linspace(530, 640, 5))
    optics = OpticalSystem(toliman, spectrum, grid_for(toliman, spectrum, (128, 128), 0.375))
    return Bench(optics, Binary(10.0, 180.0, 0.0, 0.0, 3.811e7, 3.37))
