"""The picture of the jitter with time: reach for :func:`draw_jitter`.

Ellipses stand along the axis of :mod:`~jitterkit.report.time_plots`, above their axes and direction.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from astropy.table import QTable
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection

from jitterkit.report.means import Clock, stretch_index
from jitterkit.report.plots import ABOVE, BLUE, INK, RUST, finish, panels, suited_angle
from jitterkit.report.time_plots import MANY, label_time, shown_times
from jitterkit.report.words import angle_size

_ELLIPSES, _WIDEST = 24, 0.04
"""Ellipses along the axis at most, and the largest one's diameter as a share of the axis."""

_SPANS = 100
_INNER = (16, 84)
"""Percentiles between which two frames of three lie."""

_LONG = 1.2
"""Ratio of the axes above which a frame's ellipse points anywhere."""


def jittered(table: QTable) -> np.ndarray:
    """Return which frames of a table have an ellipse that counts, (n,) bool."""
    return (np.asarray(table["status"]) == "ok") & np.isfinite(np.asarray(table["jitter_major"]))


def draw_jitter(table: QTable, clock: Clock) -> list[Axes]:
    """Draw how size, shape and direction of the jitter change over a run.

    Parameters
    ----------
    table : QTable
        With a frame at least that :func:`jittered` counts.
    clock : Clock

    Returns
    -------
    axes : list of matplotlib.axes.Axes
        Ellipses of the mean second moments of stretches, to one scale; major and minor axis of frames (of
        more than 300 the medians of stretches, within bands that hold two thirds); direction of frames
        that have one, with that of the mean moments.
    """
    axes = panels((9.6, 5.6), 3, 1, sharex=True, height_ratios=(0.4, 1.5, 1.5))
    good = jittered(table)
    at = shown_times(clock)[good]
    moments = np.array([table[name].to_value("arcsec2")[good] for name in ("sxx", "sxy", "syy")])
    major, minor = (table[f"jitter_{axis}"].to_value("arcsec")[good] for axis in ("major", "minor"))
    _draw_ellipses(axes[0], at, moments)
    _draw_sizes(axes[1], at, major, minor)
    _draw_angles(axes[2], at, table["jitter_angle"].to_value("deg")[good], major, minor, moments)
    label_time(axes[2], clock)
    for ax in axes:
        finish(ax, ncols=4, **ABOVE)
    return axes


def _draw_ellipses(ax: Axes, at: np.ndarray, moments: np.ndarray) -> None:
    few = len(at) <= _ELLIPSES
    where, ellipses = _mean_ellipses(at, moments, np.arange(len(at)) if few else stretch_index(at, _ELLIPSES))
    major, minor, angle = ellipses.T
    largest = max(float(major.max()), np.finfo(float).tiny)
    size = min(_WIDEST, 0.95 / len(where)) / largest
    thin = 0.04 * largest  # a streak without width is a line that can be seen
    drawn: Any = EllipseCollection(
        size * major, size * np.maximum(minor, thin), angle, units="width",
        offsets=np.column_stack([where, np.zeros(len(where))]), offset_transform=ax.transData,
        facecolor=BLUE, edgecolor="none", alpha=0.85, clip_on=False,
    )  # fmt: skip
    ax.add_collection(drawn)
    which = "ellipse of each frame" if few else "mean ellipses"
    ax.set(ylim=(-1, 1), yticks=[])
    ax.set_title(f"{which}; the largest has a major axis of {angle_size(largest)}, 1σ")
    ax.title.set_fontsize(9)
    ax.spines["left"].set_visible(False)
    ax.tick_params(axis="x", length=0)


def _mean_ellipses(at: np.ndarray, moments: np.ndarray, index: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean times, and ``(major, minor, angle)`` of the mean second moments, of stretches with frames."""
    from jitterkit.loci.base import principal_axes  # JAX: only here, so that a table alone needs none

    n, times, *sums = (np.bincount(index, x) for x in (np.ones(len(at)), at, *moments))
    there = n > 0
    means = np.array(sums)[:, there] / n[there]
    return times[there] / n[there], np.array([principal_axes(one) for one in means.T])


def _draw_sizes(ax: Axes, at: np.ndarray, major: np.ndarray, minor: np.ndarray) -> None:
    positive = major[major > 0]
    scale, unit = suited_angle(positive if len(positive) else np.ones(1))
    for values, colour, name in ((major, BLUE, "major"), (minor, RUST, "minor")):
        if len(at) <= MANY:
            ax.plot(at, values * scale, "o", color=colour, ms=4, mew=0, alpha=0.8, label=f"{name} axis")
            continue
        times, (low, middle, high) = _percentiles(at, values * scale)
        ax.fill_between(times, low, high, color=colour, alpha=0.2, lw=0, step="mid")
        text = f"{name} axis: median, and two frames in three"
        ax.plot(times, middle, color=colour, lw=1.4, drawstyle="steps-mid", label=text)
    ax.set_ylim(bottom=min(0.0, ax.get_ylim()[0]) if positive.size == 0 else 0.0)
    ax.set_ylabel(f"jitter, 1σ [{unit}]")


def _percentiles(at: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Middles of stretches, and percentiles of the frames in them, (3, m); NaN where there are none."""
    count = min(_SPANS, len(at) // 8)
    index = stretch_index(at, count)
    order = np.argsort(index, kind="stable")
    groups = np.split(order, np.cumsum(np.bincount(index, minlength=count))[:-1])
    low, high = _INNER
    held = [np.percentile(values[g], (low, 50, high)) if len(g) else np.full(3, np.nan) for g in groups]
    return at.min() + (np.arange(count) + 0.5) * float(np.ptp(at)) / count, np.array(held).T


def _draw_angles(
    ax: Axes, at: np.ndarray, angle: np.ndarray, major: np.ndarray, minor: np.ndarray, moments: np.ndarray
) -> None:
    pointed = np.isfinite(angle) & (major > _LONG * minor)
    few = len(at) <= MANY
    faint = 0.8 if few else max(0.05, min(0.5, 600 / max(int(pointed.sum()), 1)))
    ax.plot(at[pointed], angle[pointed], ".", color=BLUE, ms=8 if few else 3, mew=0, alpha=faint)
    ax.plot([], [], ".", color=BLUE, ms=6, label=f"{pointed.sum():,} frames with axes over {_LONG}:1")
    if not few:
        times, ellipses = _mean_ellipses(at, moments, stretch_index(at, _SPANS))
        ax.plot(times, ellipses[:, 2], "o", color=INK, ms=2.6, mew=0, label="of the mean second moments")
    ax.set(ylim=(0, 180), yticks=[0, 45, 90, 135, 180], ylabel="major axis from +x [°]")
