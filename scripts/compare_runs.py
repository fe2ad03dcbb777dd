"""Run the commands of two environments in turn, and measure their cpu time and peak memory.

An :class:`Environment` records where jitterkit is installed; :func:`run_pairs` runs a task in both.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median

from compare_tasks import Task

_PROBE = (
    "import importlib.metadata as m, importlib.util as u, json; "
    "print(json.dumps([m.version('jitterkit'), u.find_spec('jitterkit').origin]))"
)

_COMMAND = "from jitterkit.cli.main import run; run()"
"""The command line by an environment's own Python: the first line of ``bin/jitterkit`` may name another."""


@dataclass(frozen=True)
class Environment:
    """A virtual environment in which jitterkit is installed.

    Attributes
    ----------
    name : str
        ``old`` or ``new``; also the name of its directories.
    root : Path
    version, commit : str
        The commit is empty where the package is no git checkout, and ends with ``+changes`` where files
        of the package differ from it.
    package : Path
        Directory of the package.
    """

    name: str
    root: Path
    version: str
    commit: str
    package: Path

    def __str__(self) -> str:
        return f"jitterkit {self.version}{f' ({self.commit})' if self.commit else ''} in {self.root}"


def check_environment(root: Path) -> None:
    """Raise an error if a directory is not an environment with jitterkit.

    Raises
    ------
    ValueError
    """
    if not root.is_dir():
        raise ValueError(f"There is no environment {root}; give the directory of one.")
    for program in ("jitterkit", "python"):
        if not (root / "bin" / program).is_file():
            raise ValueError(
                f"There is no bin/{program} in {root}; give an environment with jitterkit in it."
            )


def find_environment(root: Path, name: str) -> Environment:
    """Return an environment with its version of jitterkit.

    Raises
    ------
    ValueError
        If it is not an environment, or its Python does not find jitterkit.
    """
    check_environment(root)
    asked = subprocess.run(
        [root / "bin" / "python", "-P", "-c", _PROBE],
        capture_output=True,
        text=True,
        env=clean(),
        check=False,
    )
    if asked.returncode:
        reason = (asked.stderr.strip().splitlines() or ["no error message"])[-1]
        raise ValueError(f"The Python of {root} does not find jitterkit: {reason}")
    version, origin = json.loads(asked.stdout)
    package = Path(origin).parent
    return Environment(name, root.absolute(), version, _commit(package), package)


def _commit(package: Path) -> str:
    if not (package.parent / ".git").exists() or shutil.which("git") is None:
        return ""
    git = ["git", "-C", str(package.parent)]
    head = subprocess.run([*git, "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=False)
    changes = subprocess.run(
        [*git, "status", "--porcelain", "--", package.name], capture_output=True, text=True, check=False
    )
    return head.stdout.strip() + ("+changes" if changes.stdout.strip() else "")


def clean(cache: Path | None = None) -> dict[str, str]:
    """Return the variables of a child process: without coverage and PYTHONPATH, with its own cache."""
    kept = {k: v for k, v in os.environ.items() if not k.startswith(("COVERAGE_", "PYTHONPATH"))}
    return kept | ({"JITTERKIT_CACHE": str(cache)} if cache else {})


@dataclass(frozen=True)
class Run:
    """Cpu time, memory and exit status of one command.

    ``cpu`` is the time of all its processes and threads in s, ``memory`` the peak of its largest process in
    MB, and ``said`` the last line of its stderr.
    """

    cpu: float
    wall: float
    memory: float
    status: int
    said: str


def run(command: Sequence[str | Path], directory: Path, cache: Path, log: Path) -> Run:
    """Run a command and measure it."""
    began = time.perf_counter()
    with log.open("wb") as stderr:
        process = subprocess.Popen(
            command, cwd=directory, env=clean(cache.absolute()), stdout=subprocess.DEVNULL, stderr=stderr
        )
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    wall = time.perf_counter() - began
    unit = 1e6 if sys.platform == "darwin" else 1e3
    said = log.read_text(encoding="utf-8", errors="replace").strip().splitlines()[-1:]
    return Run(
        usage.ru_utime + usage.ru_stime, wall, usage.ru_maxrss / unit, process.returncode, "".join(said)
    )


def run_task(
    task: Task, environment: Environment, work: Path, cache: Path, options: Mapping[str, Sequence[str]]
) -> Run:
    """Run a task in an environment, with its outputs in ``work/ENVIRONMENT/TASK``."""
    out = Path(environment.name) / task.name
    shutil.rmtree(work / out, ignore_errors=True)
    (work / out).mkdir(parents=True)
    command = [environment.root / "bin" / "python", "-P", "-c", _COMMAND, *task.words(str(out), options)]
    done = run(command, work, cache, work / environment.name / f"{task.name}.log")
    print(f"{task.name}: {environment.name} {done.cpu:.1f} s cpu, {done.memory:.0f} MB", file=sys.stderr)
    return done


@dataclass(frozen=True)
class Times:
    """Runs of a task in OLD and NEW: first runs with an empty cache, and pairs of runs with a filled one."""

    first: tuple[Run, Run]
    pairs: tuple[tuple[Run, Run], ...]

    def ratio(self, quantity: str) -> float:
        """Return the median over the pairs of NEW / OLD of ``cpu`` or ``memory``; NaN without pairs."""
        ratios = [getattr(new, quantity) / getattr(old, quantity) for old, new in self.pairs]
        return median(ratios) if ratios else float("nan")

    def typical(self, quantity: str) -> tuple[float, float]:
        """Return the medians of OLD and NEW; without pairs, those of the first runs."""
        runs = zip(*(self.pairs or (self.first,)), strict=True)
        old, new = (median(getattr(done, quantity) for done in side) for side in runs)
        return old, new


def run_pairs(
    task: Task, environments: tuple[Environment, Environment], work: Path, pairs: int, options
) -> Times:
    """Run a task once with an empty cache and then in alternating pairs (AB, BA, AB ...).

    The outputs of the first runs are kept in ``work/ENVIRONMENT/TASK.first``.
    """
    caches = {side.name: work / "caches" / side.name / task.name for side in environments}
    first = {}
    for side in environments:
        first[side.name] = run_task(task, side, work, caches[side.name], options[side.name])
        out = work / side.name / task.name
        out.rename(out.with_name(f"{task.name}.first"))
    measured = []
    for number in range(pairs):
        order = environments if number % 2 == 0 else environments[::-1]
        done = {
            side.name: run_task(task, side, work, caches[side.name], options[side.name]) for side in order
        }
        measured.append((done["old"], done["new"]))
    return Times((first["old"], first["new"]), tuple(measured))
