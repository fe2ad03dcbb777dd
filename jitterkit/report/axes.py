"""Axes, and what every picture puts on them alike: colours, outlines, colour bars, units, words.

Reach for :func:`axes_or_new`, with which a function of this package begins, and for :func:`note_in_axes`
where there is nothing to draw.  The colours survive print in grey and the common kinds of colour blindness.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jitterkit.report.words import angle_unit

BLUE, RUST, INK = "#1f4e79", "#b3421f", "#222222"
OUTLINE: Any = {"fill": False, "ec": "white", "lw": 0.9}
"""Of a patch on a dark kernel."""

ABOVE: Any = {"loc": "lower left", "bbox_to_anchor": (0, 1.0), "borderaxespad": 0.2, "columnspacing": 1.3}
"""Of a legend in one line above its axes."""


def axes_or_new(ax: Axes | None, size: tuple[float, float]) -> Axes:
    """Return the axes given, or those of a new figure of so many inches that no global state knows."""
    return Figure(figsize=size, layout="constrained").subplots() if ax is None else ax


def panels(size: tuple[float, float], rows: int, columns: int, **layout: Any) -> list[Axes]:
    """Return the axes of a new figure of so many inches, row by row; ``layout`` as for its ``subplots``."""
    figure = Figure(figsize=size, layout="constrained")
    return figure.subplots(rows, columns, squeeze=False, **layout).ravel().tolist()


def scale_and_unit(plate_scale: float | None) -> tuple[float, str]:
    """Size of a pixel and the unit it is in: the plate scale [arcsec], or one pixel where there is none."""
    return (1.0, "pixel") if plate_scale is None else (plate_scale, "arcsec")


def suited_angle(sizes: np.ndarray) -> tuple[float, str]:
    """Return how many of the unit that suits the middle one of some sizes make an arcsecond, and its name."""
    factor, unit = angle_unit(float(np.median(sizes)))
    return factor, unit.strip().replace("″", "arcsec")


def colour_bar(picture: Any, ax: Axes, label: str, extend: str = "neither") -> None:
    """Put a colour bar beside a picture; ``extend`` says which ends are pointed."""
    ax.figure.colorbar(picture, ax=ax, label=label, extend=extend, shrink=0.86, aspect=24, pad=0.02)


def finish(ax: Axes, **legend: Any) -> Axes:
    """Hide the upper and the right spine, and explain what has a label in a legend."""
    ax.spines[["top", "right"]].set_visible(False)
    if ax.get_legend_handles_labels()[0]:
        ax.legend(**{"facecolor": "white", "edgecolor": "none", "fontsize": 8} | legend)
    return ax


def note_in_axes(ax: Axes, text: str) -> Axes:
    """Put a sentence in the middle of axes, where there is nothing to draw."""
    ax.text(0.5, 0.5, text, transform=ax.transAxes, ha="center", va="center")
    return ax
