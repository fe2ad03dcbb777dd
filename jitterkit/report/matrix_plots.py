"""Pictures of a forecast's Fisher information and covariance, whose elements span decades and have signs.

Reach for :func:`plot_matrices`; :func:`plot_matrix` draws any symmetric matrix of named parameters.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import SymLogNorm
from matplotlib.figure import Figure

from jitterkit.forecast import Forecast
from jitterkit.report.axes import INK, axes_or_new, colour_bar
from jitterkit.report.words import MINUS

_SHORT = {"separation": "sep", "contrast": "cont", "background": "bg"}


def plot_matrices(forecast: Forecast) -> Figure:
    """Draw the Fisher matrix and the covariance beside each other, in the parameters' own units."""
    figure = Figure(figsize=(11.2, 5.0), layout="constrained")
    left, right = figure.subplots(1, 2)
    plot_matrix(forecast.information, forecast.names, left, title="Fisher information")
    plot_matrix(forecast.covariance, forecast.names, right, title="covariance (Cramér-Rao bound)")
    return figure


def plot_matrix(matrix, names: Sequence[str], ax: Axes | None = None, *, title: str = "") -> Axes:
    """Draw a symmetric matrix whose elements span decades, with signs.

    Parameters
    ----------
    matrix : (p, p) array
        Its elements have the units of their row and column, or the inverse.
    names : sequence of str
    ax : matplotlib.axes.Axes, optional
    title : str
    """
    ax = axes_or_new(ax, (5.4, 4.8))
    matrix = np.asarray(matrix)
    largest = float(np.abs(matrix).max())
    least = float(np.abs(np.diag(matrix)).min())
    norm = SymLogNorm(linthresh=least * 1e-3, vmin=-largest, vmax=largest)
    picture = ax.imshow(matrix, cmap="RdBu_r", norm=norm)
    for row, column in zip(*np.nonzero(matrix < 0), strict=True):  # print in grey has no signs
        ax.text(column, row, MINUS, ha="center", va="center", fontsize=7, color=INK)
    labels = [_SHORT.get(name, name) for name in names]
    ax.set_xticks(range(len(labels)), labels, rotation=90)
    ax.set_yticks(range(len(labels)), labels)
    ax.tick_params(length=0)
    ax.set_title(title)
    low, high = math.ceil(math.log10(least * 1e-3)), math.floor(math.log10(largest))
    powers = 10.0 ** np.arange(high, low, -max(1, (high - low) // 3))
    colour_bar(picture, ax, "own units of row and column")
    bar = picture.colorbar
    assert bar is not None
    bar.set_ticks([*-powers, 0.0, *powers[::-1]])
    bar.minorticks_off()
    return ax
