"""The picture of a run: every frame's separation about their mean."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from astropy.table import QTable
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from jitterkit.report.axes import BLUE, INK, RUST, axes_or_new, say
from jitterkit.report.words import angle_size, angle_unit, number

__all__ = ["plot_separations"]

_MANY, _BLOCKS = 300, 40
"""Points beyond which error bars turn into a haze, and how many means replace them."""


def plot_separations(table: QTable, ax: Axes | None = None, summary: dict[str, Any] | None = None) -> Axes:
    """Draw every frame's separation with its error about their weighted mean.

    Parameters
    ----------
    table : QTable
        Results, in the order to draw.
    ax : matplotlib.axes.Axes, optional
    summary : dict, optional
        From :func:`~jitterkit.report.summary.summarise`, for the mean and its 1 sigma band.

    Returns
    -------
    ax : matplotlib.axes.Axes
        Frames that failed are crosses along the lower edge.
    """
    ax = axes_or_new(ax, (9.6, 3.4))
    values, errors = (table[name].to_value("arcsec") for name in ("separation", "separation_err"))
    good = (np.asarray(table["status"]) == "ok") & np.isfinite(values)
    frame = np.arange(len(table)) + 1
    centre, mean_error = _mean(summary, values[good])
    factor, unit = _unit_of(errors[good])
    if good.any():
        draw = _draw_frames if good.sum() <= _MANY else _draw_many_frames
        draw(ax, frame[good], (values[good] - centre) * factor, errors[good] * factor)
        ax.set_ylabel(f"separation − {number(centre, 7)}″ [{unit}]")
    else:
        say(ax, "no frame was fitted").set_yticks([])
    if math.isfinite(mean_error):
        band = mean_error * factor
        ax.axhspan(-band, band, color=RUST, alpha=0.22, lw=0, zorder=1)
        ax.axhline(0, color=RUST, lw=1.2, zorder=4, label=f"weighted mean ± {angle_size(mean_error, 2)}")
    if not good.all():
        _draw_failures(ax, frame[~good])
    ax.set(xlabel="frame", xlim=(0.4, max(len(table), 1) + 0.6))
    ax.xaxis.set_major_locator(MaxNLocator(integer=True, steps=[1, 2, 5, 10]))
    ax.spines[["top", "right"]].set_visible(False)
    if ax.get_legend_handles_labels()[0]:
        above: Any = {"loc": "lower left", "bbox_to_anchor": (0, 1.0), "borderaxespad": 0.2}
        ax.legend(ncols=4, frameon=False, fontsize=9, **above)
    return ax


def _draw_frames(ax: Axes, frame: np.ndarray, values: np.ndarray, errors: np.ndarray) -> None:
    label = f"{len(frame)} frames"
    ax.errorbar(frame, values, errors, fmt="o", color=BLUE, ms=4.5, elinewidth=0.9, zorder=2, label=label)


def _draw_many_frames(ax: Axes, frame: np.ndarray, values: np.ndarray, errors: np.ndarray) -> None:
    """Points without bars, which would be a haze, under the weighted means of consecutive blocks."""
    faint = max(0.04, min(0.5, 500 / len(frame)))
    ax.plot(frame, values, ".", color=BLUE, ms=3, mew=0, alpha=faint, zorder=2)
    blocks = [b for b in np.array_split(np.flatnonzero(errors > 0), _BLOCKS) if len(b)]  # NaN is not > 0
    if not blocks:
        return
    weights = [errors[block] ** -2 for block in blocks]
    means = [np.average(values[block], weights=w) for block, w in zip(blocks, weights, strict=True)]
    bars = [np.sum(w) ** -0.5 for w in weights]
    label = f"{len(frame)} frames, means of {len(blocks[0])}"
    centres = [np.mean(frame[block]) for block in blocks]
    ax.errorbar(centres, means, bars, fmt="o", color=INK, ms=3.5, elinewidth=1.1, zorder=3, label=label)


def _draw_failures(ax: Axes, frame: np.ndarray) -> None:
    many = len(frame) > _MANY
    style: Any = {"marker": "|", "ms": 4, "mew": 0.3} if many else {"marker": "x", "ms": 5, "mew": 1.2}
    style |= {"color": INK, "ls": "", "clip_on": False, "zorder": 4, "label": f"{len(frame)} failed"}
    ax.plot(frame, np.full(len(frame), 0.03), transform=ax.get_xaxis_transform(), **style)


def _mean(summary: dict[str, Any] | None, values: np.ndarray) -> tuple[float, float]:
    """Weighted mean and its error; the median without an error where there is no summary."""
    if summary is not None and math.isfinite(summary["separation"]["mean"]):
        return summary["separation"]["mean"], summary["separation"]["error"]
    return (float(np.median(values)) if len(values) else 0.0), math.nan


def _unit_of(errors: np.ndarray) -> tuple[float, str]:
    """How many of the unit in which errors [arcsec] have few digits make an arcsecond, and its name."""
    finite = errors[np.isfinite(errors)]
    factor, unit = angle_unit(float(np.median(finite)) if finite.size else 1.0)
    return factor, unit.strip().replace("″", "arcsec")
