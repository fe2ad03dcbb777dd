"""The picture of a photon budget: starlight, what the telescope passes, and what is detected.

Reach for :func:`plot_photons`, which draws the three above each other; each takes axes of its own too.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes

from jitterkit.photons.budget import PhotonBudget
from jitterkit.report.plots import ABOVE, BLUE, INK, RUST, axes_or_new, finish, panels
from jitterkit.report.words import number

_MARGIN = 0.35
"""Of the band's width, shown on either side of it."""

_SIZE = (6.4, 2.6)
"""Inches, of axes of their own."""

_DENSITY = "photons / (s cm² nm)"
_A: Any = {"color": BLUE, "lw": 1.3, "label": "A"}
_B: Any = {"color": RUST, "lw": 1.3, "ls": "--", "label": "B"}
_BOTH: Any = {"color": INK, "lw": 1.9}


def plot_photons(budget: PhotonBudget) -> list[Axes]:
    """Draw starlight, throughput and detected photons above each other on a new figure.

    Returns
    -------
    axes : list of matplotlib.axes.Axes
        From the upper to the lower, over one range of wavelengths.
    """
    axes = panels((6.4, 7.2), 3, 1, sharex=True)
    for draw, ax in zip((plot_starlight, plot_throughput, plot_detected), axes, strict=True):
        draw(budget, ax)
    for ax in axes[:-1]:
        ax.set_xlabel("")
    axes[0].figure.align_ylabels(axes)
    return axes


def plot_starlight(budget: PhotonBudget, ax: Axes | None = None) -> Axes:
    """Draw the spectra of A, B and both before the telescope."""
    ax = axes_or_new(ax, _SIZE)
    low, high = _range(budget)
    rows = [star.wavelengths for star in budget.stars]
    at = np.unique(np.concatenate([np.linspace(low, high, 600), *rows]))
    at = at[(at >= low) & (at <= high)]
    a, b = (star(at) for star in budget.stars)
    ax.plot(at, a + b, **_BOTH, label="A + B")
    ax.plot(at, a, **_A)
    ax.plot(at, b, **_B)
    return _finish(ax, budget, f"starlight\n{_DENSITY}")


def plot_throughput(budget: PhotonBudget, ax: Axes | None = None) -> Axes:
    """Draw what the filter, the glass and the detector pass, and their product."""
    ax = axes_or_new(ax, _SIZE)
    through = budget.throughput
    low, high = _range(budget)
    qe, plates = through.qe, through.plates_transmission
    ax.plot(*_stepped(through.filter.wavelengths, through.filter.values), color=BLUE, lw=1.3, label="filter")
    glass = f"glass, {through.plates} plates"
    ax.plot((low, high), (plates, plates), color=INK, lw=1.1, ls="-.", label=glass)
    ax.plot(qe.wavelengths, qe.values, color=RUST, lw=1.3, ls="--", label="quantum efficiency")
    ax.plot(*_stepped(budget.wavelengths, through(budget.wavelengths)), **_BOTH, label="total")
    ax.set_ylim(0, 1.08)
    return _finish(ax, budget, "throughput", top=None)


def plot_detected(budget: PhotonBudget, ax: Axes | None = None) -> Axes:
    """Draw the detected spectra; the shaded area is the rate of both."""
    ax = axes_or_new(ax, _SIZE)
    a, b = budget.detected
    at, both = _stepped(budget.wavelengths, a + b)
    ax.plot(at, both, **_BOTH, label="A + B")
    ax.plot(*_stepped(budget.wavelengths, a), **_A)
    ax.plot(*_stepped(budget.wavelengths, b), **_B)
    ax.fill_between(at, both, color=INK, alpha=0.13, lw=0, label=f"{number(budget.rate)} photons / (s cm²)")
    return _finish(ax, budget, f"detected\n{_DENSITY}")


def _finish(ax: Axes, budget: PhotonBudget, label: str, top: float | None = 1.08) -> Axes:
    if top is not None:
        ax.set_ylim(0, top * max(float(np.nanmax(line.get_ydata())) for line in ax.lines))
    ax.set(xlim=_range(budget), xlabel="wavelength [nm]", ylabel=label)
    return finish(ax, ncols=4, fontsize=9, **ABOVE)


def _range(budget: PhotonBudget) -> tuple[float, float]:
    low, high = budget.wavelengths[[0, -1]]
    margin = _MARGIN * (high - low)
    return float(low - margin), float(high + margin)


def _stepped(wavelengths: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a curve with the steps from and to nothing at its ends."""
    at = np.concatenate([wavelengths[:1], wavelengths, wavelengths[-1:]])
    return at, np.concatenate([[0.0], values, [0.0]])
