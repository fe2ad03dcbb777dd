"""The picture of a trade: milliseconds a frame against the error, both by decades."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product

import numpy as np
from matplotlib.axes import Axes
from matplotlib.transforms import Bbox

from jitterkit.report.plots import BLUE, INK, RUST, axes_or_new, note_in_axes

_POSITIONS = (3, -9, 11, -17, 19)
"""Points above a point at which its name may stand."""

_LEAST = 1e-5
"""Share of the bound below which errors are drawn at the lower edge: nobody will ever see them."""


def plot_trade(
    names: Sequence[str],
    seconds: Sequence[float],
    errors: Sequence[float],
    front: Sequence[str] = (),
    presets: Sequence[str] = (),
    peers: Sequence[str] = (),
    ax: Axes | None = None,
) -> Axes:
    """Draw what settings cost against what they give.

    Parameters
    ----------
    names : sequence of str
    seconds : sequence of float
        Of a frame.
    errors : sequence of float
        As a share of the least that there can be; those that are not finite are left out.
    front, presets, peers : sequence of str
        Names of those to join by a line, to write in full, and to mark as another package's.
    ax : matplotlib.axes.Axes, optional

    Returns
    -------
    ax : matplotlib.axes.Axes
    """
    ax = axes_or_new(ax, (8.0, 5.0))
    known = {
        name: (1e3 * spent, max(error, _LEAST))
        for name, spent, error in zip(names, seconds, errors, strict=True)
        if np.isfinite(spent) and np.isfinite(error)
    }
    if not known:
        return note_in_axes(ax, "no settings could be measured")
    for name, (x, y) in known.items():
        ours = name not in peers
        ax.plot(x, y, "o" if ours else "s", color=BLUE if ours else RUST, ms=7 if name in presets else 4)
    line = sorted(known[name] for name in front if name in known)
    ax.plot(*np.transpose(line), color=BLUE, lw=1, zorder=0) if line else None
    error = "bias and added scatter [of the least error]"
    ax.set(xscale="log", yscale="log", xlabel="ms a frame", ylabel=error)
    ax.set_ylim(bottom=0.7 * _LEAST)
    ax.grid(which="major", lw=0.3)
    _write(ax, known, presets, front)
    return ax


def _write(ax: Axes, known: Mapping[str, tuple[float, float]], presets, front) -> None:
    """Write a name at each point where it covers no other, presets first; where there is no space, none."""
    written: list[Bbox] = []
    whole = ax.get_figure(root=True)
    assert whole is not None
    whole.draw_without_rendering()  # so that points have places
    for name in sorted(known, key=lambda name: (name not in presets, name not in front)):
        weight = "bold" if name in presets else "normal"
        for position, side in product(_POSITIONS, ("left", "right")):
            offset = (5 if side == "left" else -5, position)
            text = ax.annotate(name, known[name], offset, textcoords="offset points", ha=side)
            text.set(fontsize=7, color=INK, fontweight=weight, in_layout=False)
            box = text.get_window_extent()
            inside = all(ax.bbox.contains(*corner) for corner in (box.min, box.max))
            if inside and not any(box.overlaps(other) for other in written):
                written.append(box)
                break
            text.remove()
