"""What a worker of dask.distributed is given, so that its rows are those of the process that sent for it.

The one door to dask.distributed: ``distributed`` is None where the extra ``cluster`` is not installed.
"""

from __future__ import annotations

import os
import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp

from jitterkit.batch.configuration import versions
from jitterkit.batch.frame import Processor
from jitterkit.batch.ledger_worst import Rank, rank
from jitterkit.batch.plan import Batch
from jitterkit.batch.stream import Done, process_batches
from jitterkit.errors import ConfigurationError, ErrorCode

__all__ = ["Equipment", "Part", "distributed", "fit"]


def _distributed() -> Any:
    try:
        import distributed
    except ImportError:  # told when a cluster is asked for
        return None
    return distributed


distributed = _distributed()


Part = tuple[Batch, ...]
"""Batches with one lead, done one after the other by one who looks at the lead once."""


_SHARED = (
    "jax_enable_x64",
    "jax_platforms",
    "jax_compilation_cache_dir",
    "jax_persistent_cache_min_compile_time_secs",
)
"""What JAX is told at the workers as it was told here."""


class Equipment(distributed.WorkerPlugin if distributed else object):  # type: ignore[misc]
    """What a worker needs to fit frames as this process would.

    Whatever worker joins later, or takes the place of one that died, gets it too.
    """

    def __init__(self, processor: Processor, hdu: int | None, witness: Path) -> None:
        self.pickled = pickle.dumps(replace(processor, known={}, _systems={}))
        self.hdu = hdu
        self.witness = witness if witness.exists() else None
        self.directory = os.getcwd()
        self.computed = _computed_with()
        self.told = {name: getattr(jax.config, name) for name in _SHARED}

    def setup(self, worker: Any) -> None:
        for name, value in _environment(worker.state.nthreads).items():
            os.environ.setdefault(name, value)
        for name, value in self.told.items():
            jax.config.update(name, value)
        self.home = os.getcwd()
        if os.path.isdir(self.directory):
            os.chdir(self.directory)  # for paths that are relative
        self._look(worker.address)
        self.processor = pickle.loads(self.pickled)

    def teardown(self, worker: Any) -> None:
        os.chdir(self.home)

    def _look(self, address: str) -> None:
        """Refuse a worker that would give other rows."""
        if self.witness is not None and not self.witness.exists():
            raise ConfigurationError(
                ErrorCode.NOT_FOUND,
                f"The worker {address} does not see {self.witness}: files must be readable there under the "
                "same path; mount the file system there, or give a path that is the same everywhere.",
            )
        here = _computed_with()
        for name in self.computed:
            if here.get(name) != self.computed[name]:
                raise ConfigurationError(
                    ErrorCode.CONFLICT,
                    f"The worker {address} computes with {name} {here.get(name)}, this process with "
                    f"{self.computed[name]}, which changes the last digits; make them the same.",
                )


def _environment(threads: int) -> dict[str, str]:
    """Of a worker that has set nothing else; no digit depends on it.

    Otherwise XLA would start as many threads as there are processors in every process, and take three
    quarters of a GPU; with fewer than the worker has, programs of its own would wait for each other.
    """
    return {"NPROC": str(threads), "XLA_PYTHON_CLIENT_PREALLOCATE": "false"}


def _computed_with() -> dict[str, str]:
    """What the last digits depend on."""
    (device,) = jnp.zeros(()).devices()
    return {**versions(), "device": device.platform}


def fit(name: str, part: Part, ranks: tuple[Rank, ...]) -> list[Done]:
    """What a worker does: some batches, and no picture that would be worse than those drawn before."""
    equipment: Any = distributed.get_worker().plugins[name]
    known, finished = list(ranks), []
    for done in process_batches(part, equipment.processor, hdu=equipment.hdu, threads=1, ranks=known.copy):
        known += [rank(done.rows[place], done.batch.number, place) for place in done.pictures]
        finished.append(done)
    return finished
