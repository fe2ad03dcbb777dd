"""Pictures of a series: what it did, what in it does not belong, and how far its averages can be trusted.

Reach for :func:`plot_averaging`, a page of these; for :func:`plot_allan`, and for :func:`plot_root_n` to see
block means as they are.  As in :mod:`~jitterkit.report.plots`, all but the page take ``ax=None`` and return
the axes they drew on.  Values are separations in arcsec; times are seconds where nothing else is said.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from jitterkit.report.means import stretch_means
from jitterkit.report.plots import BLUE, INK, RUST, axes_or_new, finish, panels, suited_angle
from jitterkit.report.words import angle_size, angle_unit, number, suited_time, with_error
from jitterkit.series import (
    AllanDeviation,
    BlockScatter,
    Floor,
    Outliers,
    Series,
    Trend,
    allan_deviation,
    block_scatter,
    find_outliers,
    fit_floor,
    fit_trend,
)

_SIZE = (5.2, 3.6)
_MANY, _BLOCKS = 300, 40
"""Points beyond which error bars turn into a haze, and how many means replace them."""

_FEWEST, _BINS = 24, 80
"""Bars of a histogram."""

_DIAMOND: Any = {"ls": "", "marker": "D", "ms": 6, "mfc": "none", "mec": RUST, "mew": 1.3}
"""Of an outlier."""

_LEAST = 0.4
"""Lower end of a histogram's logarithmic axis: below one count, which must show."""


def study_series(series: Series, floor: Floor | None = None) -> tuple[Outliers, Series, Floor, Trend]:
    """Return the outliers of a series, the series without them, and its floor and trend.

    The trend's error counts a floor that was detected; ``floor`` is one that was fitted before.
    """
    outliers = find_outliers(series)
    rest = series.without(outliers.flags)
    floor = fit_floor(rest) if floor is None else floor
    return outliers, rest, floor, fit_trend(rest, noise=floor if floor.detected else None)


def plot_averaging(series: Series, *, floor: Floor | None = None) -> list[Axes]:
    """Draw a page on a series: itself, its pulls, and how its means fall, twice.

    Parameters
    ----------
    series : Series
        Of 16 measurements or more.
        Times in s.
    floor : Floor, optional
        As found; by default that of the measurements that belong.

    Returns
    -------
    axes : list of matplotlib.axes.Axes
        Series, pulls, scatter of block means, Allan deviation; the lower two without the outliers.
    """
    axes = panels((10.4, 7.2), 2, 2)
    outliers, rest, floor, trend = study_series(series, floor)
    plot_series(series, axes[0], trend=trend, outliers=outliers)
    plot_pulls(outliers, axes[1])
    plot_root_n(block_scatter(rest), axes[2])
    plot_allan(allan_deviation(rest), axes[3], floor=floor)
    return axes


