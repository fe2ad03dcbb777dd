"""Pictures of forecasts: errors against the size of the jitter, and how much of it may be.

As in :mod:`~jitterkit.report.plots`, every function that draws on one pair of axes takes ``ax=None`` and
returns them.  Curves are distinguished by the shade of one colour map, from dark to light, and by a word at
their ends, so that they can be distinguished in grey too.

:func:`plot_matrices` draws Fisher information and covariance, whose elements span decades and have signs;
:func:`plot_matrix` draws any symmetric matrix of named parameters.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import SymLogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter
from scipy.optimize import isotonic_regression

from jitterkit.forecast import Forecast, Requirement, Sweep
from jitterkit.report.columns import unit_of
from jitterkit.report.forecast_table import observing_time
from jitterkit.report.plots import INK, RUST, axes_or_new, colour_bar, finish
from jitterkit.report.words import MINUS

_PLAIN = FuncFormatter(lambda value, _: f"{value:g}" if f"{value:e}"[0] in "1235" else "")
"""Ticks of a logarithmic axis that spans a decade or two."""

_LABEL = 0.046
"""Height of a curve's label, of that of axes of two inches, the lowest here."""

_FEW = 10
"""Points of a curve up to which they are marked."""


def curve_colours(count: int) -> list[Any]:
    """So many shades, dark to light, that differ in grey too."""
    return [matplotlib.colormaps["viridis"](at) for at in np.linspace(0.0, 0.85, max(count, 2))[:count]]


def plot_errors(
    sweep: Sweep,
    ax: Axes | None = None,
    *,
    still: float | None = None,
    plate_scale: float | None = None,
    exposure: float | None = None,
    target: float = 1e-6,
    marks: dict[str, float] | None = None,
    limits: tuple[float, float] | None = None,
    title: str = "",
) -> Axes:
    """Draw the error of the separation against the first setting of a sweep, a curve for each of the second.

    Parameters
    ----------
    sweep : Sweep
        Of one or two settings.
    ax : matplotlib.axes.Axes, optional
    still : float, optional
        Error without jitter [arcsec], a dashed line.
    plate_scale : float, optional
        arcsec/pixel; then an upper axis counts pixels, where the setting is an angle on the sky.
    exposure : float, optional
        s; then an axis on the right says how long the target takes.
    target : float
        Error of the mean to reach, arcsec.
    marks : dict of label to value, optional
        Vertical lines.
    limits : (float, float), optional
        Of the errors shown, µas.
    title : str
    """
    ax = axes_or_new(ax, (5.6, 4.2))
    names = list(sweep.axes)
    along: np.ndarray = sweep.axes[names[0]]
    unit = unit_of(names[0])
    error = 1e6 * sweep.error().reshape(len(along), -1)
    others = sweep.axes[names[1]] if len(names) > 1 else np.array([math.nan])
    colours = curve_colours(len(others))
    for column, colour in zip(error.T, colours, strict=True):
        ax.plot(along, column, color=colour, lw=1.5, marker="o" if len(along) < _FEW else "", ms=3)
    if logarithmic := _in_equal_ratios(along):
        ax.loglog()
        ax.set_xlim(right=along[-1] * (along[-1] / along[0]) ** 0.08)
    elif len(along) > 1:
        ax.set_xlim(right=along[-1] + 0.08 * (along[-1] - along[0]))
    if still is not None:
        ax.axhline(1e6 * still, color=INK, ls="--", lw=1)
        middle = (along[0] + along[-1]) / 2
        ax.annotate("no jitter", (middle, 1e6 * still), xytext=(0, -11), textcoords="offset points",
                    ha="center", fontsize=8, color=INK)  # fmt: skip
        ax.margins(y=0.08)
    if limits is not None:
        ax.set_ylim(limits)
    if len(names) > 1:
        sign = "°" if unit_of(names[1]) == "deg" else ""
        to, back = (np.log, np.exp) if logarithmic else (np.asarray, np.asarray)
        positions = back(spread(to(error[-1]), _LABEL * float(np.ptp(to(ax.get_ylim())))))
        for position, value, colour in zip(positions, others, colours, strict=True):
            ax.annotate(f" {value:.3g}{sign}", (along[-1], position), color=colour, fontsize=7, va="center")
    for label, value in (marks or {}).items():
        ax.axvline(value, color=RUST, lw=1, ls=":")
        ax.annotate(label, (value, 0.98), xycoords=("data", "axes fraction"), rotation=90, va="top",
                    ha="right", fontsize=8, color=RUST)  # fmt: skip
    ax.set(xlabel=f"{names[0]} [{unit}]" if unit else names[0], ylabel="error of separation, one frame [µas]")
    finish(ax).set_title(title)
    if plate_scale is not None and unit == "arcsec":
        ax.secondary_xaxis("top", functions=_pixels(plate_scale)).set_xlabel("[pixel]")
    if exposure is not None:
        _add_time(ax, target, exposure)
    return ax


def _in_equal_ratios(values: np.ndarray) -> bool:
    """Return whether values were asked for in equal ratios, three or more, and not in equal steps."""
    if len(values) < 3 or values.min() <= 0:
        return False
    ratios, steps = np.diff(np.log(values)), np.diff(values)
    return bool(np.ptp(ratios) < 1e-6 * abs(ratios[0]) and np.ptp(steps) > 1e-6 * abs(steps[0]))


