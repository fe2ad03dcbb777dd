"""Pictures of a series: what it did, and what in it does not belong.

Reach for :func:`plot_averaging`, a page of these and of :mod:`~jitterkit.report.averaging_plots`.  As in
:mod:`~jitterkit.report.plots`, the others take ``ax=None`` and return the axes they drew on.  Values are
separations in arcsec; times are seconds where nothing else is said.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jitterkit.report.averaging_plots import plot_allan, plot_root_n, suited_angle, suited_time
from jitterkit.report.axes import BLUE, INK, RUST, axes_or_new, finish
from jitterkit.report.means import stretch_means
from jitterkit.report.words import number, with_error
from jitterkit.series import (
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
    figure = Figure(figsize=(10.4, 7.2), layout="constrained")
    axes = list(figure.subplots(2, 2).ravel())
    outliers, rest, floor, trend = study_series(series, floor)
    plot_series(series, axes[0], trend=trend, outliers=outliers)
    plot_pulls(outliers, axes[1])
    plot_root_n(block_scatter(rest), axes[2])
    plot_allan(allan_deviation(rest), axes[3], floor=floor)
    return axes


def plot_series(
    series: Series,
    ax: Axes | None = None,
    *,
    trend: Trend | None = None,
    outliers: Outliers | None = None,
    zoom: bool = False,
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
    zoom : bool
        Let the axis hold the means of many points rather than the points.

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
        reach = _draw_means(ax, series, trend, to_axes, scale)
        if zoom:
            ax.set_ylim(*reach)
    if outliers is not None and (flags := outliers.flags).any():
        at = to_axes(series.times[flags], series.values[flags])
        ax.plot(*at, **_DIAMOND, zorder=5, label=f"{flags.sum()} do not belong")
    x, curve = to_axes(grid := np.linspace(start, float(t.max()), 200), trend.at(grid))
    band = trend.error_at(grid) * scale
    ax.fill_between(x, curve - band, curve + band, color=RUST, alpha=0.25, lw=0, zorder=2)
    ax.plot(x, curve, color=RUST, lw=1.6, zorder=4, label=_trend_in_words(trend, scale, angle, per, unit))
    ax.set(xlabel=f"time [{unit}]", ylabel=f"separation − {number(level, 7)}″ [{angle}]")
    return finish(ax)


def _draw_means(ax: Axes, series: Series, trend: Trend, to_axes: Any, scale: float) -> tuple[float, float]:
    """Faint points under means of stretches of time; the range that holds the means and the trend."""
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
    low, high = np.min(heights - 2 * bars * scale), np.max(heights + 2 * bars * scale)
    return float(low), float(high)


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
