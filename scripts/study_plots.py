"""Figures that only the studies draw: a posterior, the law of a vibration, errors of sheared normals.

Like the figures of jitterkit.report, one that fills a single pair of axes takes ``ax=None`` and returns
the axes it drew on.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from arcsine import arcsine_shares
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from jitterkit.conventions import FWHM_PER_SIGMA
from jitterkit.forecast import Sweep
from jitterkit.report.forecast_plots import plot_errors
from jitterkit.report.kernel_plots import plot_kernel
from jitterkit.report.plots import BLUE, INK, RUST, axes_or_new, finish

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


def plot_shears(
    sweeps: dict[float, Sweep], *, still: float, plate_scale: float, exposure: float | None
) -> Figure:
    """Draw errors under a normal jitter, a row for each shear, with its kernel beside it.

    Parameters
    ----------
    sweeps : dict of shear to Sweep
        Each over ``sigma_major`` and ``angle``.
    still, plate_scale, exposure
        As for :func:`plot_errors`.

    Returns
    -------
    figure : matplotlib.figure.Figure
        An axis above each row counts FWHM of the major axis; every row has the same scales.
    """
    figure = Figure(figsize=(8.4, 3.3 * len(sweeps)), layout="constrained")
    rows = figure.subplots(len(sweeps), 2, width_ratios=[2.6, 1], squeeze=False)
    limits = (0.84e6 * still, 1.12e6 * max(float(sweep.error().max()) for sweep in sweeps.values()))
    for (left, right), (shear, sweep) in zip(rows, sweeps.items(), strict=True):
        scales: Any = {"still": still, "exposure": exposure, "limits": limits}
        plot_errors(sweep, left, **scales, title=f"shear {shear:g}")
        width = left.secondary_xaxis("top", functions=(_to_fwhm, _from_fwhm))
        width.set_xlabel("FWHM of the major axis [arcsec]")
        largest = float(sweep.axes["sigma_major"][-1])
        locus = sweep.forecasts[-1, 0].parameters.locus
        title = f"FWHM {_to_fwhm(largest):.3g}″, {sweep.axes['angle'][0]:g}°"
        plot_kernel(locus, right, plate_scale=plate_scale, title=title)
    return figure


def _to_fwhm(sigma):
    return sigma * FWHM_PER_SIGMA


def _from_fwhm(width):
    return width / FWHM_PER_SIGMA
