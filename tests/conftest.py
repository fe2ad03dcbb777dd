"""What every test shares: double precision, and optics that are built once."""

import os

import jax
import numpy as np
import pytest

jax.config.update("jax_enable_x64", True)


def pytest_configure(config):
    """Keep the TOLIMAN pupil of the tests, and of the commands they start, out of the user's cache."""
    if getattr(config, "cache", None) is not None:
        os.environ.setdefault("JITTERKIT_CACHE", str(config.cache.mkdir("jitterkit")))


@pytest.fixture(scope="module", autouse=True)
def _forget_compiled_programs():
    """Compiled programs of all modules together fill 6 GB; hardly one serves two modules."""
    yield
    jax.clear_caches()


@pytest.fixture
def rng():
    return np.random.default_rng(20261)


@pytest.fixture(scope="session")
def toliman_system():
    """dLuxToliman's default optics at native sampling (7 s)."""
    toliman = pytest.importorskip("dLuxToliman")
    return toliman.TolimanOpticalSystem(noll_indices=list(range(4, 11)), oversample=1)


@pytest.fixture(scope="session")
def toliman(toliman_system):
    """The TOLIMAN pupil, taken from dLux in this very run and not from a cache."""
    from jitterkit.optics import pupil_from_dlux

    return pupil_from_dlux(toliman_system, [f"noll{j}" for j in range(4, 11)])
