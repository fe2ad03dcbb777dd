"""The picture of a cross-fit: histograms of the separation, data by columns, fitted loci by rows.

Reach for :func:`plot_crossfit`; :func:`plot_panel` draws one of its panels, and :func:`crossfit_table` has
the numbers.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from astropy.table import QTable
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jitterkit.forecast import Panel
from jitterkit.report.columns import Column, bind_rows, measured
from jitterkit.report.plots import BLUE, INK, RUST, axes_or_new

_BINS = 60


def plot_crossfit(panels: Sequence[Panel], unit: float) -> Figure:
    """Draw all panels of a cross-fit.

    Parameters
    ----------
    panels : sequence of Panel
        From :func:`jitterkit.forecast.cross_fit`.
    unit : float
        What the offsets are counted in: the error without jitter, arcsec.
    """
    columns = list(dict.fromkeys(panel.data for panel in panels))
    rows = list(dict.fromkeys(panel.fitted for panel in panels))
    figure = Figure(figsize=(1.9 * len(columns) + 0.9, 1.45 * len(rows) + 0.9), layout="constrained")
    axes = figure.subplots(len(rows), len(columns), sharex=True, squeeze=False)
    reach = max(float(np.abs(np.percentile(panel.offsets, (0.1, 99.9))).max()) for panel in panels) / unit
    for panel in panels:
        ax = axes[rows.index(panel.fitted), columns.index(panel.data)]
        plot_panel(panel, unit, ax)
        ax.set_xlim(-1.05 * reach, 1.05 * reach)
    for ax, name in zip(axes[0], columns, strict=True):
        ax.set_title(name, fontsize=10)
    for ax, name in zip(axes[:, 0], rows, strict=True):
        ax.set_ylabel(name, fontsize=10)
    counted = f"[{1e6 * unit:.0f} µas, the error without jitter]"
    figure.supxlabel(f"fitted − true separation {counted}", fontsize=10)
    figure.supylabel("fitted with", fontsize=10)
    figure.suptitle("data of", fontsize=10)
    return figure


def plot_panel(panel: Panel, unit: float, ax: Axes | None = None) -> Axes:
    """Draw the histogram of one panel, all settings together, and the normal law that fits it.

    Parameters
    ----------
    panel : Panel
    unit : float
        arcsec.
    ax : matplotlib.axes.Axes, optional

    Returns
    -------
    ax : matplotlib.axes.Axes
        The law's 1 sigma is shaded; marks along the lower edge are the noise-free biases of the settings.
    """
    ax = axes_or_new(ax, (3.2, 2.4))
    values = panel.offsets.ravel() / unit
    ax.hist(values, bins=_BINS, density=True, color=BLUE, alpha=0.45, lw=0)
    mean, sigma = float(values.mean()), float(values.std())
    x = np.linspace(mean - 4 * sigma, mean + 4 * sigma, 200)
    law = np.exp(-(((x - mean) / sigma) ** 2) / 2) / (sigma * np.sqrt(2 * np.pi))
    ax.plot(x, law, color=RUST, lw=1.2)
    inside = np.abs(x - mean) <= sigma
    ax.fill_between(x[inside], law[inside], color=RUST, alpha=0.25, lw=0)
    ax.axvline(0, color=INK, lw=0.8, ls="--")
    ax.plot(panel.bias / unit, np.full(len(panel.bias), 0.03), "|", color=INK, ms=7, mew=1.2,
            transform=ax.get_xaxis_transform(), clip_on=False)  # fmt: skip
    centre, error = (1e6 * value for value in panel.mean)
    words = f"{centre:+.1f} ± {error:.1f} µas\nσ {sigma:.3f}"
    ax.text(0.03, 0.97, words.replace("-", "−"), transform=ax.transAxes, va="top", fontsize=6.5)
    ax.set_yticks([])
    ax.spines[["top", "right", "left"]].set_visible(False)
    ax.tick_params(labelsize=8)
    return ax


_COLUMNS = (
    Column("data", "locus of the data", kind=str),
    Column("size", "of the data's jitter", "arcsec"),
    Column("angle", "of the data's jitter", "deg"),
    Column("fitted", "locus asked for", kind=str),
    Column("locus", "locus fitted", kind=str),
    Column("bias", "of the separation, without noise", "uas", format=".2f"),
    *measured("mean", "of the separations less the true one", "uas", format=".2f"),
    Column("scatter", "of the separations", "uas", format=".2f"),
    Column("error", "as the fit states it", "uas", format=".2f"),
    Column("misfit", "chi-squared that a wrong locus adds to a frame", format=".2f"),
)


def crossfit_table(panels: Sequence[Panel], settings: Sequence[tuple[float, float]]) -> QTable:
    """Tabulate a panel with a row a setting.

    Parameters
    ----------
    panels : sequence of Panel
    settings : sequence of (size, angle)
        Of the data, arcsec and degrees, in the order of the panels' settings.

    Returns
    -------
    table : QTable
        The bias without noise; mean, its standard error and scatter of the draws; what the fit believes; and
        the chi-squared that a wrong locus adds to a frame.
    """
    rows = []
    for panel in panels:
        spread = panel.offsets.std(axis=1, ddof=1)
        numbers = (panel.bias, panel.offsets.mean(axis=1), spread / np.sqrt(panel.offsets.shape[1]), spread)
        found = zip(settings, *numbers, panel.error, panel.misfit, panel.chosen, strict=True)
        for (size, angle), *values, misfit, chosen in found:
            microarcsec = [1e6 * value for value in values]
            rows.append((panel.data, size, angle, panel.fitted, chosen, *microarcsec, misfit))
    return bind_rows(_COLUMNS, rows)
