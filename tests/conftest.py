"""What every test shares: double precision, compiled programs, and optics that are built once."""

import functools
import os
import shutil
import tempfile
from dataclasses import replace
from pathlib import Path

import compiled_programs
import jax
import numpy as np
import pytest

from jitterkit.instruments import load_instrument
from jitterkit.instruments.presets import PRESETS
from jitterkit.optics import expand, flat_band, obstructed_circle
from jitterkit.optics.toliman import cache_directory

jax.config.update("jax_enable_x64", True)
# Most of a run's time is XLA's, and a third of that its optimisations.  An empty XLA_FLAGS, which
# scripts/check --all sets, tests programs as users compile them.
os.environ.setdefault(
    "XLA_FLAGS", "--xla_backend_optimization_level=0 --xla_llvm_disable_expensive_passes=true"
)

_STORE_LIMIT = 1 << 30
"""Bytes of compiled programs that are kept between runs; a run of all tests makes about 150 MB."""

_PROGRAM_MEMORY = 3 << 30
"""Resident bytes of a test process beyond which it forgets its programs: all of them together fill 6 GB."""

_STORE = pytest.StashKey[compiled_programs.Store]()
_OWN = pytest.StashKey[Path]()


def pytest_configure(config):
    """Keep what tests, and the commands they start, have made once out of the user's cache.

    Each process of each session has a cache of its own; compiled programs are exchanged with a store that
    outlives the session (:mod:`compiled_programs`).  ``JITTERKIT_TEST_CACHE`` chooses its folder.
    """
    chosen = os.environ.get("JITTERKIT_TEST_CACHE")
    folder = Path(chosen) if chosen else cache_directory().with_name("jitterkit-tests")
    own = Path(tempfile.mkdtemp(prefix="jitterkit-"))
    config.add_cleanup(functools.partial(shutil.rmtree, own, ignore_errors=True))
    os.environ["JITTERKIT_CACHE"] = str(own)
    config.stash[_STORE] = compiled_programs.Store(folder / compiled_programs.machine(), _STORE_LIMIT)
    config.stash[_OWN] = own / "compiled"
    jax.config.update("jax_compilation_cache_dir", str(config.stash[_OWN]))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)


def pytest_unconfigure(config):
    """Keep the store small: the first process of a session does, when the others have ended."""
    if not hasattr(config, "workerinput"):
        config.stash[_STORE].prune()


@pytest.fixture(scope="module", autouse=True)
def _exchange_compiled_programs(pytestconfig):
    """Share compiled programs with the other processes, and forget them where they fill the memory."""
    pytestconfig.stash[_STORE].exchange(pytestconfig.stash[_OWN])
    yield
    pytestconfig.stash[_STORE].exchange(pytestconfig.stash[_OWN])
    if _resident_bytes() > _PROGRAM_MEMORY:
        jax.clear_caches()


def _resident_bytes():
    """Memory of this process; unknown counts as too much."""
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
    except OSError:
        return _PROGRAM_MEMORY + 1
    return pages * os.sysconf("SC_PAGE_SIZE")


@pytest.fixture
def rng():
    return np.random.default_rng(20261)


def _plain_telescope():
    return replace(
        load_instrument("smallsat"),
        name="plain",
        shape=(48, 44),
        spectrum=flat_band(530.0, 640.0, 3),
        pupil_from=obstructed_circle(0.125, 0.04, samples=64, noll=(7, 8)),
        pad=16,
    )


@pytest.fixture(scope="session")
def telescope():
    """The one telescope of all tests that do not test a telescope; commands know it as the preset ``plain``.

    Every shape, list of aberrations and set of free parameters is a program of its own, which takes seconds
    to compile.  A test with a telescope of its own says why.  Rows and columns differ in number, so that an
    x for a y shows.
    """
    return _plain_telescope()


@pytest.fixture(scope="session", autouse=True)
def _plain_preset():
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(PRESETS, "plain", _plain_telescope)
        yield


@pytest.fixture(scope="session")
def optics(telescope):
    """Optics of the one telescope on its own grid."""
    return telescope.system()


@pytest.fixture(scope="session")
def otf(optics):
    """Transfer function of the one telescope without aberrations."""
    return optics.nominal


@pytest.fixture(scope="session")
def plain_otf(optics):
    """The same telescope with no aberrations to fit, for tests of blur alone."""
    pupil = obstructed_circle(0.125, 0.04, samples=64, noll=())
    return expand(pupil, optics.spectrum, optics.grid)


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
