"""The causes that widen an image alike: in pictures, in tables and in words.

Reach for :func:`plot_causes`; :func:`plot_likeness` draws its matrix on your axes.  :func:`causes_table` and
:func:`data_table` hold the numbers; :func:`causes_sentences` describes the degeneracies of one frame, and
:func:`remedy_sentence` the data that remove them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from astropy.table import QTable
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jitterkit.forecast.causes import Causes, Degeneracy
from jitterkit.forecast.causes_data import Observation, cheapest
from jitterkit.forecast.directions import listed
from jitterkit.report.columns import Column, bind, bind_rows
from jitterkit.report.plots import INK, axes_or_new
from jitterkit.report.words import MINUS, TIMES, number

_HALF = 12
"""Pixels about the brightest on each side."""


def plot_causes(causes: Causes) -> Figure:
    """Draw what every cause does to the image beside each other, and below how alike that is.

    Each change is that by as much blur as shows equally strongly, in sigmas of a pixel's photons and on one
    scale, about the brightest pixel: panels that look alike are taken for each other.
    """
    image, slopes = causes.setting.slopes(causes.locus)
    sigma = np.sqrt(np.maximum(image, 1e-6 * image.max()))
    window = _window(image)
    pairs = zip(causes.causes, causes.blurs, strict=True)
    panels = [(slopes[cause.name] / sigma / blur)[window] for cause, blur in pairs]
    largest = max(float(np.abs(panel).max()) for panel in panels)
    figure = Figure(figsize=(max(2.0 * len(panels), 6.0), 5.8), layout="constrained")
    grid = figure.add_gridspec(2, len(panels), height_ratios=(1.0, 1.7))
    axes = [figure.add_subplot(grid[0, k]) for k in range(len(panels))]
    for ax, cause, panel in zip(axes, causes.causes, panels, strict=True):
        picture = ax.imshow(panel / largest, origin="lower", cmap="RdBu_r", vmin=-1, vmax=1)
        ax.set_title(cause.words.replace(", ", ",\n"), fontsize=8)
        ax.set(xticks=[], yticks=[])
    figure.colorbar(picture, ax=axes, label="change, in sigmas", shrink=0.8, ticks=[-1, 0, 1])
    plot_likeness(causes, figure.add_subplot(grid[1, :]))
    return figure


def plot_likeness(causes: Causes, ax: Axes | None = None) -> Axes:
    """Draw the cosines between the changes that the causes make, the scene refitted to each."""
    ax = axes_or_new(ax, (5.4, 4.4))
    likeness = causes.information.likeness
    labels = [cause.words for cause in causes.causes]
    ax.imshow(likeness, cmap="RdBu_r", vmin=-1, vmax=1)
    for (row, column), value in np.ndenumerate(likeness):
        words = f"{round(value, 2) + 0.0:.2f}".replace("-", MINUS)
        ax.text(column, row, words, ha="center", va="center", fontsize=7,
                color="white" if abs(value) > 0.7 else INK)  # fmt: skip
    ax.set_xticks(range(len(labels)), labels, rotation=25, ha="right", fontsize=8)
    ax.set_yticks(range(len(labels)), labels, fontsize=8)
    ax.tick_params(length=0)
    ax.set_title("cosines between the changes: ±1 is one and the same", fontsize=9)
    return ax


def _window(image: np.ndarray) -> tuple[slice, slice]:
    peak = np.unravel_index(np.argmax(image), image.shape)
    rows, columns = (slice(max(0, int(p) - _HALF), int(p) + _HALF + 1) for p in peak)
    return rows, columns


_NEARLY = 0.02
"""Of a factor one, below which it is not written."""


_DIGITS = ".3g"
"""Of printed numbers."""

_COLUMNS = (
    Column("cause", kind=str),
    Column("size"),
    Column("error_alone", "if all other causes were known"),
    Column("error", "if no cause is known"),
    Column("unit", kind=str),
    Column("inflation", "of the coordinate's error, by not knowing the other causes"),
    Column("verdict", kind=str),
)


def verdicts(causes: Causes, target: float) -> list[str]:
    """Classify each cause by the frame alone: ``determined``, ``determined in part`` or ``undetermined``.

    Parameters
    ----------
    causes : Causes
    target : float
        Share of a cause's size, as :meth:`~jitterkit.forecast.causes.Causes.shares` has it, up to which it
        counts as determined.  With an error as large as the size it is undetermined.
    """
    return [
        "determined" if share <= target else "determined in part" if share < 1 else "undetermined"
        for share in causes.shares(causes.errors())
    ]


def causes_table(causes: Causes, target: float) -> QTable:
    """Tabulate the causes: size, error if all other causes are known and if none is, and the verdict."""
    alone, together = causes.information.alone, causes.errors()
    rows = [
        (cause.words, cause.size, cause.size_error(a), cause.size_error(t), cause.unit, t / a, verdict)
        for cause, a, t, verdict in zip(causes.causes, alone, together, verdicts(causes, target), strict=True)
    ]
    return bind_rows(_COLUMNS, rows, format=_DIGITS)


def data_table(causes: Causes, sets: Sequence[Observation]) -> QTable:
    """Tabulate the errors of every cause by observation, the frame alone first, and the worst as a share."""
    every = [causes.errors(), *(causes.errors(one.extra) for one in sets)]
    names = ["the frame alone", *(f"+ {one.words}" for one in sets)]
    columns: list[tuple[Column, Any]] = [(Column("data", kind=str), names)]
    for i, cause in enumerate(causes.causes):
        name = "defocus" if cause.name.startswith("noll4") else cause.name
        column = Column(name, f"error of {cause.words}", cause.unit)
        columns.append((column, [cause.size_error(errors[i]) for errors in every]))
    worst = Column("worst", "largest error, of the cause's size; of an absent one, of a pixel", "%")
    columns.append((worst, [100 * float(np.max(causes.shares(errors))) for errors in every]))
    return bind(columns, format=_DIGITS)


def causes_sentences(causes: Causes) -> list[str]:
    """Describe the degeneracies of one frame, and the sign of defocus."""
    found = [_describe_degeneracy(causes, one) for one in causes.degeneracies()]
    if not found:
        found = ["The causes look different enough: none is taken for another."]
    return found + _of_defocus(causes)


def remedy_sentence(causes: Causes, sets: Sequence[Observation], target: float) -> str:
    """Name the cheapest data that bring every cause below a target, as :meth:`Causes.shares` has it."""
    goal = _goal(causes, target)
    if np.all(causes.shares(causes.errors()) <= target):
        return f"The frame alone determines {goal}."
    best = cheapest(causes, sets, target)
    if best is None:
        return f"None of these data, nor any two of them, determine {goal}."
    return f"The cheapest data that determine {goal}: {best.words}."


def _goal(causes: Causes, target: float) -> str:
    """Describe the target: an absent cause has no share."""
    absent = [cause.words for cause in causes.causes if not cause.value]
    if not absent:
        return f"every cause to {100 * target:g} %"
    of_none = f"{listed(absent)}, of size 0, to a blur of {target:g} pixel"
    return f"every cause that has a size to {100 * target:g} %, and {of_none}"


def _describe_degeneracy(causes: Causes, one: Degeneracy) -> str:
    words = {cause.name: cause.words for cause in causes.causes}
    sign = 1 if one.weights[one.pivot] > 0 else -1
    weights = {words[name]: sign * one.weights[name] for name in (one.pivot, *one.others)}
    mixture = " ".join(_signed(weight, name) for name, weight in weights.items())
    if math.isfinite(one.stretch):
        strength = f"changes the image {number(one.stretch, 2)} times less than its parts would apart"
    else:
        strength = "leaves the image as it is, however much light there is"
    sums = [
        f"{_plus(words[one.pivot], ratio, words[name])} (to {number(1e6 * error, 2)} mas²)"
        for name, (ratio, error) in list(one.sums.items())[: None if math.isinf(one.stretch) else 1]
    ]
    known = f"; known is {listed(sums)}" if sums else ""
    return f"{_taken(weights)}: {mixture} {strength}{known}."


def _taken(weights: dict[str, float]) -> str:
    """Name the causes that are taken for each other, or that cancel each other."""
    up = [name for name, weight in weights.items() if weight > 0]
    down = [name for name, weight in weights.items() if weight < 0]
    verb = "is" if len(up) == 1 else "are"
    return f"{listed(up)} {verb} taken for {listed(down)}" if down else f"{listed(up)} undo each other"


def _signed(weight: float, name: str) -> str:
    return f"{'+' if weight > 0 else MINUS}{abs(weight):.2f} {name}"


def _plus(pivot: str, ratio: float, name: str) -> str:
    """Write the sum of a pivot and a multiple of another."""
    factor = "" if abs(abs(ratio) - 1) < _NEARLY else f"{number(abs(ratio), 2)} {TIMES} "
    return f"{pivot} {'+' if ratio > 0 else MINUS} {factor}{name}"


def _of_defocus(causes: Causes) -> list[str]:
    if "noll4" not in causes.setting.optics.nominal.names:
        return ["The optics have no defocus that may vary (noll4), so it is not among the causes."]
    if causes.setting.square:
        return ["About perfect focus the image depends on the square of defocus: its sign is undetermined."]
    return []
