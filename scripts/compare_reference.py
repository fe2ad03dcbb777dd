"""Compare a task's results with another environment's or with reference values; read and write these.

A directory of reference values holds ``full/`` and ``quick/``; each has a ``reference.json`` with the origin
of the values, and a CSV file for each output of each task.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from compare_columns import compare
from compare_report import TaskResult
from compare_runs import Environment, Run, clean, run_pairs, run_task
from compare_tasks import Output, Task
from compare_values import Values, read_output, read_values, write_values

RECORD = "reference.json"
SEED, ABERRATIONS = "0", "3.0"
"""Seed of the simulated night, and rms of each of its aberrations in nm."""


def night_maker(environment: Environment, cache: Path) -> Callable[[Path, int], None]:
    """Return a function that simulates a night with an environment, by its own ``make_night`` if present."""
    own = environment.package.parent / "scripts" / "make_night"
    script = own if own.is_file() else Path(__file__).resolve().parent / "make_night"

    def make_night(directory: Path, frames: int) -> None:
        options = ["--frames", str(frames), "--seed", SEED, "--aberrations", ABERRATIONS]
        done = subprocess.run(
            [environment.root / "bin" / "python", script, directory, *options],
            env=clean(cache.absolute()),
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode:
            raise ValueError(f"{script} fails with {environment}: {done.stderr.strip().splitlines()[-1:]}")

    return make_night


@dataclass(frozen=True)
class Reference:
    """Reference values of one version; ``record`` is the content of ``reference.json``."""

    directory: Path
    record: dict

    def __str__(self) -> str:
        said = self.record
        return f"values of jitterkit {said['version']} ({said['commit']}), {said['written']}"

    def values(self, task: Task, output: Output) -> Values:
        """Return the values of an output."""
        return read_values(self.directory / file_name(task, output), output.keys)


def file_name(task: Task, output: Output) -> str:
    """Return the name of the file with the values of an output."""
    return f"{task.name}.{output.name}.csv"


def is_reference(directory: Path) -> bool:
    """Return whether a directory holds reference values."""
    return any((directory / size / RECORD).is_file() for size in ("full", "quick"))


def read_reference(directory: Path, size: str) -> Reference:
    """Read the record of the reference values.

    Raises
    ------
    ValueError
        If there are no values of this size.
    """
    path = directory / size / RECORD
    if not path.is_file():
        raise ValueError(f"There is no {path}; make it with --write-reference OLD.")
    return Reference(path.parent, json.loads(path.read_text(encoding="utf-8")))


def write_reference(
    directory: Path, size: str, environment: Environment, tasks: list[Task], work: Path, inputs: dict
) -> int:
    """Run all tasks in an environment, write their values, and return the exit status.

    Raises
    ------
    ValueError
        If a task does not write its tables; then no values are written.
    """
    found, exits = {}, {}
    for task in tasks:
        done = run_task(task, environment, work, work / "caches" / environment.name / "shared", {})
        exits[task.name] = done.status
        for output in task.outputs:
            path = work / environment.name / task.name / output.file
            if not path.is_file():
                raise ValueError(f"{task.name} did not write {output.file}: {done.said}")
            found[file_name(task, output)] = read_output(path, output.keys)
    shutil.rmtree(directory / size, ignore_errors=True)
    (directory / size).mkdir(parents=True)
    for name, values in found.items():
        write_values(directory / size / name, values)
    record = {
        "version": environment.version,
        "commit": environment.commit,
        "written": time.strftime("%Y-%m-%d"),
        "inputs": inputs,
        "commands": {task.name: " ".join(["jitterkit", *task.words("OUT")]) for task in tasks},
        "exit_status": exits,
    }
    (directory / size / RECORD).write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
    total = sum(path.stat().st_size for path in (directory / size).iterdir())
    print(f"{environment}: {len(found)} tables, {total / 1000:.0f} kB in {directory / size}")
    return 0


def against_reference(
    task: Task, new: Environment, reference: Reference, work: Path, inputs: dict[str, str], options: dict
) -> TaskResult:
    """Run a task in NEW and compare its values with the reference."""
    if task.name not in reference.record["exit_status"]:
        return TaskResult(task.name, "the reference has no values of this task")
    if task.inputs and inputs[task.inputs] != reference.record["inputs"].get(task.inputs):
        return TaskResult(
            task.name,
            f"ITS INPUTS ({task.inputs}) DIFFER FROM THOSE OF THE REFERENCE, so the values cannot be "
            "compared; compare with an environment of the old version: scripts/compare_versions OLD NEW",
        )
    done = run_task(task, new, work, work / "caches" / new.name / "shared", options["new"])
    statuses = (reference.record["exit_status"][task.name], done.status)
    old = [reference.values(task, output) for output in task.outputs]
    return _result(task, old, work / new.name / task.name, statuses, done)


def against_environment(
    task: Task, sides: tuple[Environment, Environment], work: Path, pairs: int, options: dict
) -> TaskResult:
    """Run a task in both environments, and compare the values of the first runs."""
    times = run_pairs(task, sides, work, pairs, options)
    first, second = (work / side.name / f"{task.name}.first" for side in sides)
    missing = [output.file for output in task.outputs if not (first / output.file).is_file()]
    if missing:
        said = f"OLD wrote no {missing[0]} (exit status {times.first[0].status}): {times.first[0].said}"
        return TaskResult(task.name, said, times=times)
    old = [read_output(first / output.file, output.keys) for output in task.outputs]
    statuses = (times.first[0].status, times.first[1].status)
    result = _result(task, old, second, statuses, times.first[1], times)
    later = {(before.status, after.status) for before, after in times.pairs} - {statuses}
    if later:
        problem = f"exit statuses of OLD and NEW are {statuses}, and {later.pop()} when run again"
        return replace(result, problem=result.problem or problem)
    return result


def _result(task, old: list[Values], new: Path, statuses: tuple[int, int], done: Run, times=None):
    """Compare the outputs of a task: OLD's values, the directory of NEW's values, and both exit statuses."""
    missing = [output.file for output in task.outputs if not (new / output.file).is_file()]
    if missing:
        problem = f"NEW wrote no {missing[0]} (exit status {done.status}): {done.said}"
        return TaskResult(task.name, problem, times=times)
    try:
        comparisons = {
            output.name: compare(values, read_output(new / output.file, output.keys))
            for output, values in zip(task.outputs, old, strict=True)
        }
    except ValueError as error:
        return TaskResult(task.name, f"NEW's output cannot be read: {error}", times=times)
    if statuses[0] != statuses[1]:
        comparisons["exit"] = compare(*(_exit_status(status) for status in statuses))
    return TaskResult(task.name, "", comparisons, times)


def _exit_status(status: int) -> Values:
    """Return an exit status as a table with one text cell."""
    return Values((), {"exit_status": np.array([str(status)])})
