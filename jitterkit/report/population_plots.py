"""Histograms of a run's frames: how large, which way, of which kind and how well fitted.

Each function takes what it draws as plain arrays and ``ax=None``, and returns the axes.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from scipy.stats import chi2 as chi_squared

from jitterkit.report.plots import BLUE, INK, RUST, axes_or_new, finish, suited_angle
from jitterkit.report.words import number

_SIZE = (5.2, 3.6)
_FEWEST, _MOST = 12, 60
"""Bars of a histogram."""

_CENTRAL = (0.5, 99.5)
"""Percentiles that an axis must hold; the legend counts what lies beyond."""

_SECTORS = ((100, 12), (1000, 18), (math.inf, 36))
"""Frames up to which a half turn has so many sectors: 15, 10 and 5 degrees each."""

_NAMED_SHAPES = (("oscillation", -1.5), ("streak", -1.2), ("normal", 0.0))
_LEAST = 0.4
"""Lower end of a logarithmic axis of counts: below one, which must show."""


def plot_sizes(major: np.ndarray, minor: np.ndarray, ax: Axes | None = None) -> Axes:
    """Draw how large the jitter's axes are, arcsec; axes of exactly nothing are counted, not drawn."""
    ax = axes_or_new(ax, _SIZE)
    there = major[major > 0]
    scale, unit = suited_angle(there if len(there) else np.ones(1))
    top = float(np.percentile(there, _CENTRAL[1])) * 1.1 * scale if len(there) else 1.0
    edges = np.linspace(0, top, _bars(len(there)) + 1)
    for values, name, style in (
        (major, "major axis", {"color": BLUE, "alpha": 0.5, "lw": 0}),
        (minor, "minor axis", {"histtype": "step", "color": RUST, "lw": 1.5}),
    ):
        shown = values[values > 0] * scale
        ax.hist(shown, edges.tolist(), label=_counted(name, len(values), shown, edges), **style)  # type: ignore[arg-type]
    ax.set(xlabel=f"jitter, 1σ [{unit}]", ylabel="frames", xlim=(0, top), ylim=(0, 1.25 * ax.get_ylim()[1]))
    return finish(ax)


def _counted(name: str, of: int, shown: np.ndarray, edges: np.ndarray) -> str:
    beyond, none = int(np.sum((shown < edges[0]) | (shown > edges[-1]))), of - len(shown)
    notes = [f"{none:,} none" if none else "", f"{beyond:,} beyond" if beyond else ""]
    text = ", ".join(filter(None, notes))
    return f"{name} ({text})" if text else name


def plot_angles(angles: np.ndarray, theta: float = math.nan, ax: Axes | None = None) -> Axes:
    """Draw a rose of the jitter's directions.

    Parameters
    ----------
    angles : (n,) array
        Of major axes, degrees counter-clockwise from +x; an axis has two ends, and both are drawn.
    theta : float
        Direction of the pair, a dashed line.
    ax : matplotlib.axes.Axes, optional
        Polar.

    Returns
    -------
    ax : matplotlib.axes.Axes
        Areas, not radii, are in proportion to frames.
    """
    if ax is None:
        ax = Figure(figsize=_SIZE, layout="constrained").subplots(subplot_kw={"projection": "polar"})
    rose: Any = ax
    sectors = next(count for most, count in _SECTORS if len(angles) < most)
    counts, edges = np.histogram(angles % 180, sectors, (0, 180))
    width = 180 / sectors
    ends = np.deg2rad(np.concatenate([edges[:-1], edges[:-1] + 180]))
    rose.bar(ends, np.sqrt(np.tile(counts, 2)), np.deg2rad(width), align="edge", color=BLUE, alpha=0.6, lw=0)
    most = max(int(counts.max()), 1)
    rings = sorted({max(round(most / 4), 1), most})
    rose.set_rticks(np.sqrt(rings), [f"{ring:,}" for ring in rings], fontsize=8, color=INK)
    rose.set_rmax(math.sqrt(most) * 1.05)
    about = sum(np.roll(counts, k) for k in (-1, 0, 1))  # the figures stand where fewest frames are
    rose.set_rlabel_position((int(np.argmin(about)) + 0.5) * width)
    if math.isfinite(theta):
        line = np.deg2rad([theta, theta + 180])
        rose.plot(line, np.full(2, math.sqrt(most) * 1.05), color=RUST, ls="--", lw=1.3, label="the pair")
        rose.legend(frameon=False, fontsize=8, loc="upper left", bbox_to_anchor=(-0.35, 1.05))
    rose.tick_params(axis="x", labelsize=8)
    rose.grid(alpha=0.4)
    rose.set_title("major axis from +x; area is frames", fontsize=9)
    return ax


