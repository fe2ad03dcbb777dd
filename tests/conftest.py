"""Set up what all tests share: double precision, compiled programs, and optics that are built once."""

import functools
import gc
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
from jitterkit.optics import Colours, expand, flat_band, obstructed_circle
from jitterkit.optics.toliman import cache_directory

jax.config.update("jax_enable_x64", True)
# No optimisation, because a cold run compiles much.  XLA's old code generator compiles a program in half the
# time of its new one ("fusion emitters"): modules that mostly fit take 0.65 of the processor time in all.
# scripts/check --all sets XLA_FLAGS to an empty text, and so tests programs as users compile them.
_FLAGS = ["--xla_backend_optimization_level=0", "--xla_llvm_disable_expensive_passes=true"]
# To compile the parts of a program side by side takes a tenth longer where each core has its own process.
if jax.__version_info__ < (0, 12):  # an XLA that lacks a flag refuses to start
    _FLAGS += ["--xla_cpu_use_fusion_emitters=false", "--xla_cpu_parallel_codegen_split_count=1"]
os.environ.setdefault("XLA_FLAGS", " ".join(_FLAGS))

# Tracing a program makes very many objects, few of them garbage: to look for it seldom saves 8 % of the
# processor time of modules that mostly trace.
gc.set_threshold(200_000, 10, 10)

_STORE_LIMIT = 1 << 30
"""Bytes of compiled programs to keep between runs; a run of the default tests wrote 167 MB."""

_PROGRAM_MEMORY = 3 << 30
"""Resident bytes above which a test process clears its compiled programs; all of them would fill 6 GB."""

_STORE = pytest.StashKey[compiled_programs.Store]()
_OWN = pytest.StashKey[Path]()


def pytest_configure(config):
    """Use a temporary cache for the tests and the commands they start, not the user's.

    Each process of each session has its own cache.  It exchanges compiled programs with a store that outlives
    the session (:mod:`compiled_programs`).  ``JITTERKIT_TEST_CACHE`` sets the folder of that store.
    """
    default = cache_directory().with_name("jitterkit-tests")
    folder = os.environ.setdefault("JITTERKIT_TEST_CACHE", str(default))  # worker processes inherit it
    own = Path(tempfile.mkdtemp(prefix="jitterkit-"))
    config.add_cleanup(functools.partial(shutil.rmtree, own, ignore_errors=True))
    os.environ["JITTERKIT_CACHE"] = str(own)
    store = compiled_programs.Store(Path(folder) / compiled_programs.machine(), _STORE_LIMIT)
    config.stash[_STORE], config.stash[_OWN] = store, own / "compiled"
    if hasattr(config, "workerinput") or not config.getoption("numprocesses", None):
        store.exchange(config.stash[_OWN])  # before fixtures of the session compile anything
    compiled_programs.use(config.stash[_OWN])


def pytest_unconfigure(config):
    """Prune the store in the main process, after the worker processes have ended."""
    if not hasattr(config, "workerinput"):
        store = config.stash.get(_STORE, None)  # none if the configuration failed
        if store is not None:
            store.prune()


@pytest.fixture(scope="module", autouse=True)
def _exchange_compiled_programs(pytestconfig):
    """Share compiled programs with the other processes, and clear them from memory if they fill it."""
    yield
    pytestconfig.stash[_STORE].exchange(pytestconfig.stash[_OWN])
    if _resident_bytes() > _PROGRAM_MEMORY:
        jax.clear_caches()


def _resident_bytes():
    """Return the resident bytes of this process; more than the limit if they are unknown."""
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
    except OSError:
        return _PROGRAM_MEMORY + 1
    return pages * os.sysconf("SC_PAGE_SIZE")


@pytest.fixture
def rng():
    return np.random.default_rng(20261)


def _plain_telescope(colours=None):
    return replace(
        load_instrument("smallsat"),
        name="plain",
        colours=colours,
        shape=(48, 44),
        spectrum=flat_band(530.0, 640.0, 3),
        pupil_from=obstructed_circle(0.125, 0.04, samples=64, noll=(7, 8)),
        pad=16,
    )


@pytest.fixture(scope="module")
def few_pictures():
    """Draw two fitted frames of a run and two others, not 24: a picture takes a tenth of a second."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("jitterkit.batch.ranking.TOP", 2)
        yield


@pytest.fixture(scope="session")
def common_telescope():
    """Return the common telescope, for a module whose fixture ``telescope`` is another one."""
    return _plain_telescope()


@pytest.fixture(scope="session")
def telescope(common_telescope):
    """Return the telescope of all tests that need no special one; in commands it is the preset ``plain``.

    Each image shape, list of aberrations and set of free parameters needs its own compiled program, which
    takes seconds.  A test that uses another telescope gives the reason.  Rows and columns differ in number,
    so that a test fails if x and y are exchanged.  Its sources have one spectrum, which takes fewer programs;
    the preset has stars of unknown colours, as users have them.
    """
    return common_telescope


@pytest.fixture(scope="session", autouse=True)
def _plain_preset():
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(PRESETS, "plain", functools.partial(_plain_telescope, Colours()))
        yield


@pytest.fixture(scope="session")
def optics(telescope):
    """Return the optics of the common telescope on its own grid."""
    return telescope.system()


@pytest.fixture(scope="session")
def otf(optics):
    """Return the transfer function of the common telescope without aberrations."""
    return optics.nominal


@pytest.fixture(scope="session")
def plain_otf():
    """Return the telescope's transfer function with no aberrations to fit, for tests of blur alone."""
    optics = _plain_telescope().system()  # not the fixture, which a module may replace
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
