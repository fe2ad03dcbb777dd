"""What every test shares: double precision, and optics that are built once."""

import functools
import os
import shutil
import tempfile

import jax
import numpy as np
import pytest

jax.config.update("jax_enable_x64", True)


def pytest_configure(config):
    """Keep what tests, and the commands they start, have made once out of the user's cache.

    Each process of each session has a cache of its own: JAX does not write a compiled program in one stroke,
    so that another could read half of it, and what a killed session leaves is never read again.
    """
    own = tempfile.mkdtemp(prefix="jitterkit-")
    config.add_cleanup(functools.partial(shutil.rmtree, own, ignore_errors=True))
    os.environ["JITTERKIT_CACHE"] = own
    jax.config.update("jax_compilation_cache_dir", os.path.join(own, "compiled"))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.1)


@pytest.fixture(scope="module", autouse=True)
def _forget_compiled_programs():
    """Compiled programs of all modules together fill 6 GB; those of another module are read from the disk."""
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
