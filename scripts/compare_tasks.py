"""List what ``scripts/compare_versions`` runs: a :class:`Task` is one command with its output tables.

:func:`make_tasks` returns the tasks; :data:`FULL` and :data:`QUICK` set their numbers of frames.
"""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from compare_values import NUMBERS

FRAME = ("file", "frame")


@dataclass(frozen=True)
class Sizes:
    """Amounts of data for the tasks.

    Attributes
    ----------
    night, part, sequence : int
        Number of frames of the simulated night, and how many of its first frames are for ``process`` with
        the locus auto and for ``sequence``.
    samples : tuple of str
        Names of sample frames; empty for all of them.
    fields, stars, side : int
        Number of trailed star fields, stars in each field, and pixels along its sides.
    draws : int
        Noisy frames for each setting of ``crossfit``.
    """

    night: int = 300
    part: int = 100
    sequence: int = 60
    samples: tuple[str, ...] = ()
    fields: int = 4
    stars: int = 80
    side: int = 512
    draws: int = 200


FULL = Sizes()
QUICK = Sizes(10, 3, 6, ("stable.fits", "shm.tif", "shm.toml"), fields=1, stars=30, side=320, draws=50)


@dataclass(frozen=True)
class Output:
    """A table that a command writes: its name here, its file, and the columns that identify a row."""

    name: str
    file: str
    keys: tuple[str, ...]


@dataclass(frozen=True)
class Task:
    """One command.

    Attributes
    ----------
    name : str
    inputs : str
        The set of inputs that it reads (:mod:`compare_inputs`); empty if it reads none.
    command : str
        Name of the command of jitterkit.
    arguments : tuple of str
        Paths are relative to the directory above ``inputs/``; ``{out}`` is the existing output directory.
    outputs : tuple of Output
    """

    name: str
    inputs: str
    command: str
    arguments: tuple[str, ...]
    outputs: tuple[Output, ...]

    def words(self, out: str, options: Mapping[str, Sequence[str]] | None = None) -> list[str]:
        """Return the words after ``jitterkit``, ending with the options of this command and task."""
        names = dict.fromkeys((self.command, self.name))  # command and task may have one name
        more = [word for name in names for word in (options or {}).get(name, ())]
        return ["-q", self.command, *(word.replace("{out}", out) for word in self.arguments), *more]


def make_tasks(sizes: Sizes) -> list[Task]:
    """Return all tasks, in the order in which they are run."""
    draws = str(sizes.draws)
    return [
        _process("process_sample", "sample", "inputs/sample"),
        _process("process_sample_mvn", "sample", "inputs/sample", "--locus", "mvn"),
        _process("process_night", "night", "inputs/night_part"),
        _process("process_night_mvn", "night", "inputs/night", "--locus", "mvn"),
        _tabled("estimate_night", "night", "estimate inputs/night", FRAME),
        _tabled("estimate_stars", "stars", f"estimate inputs/stars/trailed {_STARS}", FRAME),
        Task(
            "sequence",
            "night",
            "sequence",
            ("inputs/night_sequence", "-o", "{out}"),
            (Output("frames", "sequence.ecsv", ("frame",)), Output("shared", "sequence.json", NUMBERS)),
        ),
        _tabled("forecast", "", "forecast --locus linear --length 0.3 --angle 20", ("parameter",)),
        _tabled("forecast_sweep", "", "forecast --locus mvn --sigma 0.1 --sweep separation=2:14:4", ()),
        _motion("motion_lines", "lines.csv"),
        _motion("motion_trace", "trace.csv"),
        _motion("motion_spectrum", "spectrum.csv"),
        _tabled("crossfit", "", f"crossfit {_CROSSFIT} --draws {draws}", ("data", "size", "angle", "fitted")),
    ]


_STARS = "--stars --reference inputs/stars/sharp.fits --gain 1 --read-noise 5 --bias 0"
_CROSSFIT = "--data shm --data mvn,shear=0.7 --fit linear --fit mvn --fit auto --size 0.15 --angle 45"


def _process(name: str, inputs: str, *arguments: str) -> Task:
    outputs = (Output("frames", "results.ecsv", FRAME), Output("summary", "summary.json", NUMBERS))
    return Task(name, inputs, "process", (*arguments, "-o", "{out}"), outputs)


def _tabled(name: str, inputs: str, line: str, keys: tuple[str, ...]) -> Task:
    command, *arguments = shlex.split(line)
    return Task(
        name, inputs, command, (*arguments, "-o", "{out}/table.ecsv"), (Output("table", "table.ecsv", keys),)
    )


def _motion(name: str, file: str) -> Task:
    """Return a task whose outputs are the budget and the separation's error in its metadata."""
    outputs = (Output("budget", "table.ecsv", ()), Output("loss", "table.ecsv", NUMBERS))
    return Task(name, "motion", "motion", (f"inputs/motion/{file}", "-o", "{out}/table.ecsv"), outputs)


def select(tasks: Sequence[Task], names: Sequence[str]) -> list[Task]:
    """Return the tasks with the given names or commands; all tasks if no name is given.

    Raises
    ------
    ValueError
        If there is no such task or command; the message lists the known names.
    """
    known = {task.name for task in tasks} | {task.command for task in tasks}
    for name in names:
        if name not in known:
            raise ValueError(f"There is no task {name!r}; choose from {', '.join(sorted(known))}.")
    return [task for task in tasks if not names or task.name in names or task.command in names]


def read_options(texts: Sequence[str], tasks: Sequence[Task]) -> dict[str, list[str]]:
    """Read ``NAME=OPTIONS``, where the name is a command's or a task's.

    Raises
    ------
    ValueError
        If there is no such command or task, or no equals sign.

    Examples
    --------
    >>> read_options(["process=--no-background --preset exact"], make_tasks(FULL))
    {'process': ['--no-background', '--preset', 'exact']}
    """
    options: dict[str, list[str]] = {}
    known = {task.name for task in tasks} | {task.command for task in tasks}
    for text in texts:
        name, equals, words = text.partition("=")
        if not equals or name not in known:
            raise ValueError(
                f"--new-options takes NAME=OPTIONS, such as process=--background, not {text!r}; "
                f"the commands and tasks are {', '.join(sorted(known))}."
            )
        options.setdefault(name, []).extend(shlex.split(words))
    return options
