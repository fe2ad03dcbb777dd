"""The picture of a run with time: separations about their mean, and the mean as it grows.

Reach for :func:`draw_run`, which also draws the means of a long run large enough to be read, or for
:func:`plot_separations` on axes of your own.

:func:`plot_running_mean` and :func:`plot_root_n_error` show the weighted mean of the first N frames;
both take ``ax=None`` and return the axes they drew on.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from astropy.table import QTable
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from jitterkit.report.means import Clock, Means, fitted, running_mean, stretch_means
from jitterkit.report.plots import (
    ABOVE,
    BLUE,
    INK,
    RUST,
    axes_or_new,
    finish,
    note_in_axes,
    panels,
    suited_angle,
)
from jitterkit.report.words import angle_size, number, suited_time

MANY = 300
"""Points beyond which error bars turn into a haze."""

_ROOMY = 80
"""Points up to which there is space for large ones."""

_STRETCHES, _EACH = 120, 25
"""Means of a long run: a bar every 8 pixels of a page, each of so many frames or more on average."""


def draw_run(
    table: QTable, summary: dict[str, Any], clock: Clock | None = None, outliers: np.ndarray | None = None
) -> list[Axes]:
    """Draw a run on a figure of its own: all frames, and of more than 300 their means once more, enlarged.

    Parameters
    ----------
    table : QTable
    summary : dict
        From :func:`~jitterkit.report.summary.summarise`.
    clock : Clock, optional
        Where the frames stand on the axis; by default their numbers.
    outliers : (n,) bool array, optional
        Rows that do not belong; hollow diamonds.

    Returns
    -------
    axes : list of matplotlib.axes.Axes
    """
    long = int(fitted(table).sum()) > MANY
    axes = panels((9.6, 5.6 if long else 3.4), 1 + long, 1, sharex=True)
    plot_separations(table, axes[0], summary, clock=clock, outliers=outliers)
    if long:
        axes[0].set_xlabel("")
        plot_separations(table, axes[1], summary, clock=clock, means_only=True)
    return axes


def plot_separations(
    table: QTable,
    ax: Axes | None = None,
    summary: dict[str, Any] | None = None,
    *,
    clock: Clock | None = None,
    outliers: np.ndarray | None = None,
    means_only: bool = False,
) -> Axes:
    """Draw every frame's separation with its error about their weighted mean.

    Parameters
    ----------
    table : QTable
        Results, in the order to draw.
    ax : matplotlib.axes.Axes, optional
    summary : dict, optional
        From :func:`~jitterkit.report.summary.summarise`, for the mean and its 1 sigma band.
    clock : Clock, optional
        Where the frames stand on the axis; by default their numbers.
    outliers : (n,) bool array, optional
        Rows that do not belong; hollow diamonds.
    means_only : bool
        Leave the frames and the failures out, so that the axis suits the means.

    Returns
    -------
    ax : matplotlib.axes.Axes
        Of more than 300 frames, faint points under weighted means of stretches, whose errors are widened
        where frames scatter more than theirs allow.  Frames that failed stand along the lower edge.
    """
    ax = axes_or_new(ax, (9.6, 3.4))
    clock = Clock(np.arange(len(table)) + 1.0, "frame", "") if clock is None else clock
    values, errors = (table[name].to_value("arcsec") for name in ("separation", "separation_err"))
    ok = (np.asarray(table["status"]) == "ok") & np.isfinite(values)
    good = fitted(table)
    centre, mean_error = _mean(summary, values[ok])
    at = shown_times(clock)
    if ok.any():
        many = int(good.sum()) > MANY
        stretches = min(_STRETCHES, int(good.sum()) // _EACH)
        means = stretch_means(at[good], values[good], errors[good], stretches) if many else None
        scale, unit = suited_angle(means.errors if means_only and means else _sizes(errors[ok]))
        if not means_only:
            _draw_frames(ax, at[ok], (values[ok] - centre) * scale, errors[ok] * scale)
        if outliers is not None and outliers.any():
            _draw_outliers(ax, at[outliers], (values[outliers] - centre) * scale)
        if means is not None:
            _draw_means(ax, means, centre, scale)
        _draw_mean(ax, mean_error, scale)
        ax.set_ylabel(f"separation − {number(centre, 7)}″ [{unit}]")
    else:
        note_in_axes(ax, "no frame was fitted").set_yticks([])
    if not (ok.all() or means_only):
        _draw_failures(ax, at[~ok])
    label_time(ax, clock)
    return finish(ax, ncols=5, **ABOVE)


def shown_times(clock: Clock) -> np.ndarray:
    """Return the positions of frames in the unit that suits their span."""
    return clock.at / suited_time(_span(clock), clock.unit)[0]


def label_time(ax: Axes, clock: Clock) -> None:
    """Say what runs along the lower axis, and let it hold every frame."""
    unit = suited_time(_span(clock), clock.unit)[1]
    at = shown_times(clock)
    low, high = (float(at.min()), float(at.max())) if len(at) else (1.0, 1.0)
    margin = max(0.6 if clock.unit == "frame" else 0.0, 0.01 * (high - low))
    ax.set(xlabel=f"time since {clock.start} UTC [{unit}]" if clock.start else "frame")
    ax.set_xlim(low - margin, high + margin)
    ax.xaxis.set_major_locator(MaxNLocator(9, integer=clock.unit == "frame", steps=[1, 2, 5, 10]))


def _span(clock: Clock) -> float:
    return float(np.ptp(clock.at)) if len(clock.at) else 0.0


def _sizes(errors: np.ndarray) -> np.ndarray:
    """Return the errors that are known; an arcsecond where none is."""
    finite = errors[np.isfinite(errors)]
    return finite if len(finite) else np.ones(1)


def _draw_frames(ax: Axes, at: np.ndarray, values: np.ndarray, errors: np.ndarray) -> None:
    """Points with bars; of many, points without, which would be a haze."""
    if len(at) <= MANY:
        style: Any = {"ms": 4.5 if len(at) <= _ROOMY else 3, "elinewidth": 0.9, "label": f"{len(at)} frames"}
        ax.errorbar(at, values, errors, fmt="o", color=BLUE, zorder=2, **style)
        return
    faint = max(0.04, min(0.5, 500 / len(at)))
    ax.plot(at, values, ".", color=BLUE, ms=3, mew=0, alpha=faint, zorder=2)
    ax.plot([], [], ".", color=BLUE, ms=5, label=f"{len(at):,} frames")


def _draw_outliers(ax: Axes, at: np.ndarray, values: np.ndarray) -> None:
    style: Any = {"ls": "", "marker": "D", "ms": 4, "mfc": "none", "mec": RUST, "mew": 0.9, "zorder": 3}
    ax.plot(at, values, **style, label=f"{len(at):,} do not belong")


def _draw_means(ax: Axes, means: Means, centre: float, scale: float) -> None:
    each = f"{number(float(np.median(means.counts)), 2)} frames"
    wider = f", errors × {means.widened:.2f}" if means.widened > 1 else ""
    style: Any = {"ms": 3.0, "elinewidth": 1.0, "label": f"means of {each}{wider}"}
    bars = means.errors * scale
    ax.errorbar(means.at, (means.values - centre) * scale, bars, fmt="o", color=INK, zorder=3, **style)


def _draw_mean(ax: Axes, mean_error: float, scale: float) -> None:
    if math.isfinite(mean_error):
        band = mean_error * scale
        ax.axhspan(-band, band, color=RUST, alpha=0.22, lw=0, zorder=1)
        ax.axhline(0, color=RUST, lw=1.2, zorder=4, label=f"weighted mean ± {angle_size(mean_error, 2)}")


def _draw_failures(ax: Axes, at: np.ndarray) -> None:
    many = len(at) > MANY
    style: Any = {"marker": "|", "ms": 4, "mew": 0.3} if many else {"marker": "x", "ms": 5, "mew": 1.2}
    style |= {"color": INK, "ls": "", "clip_on": False, "zorder": 4, "label": f"{len(at):,} failed"}
    ax.plot(at, np.full(len(at), 0.03), transform=ax.get_xaxis_transform(), **style)


def _mean(summary: dict[str, Any] | None, values: np.ndarray) -> tuple[float, float]:
    """Return the weighted mean and its error; the median without an error where there is no summary."""
    if summary is not None and math.isfinite(summary["separation"]["mean"]):
        return summary["separation"]["mean"], summary["separation"]["error"]
    return (float(np.median(values)) if len(values) else 0.0), math.nan


_SIZE = (5.2, 3.6)
_POINTS = 400
"""Of a curve over N, evenly on a logarithmic axis."""

_TELLING = 8
"""Frames from which a scatter is known to a quarter, 1/sqrt(2 (n - 1))."""

_SHOWN, _HELD = 1000, 100
"""The axis begins with a thousandth of the frames and holds the means from a hundredth on: those of the first
few would press the rest flat."""


def plot_running_mean(values: np.ndarray, errors: np.ndarray, ax: Axes | None = None) -> Axes:
    """Draw the weighted mean of the first N frames, less that of all, within its stated error.

    Parameters
    ----------
    values, errors : (n,) arrays
        Separations that count, in the order of time; arcsec.
    ax : matplotlib.axes.Axes, optional

    Returns
    -------
    ax : matplotlib.axes.Axes
        Tall enough for the last two decades.
    """
    ax = axes_or_new(ax, _SIZE)
    n, running = _thinned(values, errors)
    centre = running["mean"][-1]
    held = n >= max(len(values) / _HELD, min(_TELLING, len(values) / 2))
    scale, unit = suited_angle(running["error"][held])
    y, bar = (running["mean"] - centre) * scale, running["error"] * scale
    ax.fill_between(n, y - bar, y + bar, color=BLUE, alpha=0.25, lw=0, label="its stated error, 1σ")
    ax.plot(n, y, color=BLUE, lw=1.4, label="mean of the first N frames")
    ax.axhline(0, color=RUST, lw=1.2)
    reach = 1.6 * float(np.max((np.abs(y) + bar)[held]))
    first = max(1.0, len(values) / _SHOWN)
    ax.set(xscale="log", xlabel="frames N", xlim=(first, 1.1 * len(values)), ylim=(-reach, reach))
    ax.set_ylabel(f"mean − {number(float(centre), 7)}″ [{unit}]")
    return finish(ax, loc="upper right")


def plot_root_n_error(values: np.ndarray, errors: np.ndarray, ax: Axes | None = None) -> Axes:
    """Draw the error of the weighted mean of the first N frames with what 1/sqrt(N) makes of one frame's.

    Returns
    -------
    ax : matplotlib.axes.Axes
        The error by the stated errors and, from eight frames on, by the scatter.  They part where errors
        are wrong, or where what frames have in common does not average.
    """
    ax = axes_or_new(ax, _SIZE)
    n, running = _thinned(values, errors)
    scale, unit = suited_angle(running["error"])
    line = float(np.median(errors)) * scale / np.sqrt(n)
    ax.plot(n, line, color=INK, ls="--", lw=1.2, label="a typical frame's error/√N")
    ax.plot(n, running["error"] * scale, color=BLUE, lw=2.0, alpha=0.8, label="stated error of the mean")
    known = n >= _TELLING
    by_scatter = running["error_by_scatter"][known] * scale
    ax.plot(n[known], by_scatter, color=RUST, lw=1.2, label="error to judge by the scatter")
    ax.set(xscale="log", yscale="log", xlabel="frames N", ylabel=f"error of the mean [{unit}]")
    return finish(ax, loc="lower left")


def _thinned(values: np.ndarray, errors: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Numbers of frames, few enough for a curve, and the running mean at them."""
    n = np.unique(np.rint(np.geomspace(1, len(values), _POINTS)).astype(int))
    return n, {name: column[n - 1] for name, column in running_mean(values, errors).items()}
