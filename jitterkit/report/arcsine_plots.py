"""The paper's check of its appendix B: where a vibration lingers, drawn and computed."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes

from jitterkit.motion import arcsine_shares
from jitterkit.report.axes import RUST, axes_or_new


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
    ax.spines[["top", "right"]].set_visible(False)
    ax.legend(frameon=False, fontsize=8, loc="upper center")
    return ax
