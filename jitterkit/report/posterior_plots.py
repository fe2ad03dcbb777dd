"""Pictures of a posterior: what the draws say of one number, and what the fit said.

Reach for :func:`plot_marginal`; like its neighbours it takes ``ax=None`` and returns the axes it drew on.
:func:`plot_arcsine` is the paper's check of its appendix B: where a vibration lingers, drawn and computed.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.ticker import MaxNLocator

from jitterkit.motion import arcsine_shares
from jitterkit.report.axes import BLUE, INK, RUST, axes_or_new, finish

_BINS, _REACH = 50, 4.5
"""Bars, and how many standard deviations of the draws the axis shows on either side of their median."""


def plot_marginal(
    draws: np.ndarray,
    fitted: float,
    error: float,
    ax: Axes | None = None,
    *,
    label: str,
    truth: float | None = None,
) -> Axes:
    """Draw how one number is distributed in a posterior, under the normal law that its fit stands for.

    Parameters
    ----------
    draws : (n,) array
    fitted, error : float
        Of the fit, in the unit of the draws; without a finite, positive error there is no curve.
    ax : matplotlib.axes.Axes, optional
    label : str
        What it is, with its unit.
    truth : float, optional
        Where known; the triangle at the foot.

    Returns
    -------
    ax : matplotlib.axes.Axes
        Densities: bars and curve each hold an area of one, what lies beyond the axis included.
    """
    ax = axes_or_new(ax, (4.2, 3.0))
    draws = np.asarray(draws, float)
    middle, spread = np.median(draws), draws.std(ddof=1)
    edges = middle + _REACH * spread * np.linspace(-1, 1, _BINS + 1)
    density = np.histogram(draws, edges)[0] / (len(draws) * np.diff(edges))
    ax.stairs(density, edges, fill=True, fc=to_rgba(BLUE, 0.35), ec=BLUE, lw=0.8, label="posterior")
    if np.isfinite(error) and error > 0:
        x = np.linspace(edges[0], edges[-1], 400)
        normal = np.exp(-(((x - fitted) / error) ** 2) / 2) / (np.sqrt(2 * np.pi) * error)
        ax.plot(x, normal, color=RUST, lw=1.8, ls="--", label="Laplace")
    if truth is not None:
        foot = ax.get_xaxis_transform()
        ax.plot(truth, 0.03, "^", color=INK, ms=7, mew=0, transform=foot, label="truth")
    ax.set(xlabel=label, ylabel="density", yticks=[], xlim=(edges[0], edges[-1]), ylim=(0, None))
    ax.xaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
    return finish(ax, fontsize=9)


def plot_arcsine(
    rng: np.random.Generator, amplitude: float = 1.0, draws: int = 100_000, ax: Axes | None = None
) -> Axes:
    """Draw the histogram of a vibration at random times against its density (the paper's appendix B).

    Parameters
    ----------
    rng : numpy.random.Generator
    amplitude : float
        Zero to peak.
    draws : int
    ax : matplotlib.axes.Axes, optional

    Returns
    -------
    ax : matplotlib.axes.Axes
        The histogram filled, the exact mean of the density over each cell as points.
    """
    ax = axes_or_new(ax, (5.6, 4.0))
    edges = amplitude * np.linspace(-1, 1, 61)
    counts, _ = np.histogram(amplitude * np.sin(rng.uniform(-np.pi / 2, np.pi / 2, draws)), edges)
    width = np.diff(edges)
    ax.stairs(counts / draws / width, edges, fill=True, color="0.8", label=f"{draws:,} random times")
    law: Any = {"color": RUST, "ms": 4, "label": "arcsine law, over each cell"}
    ax.plot((edges[1:] + edges[:-1]) / 2, arcsine_shares(edges, amplitude) / width, "o", **law)
    ax.set(xlabel="place [amplitude's unit]", ylabel="density [1/unit]", ylim=(0, None))
    return finish(ax, loc="upper center")