def plot_loci(loci: Iterable[str], ax: Axes | None = None) -> Axes:
    """Draw how many frames each locus was chosen for."""
    ax = axes_or_new(ax, _SIZE)
    ranked = Counter(filter(None, loci)).most_common()[::-1]
    total = sum(count for _, count in ranked)
    bars = ax.barh(range(len(ranked)), [count for _, count in ranked], color=BLUE, alpha=0.6, height=0.6)
    text = [f" {count:,} ({number(100 * count / total, 2)} %)" for _, count in ranked]
    ax.bar_label(bars, text, fontsize=9)
    ax.set_yticks(range(len(ranked)), [name for name, _ in ranked], parse_math=False)
    ax.set(xlabel="frames", xlim=(0, 1.35 * max((count for _, count in ranked), default=1)))
    ax.xaxis.set_major_locator(MaxNLocator(5, integer=True))
    ax.set_ylim(-0.9, max(len(ranked), 3) - 0.4)
    return finish(ax)


def plot_shapes(shapes: np.ndarray, errors: np.ndarray, ax: Axes | None = None) -> Axes:
    """Draw the excess kurtosis of the blurs with what the plain motions have, and the typical error."""
    ax = axes_or_new(ax, _SIZE)
    low, high = np.percentile(shapes, _CENTRAL)
    low, high = min(low, -1.6), max(high, 0.1)
    edges = np.linspace(low - 0.05 * (high - low), high + 0.05 * (high - low), _bars(len(shapes)) + 1)
    label = _counted(f"{len(shapes):,} frames", len(shapes), shapes, edges)
    ax.hist(shapes, edges.tolist(), color=BLUE, alpha=0.5, lw=0, label=label)
    top = ax.get_ylim()[1]
    for (name, value), line in zip(_NAMED_SHAPES, ("-.", "--", ":"), strict=True):
        ax.axvline(value, color=RUST, ls=line, lw=1.2, label=f"{name}, {number(value, 2)}")
    error = float(np.median(errors))
    bar: Any = {"color": INK, "lw": 1.4, "capsize": 3, "label": f"typical error {number(error, 2)}"}
    ax.errorbar(float(np.median(shapes)), 1.06 * top, xerr=error, **bar)
    ax.set(xlabel="excess kurtosis of the blur", ylabel="frames")
    ax.set(xlim=(edges[0], edges[-1]), ylim=(0, 1.12 * top))
    return finish(ax, ncols=3, loc="lower center", bbox_to_anchor=(0.5, 1.0))


def plot_chi2(chi2_dof: np.ndarray, dof: np.ndarray, ax: Axes | None = None) -> Axes:
    """Draw chi²/dof of the frames with the law that noise alone would give them.

    Parameters
    ----------
    chi2_dof : (n,) array
    dof : (n,) array
        Degrees of freedom; where one is not known, zero, only the expected 1 is drawn.
    ax : matplotlib.axes.Axes, optional

    Returns
    -------
    ax : matplotlib.axes.Axes
        Counts on a logarithmic axis, so that a single frame shows.

    Notes
    -----
    The law is chi-squared's, that of normal pixels; Poisson's is wider by 1/(4 mu) of a pixel of mu
    electrons without read noise, which no detector has.
    """
    ax = axes_or_new(ax, _SIZE)
    known = bool(len(dof)) and bool(np.all(dof > 0))
    kinds, weights = np.unique(dof[dof > 0], return_counts=True)
    wide = float(np.sqrt(2 / kinds.min())) if known else 0.0
    low, high = (min(chi2_dof.min(), 1 - 5 * wide), max(chi2_dof.max(), 1 + 5 * wide))
    edges = np.linspace(low, high, _fine(len(chi2_dof), high - low, wide) + 1)
    ax.hist(chi2_dof, edges.tolist(), color=BLUE, alpha=0.5, lw=0, label=f"{len(chi2_dof):,} frames")
    if known:
        law = sum(w * np.diff(chi_squared.cdf(edges * k, k)) for k, w in zip(kinds, weights, strict=True))
        text = f"noise alone, {number(float(np.median(dof)), 5)} degrees of freedom"
        ax.stairs(law, edges, color=RUST, lw=1.5, label=text)
    ax.axvline(1, color=INK, lw=0.8, ls=":")
    ax.set(yscale="log", xlabel="χ²/dof", ylabel="frames", xlim=(edges[0], edges[-1]))
    ax.set_ylim(_LEAST, 6 * ax.get_ylim()[1])
    return finish(ax)


def _bars(n: int) -> int:
    return int(np.clip(2 * math.sqrt(n), _FEWEST, _MOST))


def _fine(n: int, span: float, wide: float) -> int:
    """Bars of an axis that a far frame may stretch: three to a standard deviation, within reason."""
    return int(np.clip(max(_bars(n), 3 * span / wide if wide else 0), _FEWEST, 4 * _MOST))