def spread(values, gap: float) -> np.ndarray:
    """Places (n,) as near to values as they can be that lie a gap apart, in the order of the values.

    >>> spread([5.0, 1.0, 1.0], 1.0)
    array([5. , 0.5, 1.5])
    """
    values = np.asarray(values, float)
    order = np.argsort(values, kind="stable")
    steps = gap * np.arange(len(values))
    positions = np.empty(len(values))
    positions[order] = isotonic_regression(values[order] - steps).x + steps
    return positions


def _pixels(plate_scale: float):
    """Convert arcsec to pixels, and back."""
    return lambda size: np.asarray(size) / plate_scale, lambda count: np.asarray(count) * plate_scale


def _add_time(ax: Axes, target: float, exposure: float) -> None:
    """An axis on the right: hours to the target, beside the error of one frame."""

    def hours(microarcsec):
        return observing_time(1e-6 * np.maximum(microarcsec, 0), target, exposure)

    def back(time):
        return 1e6 * target * np.sqrt(np.maximum(time, 0.0) * 3600 / exposure)

    ax.secondary_yaxis("right", functions=(hours, back)).set_ylabel(f"time to {1e6 * target:g} µas [h]")


def plot_requirements(
    requirements: Sequence[Requirement],
    ax: Axes | None = None,
    *,
    exposure: float | None = None,
    title: str = "",
) -> Axes:
    """Draw the largest vibration against its frequency, a curve for each angle from the pair.

    Parameters
    ----------
    requirements : sequence of Requirement
        Those of vibrations are drawn.
    ax : matplotlib.axes.Axes, optional
    exposure : float, optional
        s; without it the axis counts cycles an exposure.
    title : str
    """
    ax = axes_or_new(ax, (5.6, 4.2))
    every = [one for one in requirements if one.motion == "vibration"]
    angles = sorted({one.angle for one in every})
    for angle, colour, marker in zip(angles, curve_colours(len(angles)), "osD^v<>", strict=False):
        mine = [one for one in every if one.angle == angle]
        x = np.array([one.cycles for one in mine]) / (exposure or 1.0)
        ax.loglog(x, [one.size for one in mine], color=colour, marker=marker, ms=4, label=f"{angle:g}°")
    for cycles, regime in ((0.2, "low"), (3.0, "high")):
        ax.axvline(cycles / (exposure or 1.0), color=INK, lw=0.8, ls=":")
        side = -1 if regime == "low" else 1
        ax.annotate(f"{regime} frequency", (cycles / (exposure or 1.0), 0.02),
                    xycoords=("data", "axes fraction"), fontsize=8, ha="right" if side < 0 else "left",
                    xytext=(4 * side, 0), textcoords="offset points")  # fmt: skip
    ax.set_xlabel("frequency [Hz]" if exposure else "cycles an exposure")
    ax.set(ylabel="largest peak to peak [arcsec]", title=title)
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_formatter(_PLAIN)
        axis.set_minor_formatter(_PLAIN)
    ax.tick_params(which="minor", labelsize=8)
    x = np.array([one.cycles for one in every]) / (exposure or 1.0)
    ax.set_xlim(x.min() * 0.7, x.max() * 3)
    return finish(ax, title="from the pair")


_SHORT = {"separation": "sep", "contrast": "cont", "background": "bg"}


def plot_matrices(forecast: Forecast) -> Figure:
    """Draw the Fisher matrix and the covariance beside each other, in the parameters' own units."""
    figure = Figure(figsize=(11.2, 5.0), layout="constrained")
    left, right = figure.subplots(1, 2)
    plot_matrix(forecast.information, forecast.names, left, title="Fisher information")
    plot_matrix(forecast.covariance, forecast.names, right, title="covariance (Cramér-Rao bound)")
    return figure


def plot_matrix(matrix, names: Sequence[str], ax: Axes | None = None, *, title: str = "") -> Axes:
    """Draw a symmetric matrix whose elements span decades, with signs.

    Parameters
    ----------
    matrix : (p, p) array
        Its elements have the units of their row and column, or the inverse.
    names : sequence of str
    ax : matplotlib.axes.Axes, optional
    title : str
    """
    ax = axes_or_new(ax, (5.4, 4.8))
    matrix = np.asarray(matrix)
    largest = float(np.abs(matrix).max())
    least = float(np.abs(np.diag(matrix)).min())
    norm = SymLogNorm(linthresh=least * 1e-3, vmin=-largest, vmax=largest)
    picture = ax.imshow(matrix, cmap="RdBu_r", norm=norm)
    for row, column in zip(*np.nonzero(matrix < 0), strict=True):  # print in grey has no signs
        ax.text(column, row, MINUS, ha="center", va="center", fontsize=7, color=INK)
    labels = [_SHORT.get(name, name) for name in names]
    ax.set_xticks(range(len(labels)), labels, rotation=90)
    ax.set_yticks(range(len(labels)), labels)
    ax.tick_params(length=0)
    ax.set_title(title)
    low, high = math.ceil(math.log10(least * 1e-3)), math.floor(math.log10(largest))
    powers = 10.0 ** np.arange(high, low, -max(1, (high - low) // 3))
    colour_bar(picture, ax, "own units of row and column")
    bar = picture.colorbar
    assert bar is not None
    bar.set_ticks([*-powers, 0.0, *powers[::-1]])
    bar.minorticks_off()
    return ax