def plot_series(
    series: Series, ax: Axes | None = None, *, trend: Trend | None = None, outliers: Outliers | None = None
) -> Axes:
    """Draw a series with time.

    Parameters
    ----------
    series : Series
        Times in s, which are given in a suitable unit.
    ax : matplotlib.axes.Axes, optional
    trend : Trend, optional
        Drawn with its 1 sigma band; without it the weighted mean.
    outliers : Outliers, optional
        Their flags; hollow diamonds.

    Returns
    -------
    ax : matplotlib.axes.Axes
        Points with error bars; of more than 300, faint points under the means of forty stretches of time.
    """
    ax = axes_or_new(ax, (9.6, 3.4))
    y, e, t = series.present
    trend = fit_trend(series, 0) if trend is None else trend
    start = float(t.min())
    per, unit = suited_time(float(np.ptp(t)), "s")
    scale, angle = suited_angle(e if series.stated else np.abs(y - np.median(y)))
    level = trend.mean

    def to_axes(times: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return (times - start) / per, (values - level) * scale

    if len(y) <= _MANY:
        bars = e * scale if series.stated else None
        ax.errorbar(*to_axes(t, y), bars, fmt="o", color=BLUE, ms=4, elinewidth=0.9, label=f"{len(y)} frames")
    else:
        _draw_means(ax, series, trend, to_axes, scale)
    if outliers is not None and (flags := outliers.flags).any():
        at = to_axes(series.times[flags], series.values[flags])
        ax.plot(*at, **_DIAMOND, zorder=5, label=f"{flags.sum()} do not belong")
    x, curve = to_axes(grid := np.linspace(start, float(t.max()), 200), trend.at(grid))
    band = trend.error_at(grid) * scale
    ax.fill_between(x, curve - band, curve + band, color=RUST, alpha=0.25, lw=0, zorder=2)
    ax.plot(x, curve, color=RUST, lw=1.6, zorder=4, label=_trend_in_words(trend, scale, angle, per, unit))
    ax.set(xlabel=f"time [{unit}]", ylabel=f"separation − {number(level, 7)}″ [{angle}]")
    return finish(ax)


def _draw_means(ax: Axes, series: Series, trend: Trend, to_axes: Any, scale: float) -> None:
    """Draw faint points under means of stretches of time."""
    y, e, t = series.present
    faint = max(0.05, min(0.5, 1500 / len(y)))
    ax.plot(*to_axes(t, y), ".", color=BLUE, ms=2.5, mew=0, alpha=faint, zorder=1, rasterized=True)
    means = stretch_means(t, y, e, _BLOCKS)
    bars = means.errors / means.widened
    if not series.stated:
        bars = bars * float(np.std(y - trend.at(t)))
    x, heights = to_axes(means.at, means.values)
    label = f"{len(y):,} frames, {len(means.at)} means"
    ax.errorbar(x, heights, bars * scale, fmt="o", color=INK, ms=3.5, elinewidth=1.1, zorder=3, label=label)


def _trend_in_words(trend: Trend, scale: float, angle: str, per: float, unit: str) -> str:
    if not math.isfinite(trend.slope):
        return f"weighted mean ± {number(trend.mean_error * scale, 2)} {angle}"
    return f"trend, {with_error(trend.slope * scale * per, trend.slope_error * scale * per)} {angle}/{unit}"


def plot_pulls(outliers: Outliers, ax: Axes | None = None) -> Axes:
    """Draw how residuals about the trend are distributed in stated errors, with the normal laws.

    Returns
    -------
    ax : matplotlib.axes.Axes
        Counts on a logarithmic axis, so that a single frame shows; diamonds are those that do not belong,
        verticals the limit.
    """
    ax = axes_or_new(ax, _SIZE)
    scale, stated = (outliers.scale, True) if math.isfinite(outliers.scale) else (1.0, False)
    pulls = outliers.pulls[np.isfinite(outliers.pulls)] * scale
    reach = 1.05 * max(float(np.abs(pulls).max()), 1.2 * outliers.limit * scale)
    edges = np.linspace(-reach, reach, int(np.clip(3 * math.sqrt(len(pulls)), _FEWEST, _BINS)) + 1)
    ax.hist(pulls, edges.tolist(), color=BLUE, alpha=0.45, lw=0, label=f"{len(pulls):,} frames")
    x = np.linspace(-reach, reach, 400)
    per_sigma = len(pulls) * (edges[1] - edges[0]) / math.sqrt(2 * math.pi)
    if stated:
        ax.plot(x, per_sigma * np.exp(-(x**2) / 2), color=INK, ls="--", lw=1.2, label="stated errors")
    law = per_sigma / scale * np.exp(-((x / scale) ** 2) / 2)
    ax.plot(x, law, color=RUST, lw=1.6, label=f"times {scale:.3f}" if stated else "normal law")
    bad = outliers.pulls[outliers.flags] * scale
    if len(bad):
        ax.plot(bad, np.full(len(bad), 1.5 * _LEAST), **_DIAMOND, label=f"{len(bad)} do not belong")
    for side in (-1, 1):
        ax.axvline(side * outliers.limit * scale, color=INK, lw=0.8, ls=":")
    over = "stated error" if stated else "scatter"
    ax.set(yscale="log", xlim=(-reach, reach), xlabel=f"residual / {over}", ylabel="frames")
    ax.set_ylim(_LEAST, 3 * max(per_sigma / min(scale, 1.0), 1.0))
    return finish(ax)


def plot_root_n(scatter: BlockScatter, ax: Axes | None = None, *, time_unit: str = "s") -> Axes:
    """Draw the scatter of block means against their length, with error/sqrt(n) where errors are stated."""
    ax = axes_or_new(ax, _SIZE)
    scale, angle = suited_angle(scatter.scatter)
    y, bars = scatter.scatter * scale, scatter.error * scale
    low = np.minimum(bars, 0.9 * y)  # a bar to zero has no end on a logarithmic axis
    n = scatter.lengths
    ax.errorbar(n, y, [low, bars], fmt="o", color=BLUE, ms=4, elinewidth=1.0, label="of block means")
    if np.isfinite(scatter.expected).all():
        ax.plot(n, scatter.expected * scale, color=INK, ls="--", lw=1.2, label="errors/√n", zorder=1)
    ax.loglog()
    ax.set(xlabel=f"{_steps(scatter, time_unit)} in a block", ylabel=f"scatter [{angle}]")
    return finish(ax)


def plot_allan(
    allan: AllanDeviation, ax: Axes | None = None, *, floor: Floor | None = None, time_unit: str = "s"
) -> Axes:
    """Draw an Allan deviation with its confidence band, and the noise that was fitted to the series.

    Parameters
    ----------
    allan : AllanDeviation
    ax : matplotlib.axes.Axes, optional
    floor : Floor, optional
        The curve; a floor that was detected is a dotted line, with a ring where the white noise meets it,
        and one that was not an upper limit.
    time_unit : str
        Of the times.

    Returns
    -------
    ax : matplotlib.axes.Axes
        Steps of the cadence below, time above.
    """
    ax = axes_or_new(ax, _SIZE)
    scale, angle = suited_angle(allan.deviation)
    n = allan.lengths
    ax.fill_between(n, allan.low * scale, allan.high * scale, color=BLUE, alpha=0.25, lw=0)
    ax.plot(n, allan.deviation * scale, "o-", color=BLUE, ms=3, lw=1.0, label="Allan deviation, 1σ")
    if np.isfinite(allan.expected).all():
        ax.plot(n, allan.expected * scale, color=INK, ls="--", lw=1.2, label="errors/√n")
    if floor is not None:
        ax.plot(n, floor.deviation(n) * scale, color=RUST, lw=1.8, label="fitted noise")
        _draw_floor(ax, floor, scale, time_unit)
    ax.loglog()
    ax.set(xlabel=f"{_steps(allan, time_unit)} averaged", ylabel=f"Allan deviation [{angle}]")
    per, unit = suited_time(float(allan.times[-1]), time_unit)
    if unit != "frame":
        per_frame = float(allan.times[0] / n[0]) / per
        there_and_back: Any = (lambda x: x * per_frame, lambda x: x / per_frame)
        above = ax.secondary_xaxis("top", functions=there_and_back)
        above.set_xlabel(f"time averaged [{unit}]")
    return finish(ax, loc="lower left")


def _draw_floor(ax: Axes, floor: Floor, scale: float, time_unit: str) -> None:
    if not (floor.detected and floor.floor > 0):
        label = f"floor below {angle_size(floor.upper, 2)} (95 %)"
        ax.axhline(floor.upper * scale, color=RUST, ls=":", lw=1.4, label=label)
        return
    factor, unit = angle_unit(floor.floor)
    label = f"floor {with_error(floor.floor * factor, floor.error * factor)}{unit}"
    ax.axhline(floor.floor * scale, color=RUST, ls=":", lw=1.4, label=label)
    if floor.meets < 1:
        return
    per, unit = suited_time(floor.meets * floor.cadence, time_unit)
    time = number(floor.meets * floor.cadence / per, 2)
    steps = "frames" if unit == "frame" else f"steps, {time} {unit}"
    style: Any = {"ls": "", "marker": "o", "ms": 9, "mfc": "none", "mec": INK, "mew": 1.4, "zorder": 5}
    ax.plot(floor.meets, floor.floor * scale, **style, label=f"met at {number(floor.meets, 2)} {steps}")


def _steps(means: AllanDeviation | BlockScatter, time_unit: str) -> str:
    """Return what lengths are counted in."""
    if time_unit == "frame":
        return "frames"
    step = float(means.times[0] / means.lengths[0])
    per, unit = suited_time(step, time_unit)
    return f"steps of {number(step / per, 3)} {unit}"
