"""What ``scripts/compare_versions`` runs: each :class:`Task` is one command, with the tables that it writes.

:func:`make_tasks` lists them; :data:`FULL` and :data:`QUICK` say how many frames they take.
"""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from compare_values import NUMBERS

FRAME = ("file", "frame")


@dataclass(frozen=True)
class Sizes:
    """How much is run.

    Attributes
    ----------
    night, part, sequence : int
        Frames of the simulated night, and how many of its first ones ``process`` with the locus auto and
        ``sequence`` take.
    samples : tuple of str
        Sample frames; all where empty.
    fields, stars, side : int
        Trailed star fields, the stars of each, and pixels along its sides.
    draws : int
        Noisy frames of a setting of ``crossfit``.
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
    """A table that a command writes: its name here, its file, and the columns that name a row."""

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
        The set of inputs that it reads (:mod:`compare_inputs`), or an empty text.
    command : str
        Of jitterkit.
    arguments : tuple of str
        Run in the directory above ``inputs/``; ``{out}`` is the directory for the outputs, which exists.
    outputs : tuple of Output
    """

    name: str
    inputs: str
    command: str
    arguments: tuple[str, ...]
    outputs: tuple[Output, ...]

    def words(self, out: str, options: Mapping[str, Sequence[str]] | None = None) -> list[str]:
        """Return the command line after ``jitterkit``, with the options of this command at its end."""
        more = (options or {}).get(self.command, ())
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
    """Compare the budget and what its metadata say of the separation's error."""
    outputs = (Output("budget", "table.ecsv", ()), Output("loss", "table.ecsv", NUMBERS))
    return Task(name, "motion", "motion", (f"inputs/motion/{file}", "-o", "{out}/table.ecsv"), outputs)


def select(tasks: Sequence[Task], names: Sequence[str]) -> list[Task]:
    """Return the tasks that are named, by their own names or by their commands; all where none is.

    Raises
    ------
    ValueError
        If a name is neither; the message lists what there is.
    """
    known = {task.name for task in tasks} | {task.command for task in tasks}
    for name in names:
        if name not in known:
            raise ValueError(f"There is no task {name!r}; there are {', '.join(sorted(known))}.")
    return [task for task in tasks if not names or task.name in names or task.command in names]


def read_options(texts: Sequence[str], tasks: Sequence[Task]) -> dict[str, list[str]]:
    """Read ``COMMAND=OPTIONS``.

    Raises
    ------
    ValueError
        If no task runs the command, or there is no equals sign.

    Examples
    --------
    >>> read_options(["process=--no-background --preset exact"], make_tasks(FULL))
    {'process': ['--no-background', '--preset', 'exact']}
    """
    options: dict[str, list[str]] = {}
    commands = {task.command for task in tasks}
    for text in texts:
        command, equals, words = text.partition("=")
        if not equals or command not in commands:
            raise ValueError(
                f"--new-options takes COMMAND=OPTIONS, such as process=--background, not {text!r}; "
                f"the commands are {', '.join(sorted(commands))}."
            )
        options.setdefault(command, []).extend(shlex.split(words))
    return options
