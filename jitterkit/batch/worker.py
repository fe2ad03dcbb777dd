"""What a worker of dask.distributed is given, so that its rows are those of the process that sent for it.

The one door to dask.distributed: ``distributed`` is None where the extra ``cluster`` is not installed.
"""

from __future__ import annotations

import os
import pickle
import time
from contextlib import closing, suppress
from importlib import import_module
from pathlib import Path
from typing import Any, TypeVar

import jax
import jax.numpy as jnp

from jitterkit.batch.configuration import versions
from jitterkit.batch.executor import Finish, FrameTask, execute
from jitterkit.batch.plan import Batch
from jitterkit.errors import ConfigurationError, ErrorCode

T = TypeVar("T")


distributed: Any = None
with suppress(ImportError):  # reported when a cluster is asked for
    distributed = import_module("distributed")
Part = tuple[Batch, ...]
"""Batches with the same reference frames."""

_SECONDS = 8.0
"""After which a worker hands back what it has done: it is lost with the worker until then."""

_SHARED = (
    "jax_enable_x64",
    "jax_platforms",
    "jax_compilation_cache_dir",
    "jax_persistent_cache_min_compile_time_secs",
)
"""Options of JAX that workers take from this process."""


class WorkerSetup(distributed.WorkerPlugin if distributed else object):  # type: ignore[misc]
    """Hold the settings that a worker needs to process frames as this process would.

    Whatever worker joins later, or replaces one that died, gets it too.

    Parameters
    ----------
    task : FrameTask
    hdu : int, optional
        To read in every FITS file.
    probe : Path
        A file that workers must see.
    """

    def __init__(self, task: FrameTask, hdu: int | None, probe: Path) -> None:
        self.pickled, self.hdu = pickle.dumps(task), hdu
        self.probe = probe if probe.exists() else None
        self.directory = os.getcwd()
        self.computed = _computed_with()
        self.configured = {name: getattr(jax.config, name) for name in _SHARED}
        self.xla_flags = os.environ.get("XLA_FLAGS", "")

    def setup(self, worker: Any) -> None:
        self._compare(worker.address, versions())  # another XLA may lack an option, and not start
        os.environ.setdefault("XLA_FLAGS", self.xla_flags)
        # no digit depends on these: otherwise XLA would start as many threads as there are processors in
        # every process, and take three quarters of a GPU; with fewer threads than the worker has, programs
        # of its own would wait for each other
        os.environ.setdefault("NPROC", str(worker.state.nthreads))
        os.environ.setdefault("XLA_PYTHON_CLIENT_PREALLOCATE", "false")
        for name, value in self.configured.items():
            jax.config.update(name, value)
        self.home = os.getcwd()
        if os.path.isdir(self.directory):
            os.chdir(self.directory)  # for paths that are relative
        if self.probe is not None and not self.probe.exists():
            raise ConfigurationError(
                ErrorCode.NOT_FOUND,
                f"The worker {worker.address} does not see {self.probe}: files must be readable there under "
                "the same path; mount the file system there, or give a path that is the same everywhere.",
            )
        self._compare(worker.address, _computed_with())
        self.task = pickle.loads(self.pickled)

    def teardown(self, worker: Any) -> None:
        os.chdir(self.home)

    def _compare(self, address: str, here: dict[str, str]) -> None:
        """Refuse a worker that would give other rows."""
        for name, own in here.items():
            if own != self.computed[name]:
                problem = f"The worker {address} computes with {name} {own}, this process with"
                problem = f"{problem} {self.computed[name]}, which changes the last digits"
                raise ConfigurationError(ErrorCode.CONFLICT, f"{problem}; make them the same.")


def _computed_with() -> dict[str, str]:
    """Return what the last digits depend on."""
    (device,) = jnp.zeros(()).devices()
    return {**versions(), "XLA_FLAGS": os.environ.get("XLA_FLAGS", ""), "device": device.platform}


def work(name: str, part: Part, finish: Finish[T]) -> tuple[list[T], Part, str]:
    """Process a part of a run at a worker, for some seconds.

    Returns
    -------
    finished : list
        What ``finish`` made of frames.
    rest : tuple of Batch
        What is left of the part.
    address : str
        Of the worker, which knows what the reference frames of the part show.
    """
    worker, left = distributed.get_worker(), list(part)
    setup, began, finished = worker.plugins[name], time.monotonic(), []
    outcomes = execute(part, setup.task, lambda batch, outcomes: (batch, outcomes), hdu=setup.hdu, threads=1)
    with closing(outcomes):
        for batch, done in outcomes:
            finished.append(finish(batch, done))
            left[:1] = [rest] if (rest := left[0].part(len(batch.items))).items else []
            if time.monotonic() - began > _SECONDS:
                break
    return finished, tuple(left), worker.address
