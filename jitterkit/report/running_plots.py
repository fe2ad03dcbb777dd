"""Pictures of a mean as it grows: reach for :func:`plot_running_mean` and :func:`plot_root_n_error`.

Both show the weighted mean of the first N frames, take ``ax=None`` and return the axes they drew on.
"""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from jitterkit.report.axes import BLUE, INK, RUST, axes_or_new, finish, suited_angle
from jitterkit.report.means import running_mean
from jitterkit.report.words import number

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
