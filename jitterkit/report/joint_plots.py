"""Pictures of a joint fit: what changed while the frames were taken.

Reach for :func:`plot_run`; how the separations average is drawn by :mod:`~jitterkit.report.series_plots`.
"""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes

from jitterkit.joint import SequenceFit, SequenceFrame
from jitterkit.report.plots import BLUE, INK, RUST, axes_or_new, finish, note_in_axes, panels

_SIZE = (9.6, 3.0)
_MANY = 2000
"""Frames beyond which points are drawn faint."""

_LINES = ("-", "--", ":", "-.")
_TONES = (BLUE, RUST, "#5a8f3c", "#8a5a9e", INK)


def plot_run(fit: SequenceFit) -> list[Axes]:
    """Draw a page on a run: pointing, blur, what is shared and changes, and how each frame agrees.

    Returns
    -------
    axes : list of matplotlib.axes.Axes
    """
    frames = list(fit.frames())
    axes = panels((10.4, 9.6), 4, 1, sharex=True)
    plot_pointing(frames, fit, axes[0])
    _plot_blur(frames, axes[1])
    plot_shared(frames, fit, axes[2])
    plot_leave_one_out_chi2(frames, axes[3])
    for ax in axes[:-1]:
        ax.set_xlabel("")
    return axes


def plot_pointing(frames: list[SequenceFrame], fit: SequenceFit, ax: Axes | None = None) -> Axes:
    """Draw where the pair stood."""
    x, y = (np.array([f.record.values[fit.records.own.index(axis)] for f in frames]) for axis in "xy")
    return _plot_both(frames, axes_or_new(ax, _SIZE), {"x": x, "y": y}, "midpoint [arcsec]")


def _plot_blur(frames: list[SequenceFrame], ax: Axes) -> Axes:
    """Draw the rms blur of each frame along both axes of the detector, negative where the variance is."""
    variances = np.array([f.record.moments for f in frames])[:, [0, 2]].T
    x, y = np.sign(variances) * np.sqrt(np.abs(variances))
    return _plot_both(frames, ax, {"rms along x": x, "rms along y": y}, "blur [arcsec]")


def _plot_both(frames: list[SequenceFrame], ax: Axes, curves: dict[str, np.ndarray], label: str) -> Axes:
    """Draw what frames have along x and along y, by the words for it."""
    for (words, values), colour in zip(curves.items(), (BLUE, RUST), strict=True):
        ax.plot(_times(frames), values, "o", **_points(len(frames), colour), label=words)
    ax.set(xlabel="time [s]", ylabel=label)
    return _legend(ax)


def plot_shared(frames: list[SequenceFrame], fit: SequenceFit, ax: Axes | None = None) -> Axes:
    """Draw what is shared and changes, with one sigma about it, from its mean."""
    ax = axes_or_new(ax, _SIZE)
    informed = [f for f in frames if f.shared is not None]
    times = _times(informed)
    changing = [i for i, name in enumerate(fit.combined.names) if fit.time_models[name].states > 1]
    if not changing:
        return note_in_axes(ax, "nothing that is shared was let change")
    values = np.array([f.shared.values for f in informed if f.shared])
    errors = np.array([f.shared.errors for f in informed if f.shared])
    for n, i in enumerate(changing):
        colour, style = _TONES[n % len(_TONES)], _LINES[n // len(_TONES) % len(_LINES)]
        curve = values[:, i] - values[:, i].mean()
        ax.fill_between(times, curve - errors[:, i], curve + errors[:, i], color=colour, alpha=0.2, lw=0)
        ax.plot(times, curve, color=colour, ls=style, lw=1.2, label=fit.combined.names[i])
    unit = "nm" if all(fit.combined.names[i].startswith("noll") for i in changing) else "in its unit"
    ax.set(xlabel="time [s]", ylabel=f"shared, from its mean [{unit}]")
    return _legend(ax, ncols=min(len(changing), 7))


def plot_leave_one_out_chi2(frames: list[SequenceFrame], ax: Axes | None = None) -> Axes:
    """Draw how far each frame is from all others, and mark those that do not belong."""
    ax = axes_or_new(ax, _SIZE)
    informed = [f for f in frames if f.shared is not None]
    ratio = np.array([f.shared.leave_one_out_chi2 / max(f.shared.dof, 1) for f in informed if f.shared])
    kept = np.array([f.kept for f in informed], bool)
    times = _times(informed)
    ax.plot(times[kept], ratio[kept], "o", **_points(len(informed), BLUE), label="counted")
    if not kept.all():
        ax.plot(times[~kept], ratio[~kept], "D", ms=6, mfc="none", mec=RUST, mew=1.3, label="not counted")
    ax.axhline(1.0, color=INK, lw=1.0, ls="--")
    ax.set(xlabel="time [s]", ylabel="χ² against the others", yscale="log")
    return _legend(ax)


def _times(frames: list[SequenceFrame]) -> np.ndarray:
    return np.array([f.record.time for f in frames])


def _points(n: int, colour: str) -> dict:
    alpha = 1.0 if n <= _MANY else max(0.1, math.sqrt(_MANY / n))
    size = 3.0 if n <= _MANY else 1.5
    return {"ms": size, "mew": 0, "color": colour, "alpha": alpha, "rasterized": True}


def _legend(ax: Axes, ncols: int = 2) -> Axes:
    return finish(ax, ncols=ncols, loc="lower right", bbox_to_anchor=(1.0, 0.97))
