"""Frames of the one telescope whose truth is known, and kernel estimates of a night."""

from __future__ import annotations

from dataclasses import dataclass

import equinox as eqx
import numpy as np
import pytest

from jitterkit.forward import Parameters, expected_image
from jitterkit.kernel_estimate import KernelEstimate
from jitterkit.likelihood import Data
from jitterkit.loci import Mvn
from jitterkit.optics.system import OpticalSystem
from jitterkit.refit import Priors
from jitterkit.scene import Binary

_image = eqx.filter_jit(expected_image)


@dataclass(frozen=True)
class Bench:
    """Frames whose truth is known, and a start that is off."""

    optics: OpticalSystem

    def truth(self, locus, aberrations=(0.0, 0.0), flux=3e6, background=0.0):
        return Parameters(Binary(5.0, 140.0, 0.3, -0.2, flux, 3.0), locus, aberrations, background)

    def image(self, truth):
        return np.asarray(_image(truth, self.optics.otf(truth.aberrations)))

    def draw(self, truth, rng, read_noise=2.4):
        image = self.image(truth)
        return Data(rng.poisson(image) + rng.normal(0, read_noise, image.shape), read_noise**2)

    def near(self, locus=None):
        locus = Mvn.of(0.1) if locus is None else locus
        return Parameters(Binary(5.1, 141.0, 0.35, -0.15, 2.8e6, 2.8), locus, np.zeros(2))


@pytest.fixture(scope="session")
def bench(optics):
    return Bench(optics)


@pytest.fixture(scope="session")
def estimates():
    """Kernel estimates of the frames of a night, whose jitter differs from frame to frame."""

    def drawn(rng, n, scatter=3e-3, error=1e-3):
        moments = np.array([0.02, 0.004, 0.01]) + np.hypot(scatter, error) * rng.normal(size=(n, 3))
        covariance = np.eye(3) * error**2
        return [KernelEstimate(m, covariance, "score", f"night.fits[{k}]") for k, m in enumerate(moments)]

    return drawn


@pytest.fixture(scope="session")
def same():
    """Whether two priors say the same of the moments."""

    def compared(one: Priors, other: Priors) -> bool:
        if one.moments is None or other.moments is None:
            return one.moments is other.moments
        return all(np.array_equal(a, b) for a, b in zip(one.moments, other.moments, strict=True))

    return compared
