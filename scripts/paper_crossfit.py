"""The paper's cross-fit: every jitter fitted with every locus, and a row and three columns more.

Rows: the paper's four loci, and ``auto``, which takes the locus that the frames of a setting choose together.
Columns: the paper's four, and an ellipse, a vibration over part of a cycle, and a random walk.
"""

from __future__ import annotations

import itertools
import time
from typing import NamedTuple

import numpy as np
from paper_draws import refitted_draws
from paper_study import AS_PUBLISHED, Part, Study

from jitterkit.forecast import (
    Panel,
    cross_fit,
    forecast,
    jitter_of_kind,
    linearised_draws,
    noise_free_fit,
)
from jitterkit.forward import Parameters
from jitterkit.loci import Locus, Trace, principal_axes
from jitterkit.optics.system import OpticalSystem
from jitterkit.report.crossfit_plots import crossfit_table, plot_crossfit

PIXEL = 0.375
SETTINGS = list(itertools.product((PIXEL / 5, 2 * PIXEL / 5, 3 * PIXEL / 5), (0.0, 45.0, 90.0)))
KINDS = {
    "lin": "linear",
    "shm": "shm",
    "mvn, shear 0.1": "mvn,shear=0.1",
    "mvn, shear 0.7": "mvn,shear=0.7",
    "ellipse 2:1": "ellipse,ratio=0.5",
    "0.7 cycles": "partial,cycles=0.7,phase=30",
}
PAPER_COLUMNS = tuple(KINDS)[:4]
PAPER_ROWS = ("linear", "shm", "mvn", "stable")
REFITTED = ("shm", PIXEL * 3 / 5, 45.0)
"""Kind, size and angle of the panel that is fitted in full too."""
REFITS = 150
"""Of its frames: a second each."""


class CrossFitStudy(NamedTuple):
    """The figure's panels, how long those of the paper took [s], and what full refits say of one."""

    panels: list[Panel]
    seconds: float
    refits: dict[str, np.ndarray]


def random_walk(size: float, angle: float) -> Locus:
    """A Brownian path whose largest extent is the size, turned so that its longer axis has the angle."""
    rng = np.random.default_rng(3)
    x, y = np.cumsum(rng.standard_normal((400, 2)), axis=0).T
    moments = np.asarray(Trace.of(np.arange(400.0), x, y).moments())
    turn = np.radians(angle - principal_axes(moments)[2])
    x, y = np.cos(turn) * x - np.sin(turn) * y, np.sin(turn) * x + np.cos(turn) * y
    directions = np.radians(np.arange(180))
    reach = np.ptp(np.outer(np.cos(directions), x) + np.outer(np.sin(directions), y), axis=1).max()
    return Trace.of(np.arange(400.0), x * size / reach, y * size / reach)


def columns() -> dict[str, list[Locus]]:
    """The loci of every column, in the paper's nine settings."""
    kinds = {name: [jitter_of_kind(kind, *setting) for setting in SETTINGS] for name, kind in KINDS.items()}
    return kinds | {"random walk": [random_walk(*setting) for setting in SETTINGS]}


def run_study(still: Parameters, optics: OpticalSystem, draws: int, refits: int, seed: int) -> CrossFitStudy:
    """Fit all panels by one step a frame, and one of them in full on the same draws."""
    panels, seconds, began = [], 0.0, time.perf_counter()
    rng = np.random.default_rng(seed)
    for panel in cross_fit(columns(), (*PAPER_ROWS, "auto"), still, optics, draws, rng, options=AS_PUBLISHED):
        panels.append(panel)
        if panel.data in PAPER_COLUMNS:
            seconds = time.perf_counter() - began
    return CrossFitStudy(panels, seconds, _refit(still, optics, refits, seed))


def _refit(still: Parameters, optics: OpticalSystem, draws: int, seed: int) -> dict[str, np.ndarray]:
    """Separations of one panel by steps and by full refits, the same frames, in errors without jitter."""
    truth = still.with_locus(jitter_of_kind(*REFITTED))
    fits = [noise_free_fit(truth, name, optics, options=AS_PUBLISHED) for name in ("mvn", "linear")]
    quick = linearised_draws(fits, draws, np.random.default_rng(seed))
    full = refitted_draws(fits, optics, draws, np.random.default_rng(seed), auto=True, options=AS_PUBLISHED)
    return {"quick": quick.separations, "full": full.separations}


def crossfit(study: Study) -> Part:
    """The figure, and what it shows, exact numerics only."""
    still, optics = study.parameters(), study.exact
    found = run_study(still, optics, study.draws, min(study.draws, REFITS), study.seed)
    figure = plot_crossfit(
        found.panels, forecast(still, optics.nominal, options=AS_PUBLISHED).error("separation")
    )
    words = "Fitted less true separation: data by columns, the locus fitted by rows; marks are exact biases."
    frames = len(PAPER_COLUMNS) * len(SETTINGS) * study.draws
    timings = [(f"the cross-fit's 16 panels and their row auto, {frames:,} frames", found.seconds)]
    tables = {"crossfit": crossfit_table(found.panels, SETTINGS)}
    pictures = {"crossfit": (figure, words)}
    return Part(pictures=pictures, tables=tables, text=describe(found), timings=timings)


def describe(study: CrossFitStudy) -> str:
    """What the figure shows, in Markdown."""
    names = list(dict.fromkeys(panel.data for panel in study.panels))
    rows = list(dict.fromkeys(panel.fitted for panel in study.panels))
    found = {(panel.data, panel.fitted): panel for panel in study.panels}
    draws = study.panels[0].offsets.shape[1]
    lines = [
        "## Every jitter fitted with every locus",
        "",
        "Bias of the separation without noise, µas: the worst of the nine settings; in brackets over the "
        f"standard error of the mean of {draws:,} frames.",
        "",
        f"| fitted with | {' | '.join(names)} |",
        f"|---|{'---|' * len(names)}",
    ]
    for row in rows:
        cells = []
        for name in names:
            panel = found[name, row]
            worst = panel.bias[np.argmax(np.abs(panel.bias))]
            cells.append(f"{1e6 * worst:+.2f} ({panel.worst:.1f})")
        lines.append(f"| {row} | {' | '.join(cells)} |")
    lines += ["", "Mean of all draws of a panel, µas:", "", f"| fitted with | {' | '.join(names)} |"]
    lines.append(f"|---|{'---|' * len(names)}")
    for row in rows:
        means = [found[name, row].mean for name in names]
        lines.append(f"| {row} | {' | '.join(f'{1e6 * m:+.1f} ± {1e6 * e:.1f}' for m, e in means)} |")
    return "\n".join([*lines, *_describe_refits(study.refits), ""])


def _describe_refits(refits: dict[str, np.ndarray]) -> list[str]:
    quick, full = refits["quick"], refits["full"]
    kind, size, angle = REFITTED
    lines = [
        "",
        f"The same {quick.shape[1]} frames of {kind}, {size:g} arcsec at {angle:g} degrees, by a step and in "
        "full:",
        "",
        "| fitted with | mean by steps, in full [µas] | their difference | scatter: full over steps |",
        "|---|---|---|---|",
    ]
    for name, one, other in zip(("mvn", "linear"), quick, full, strict=False):
        kept = np.isfinite(other)
        off, spread = other[kept] - one[kept], one[kept].std(ddof=1)
        means = (1e6 * (one[kept].mean() - 10.0), 1e6 * (other[kept].mean() - 10.0))
        error = off.std(ddof=1) / np.sqrt(kept.sum())
        lines.append(
            f"| {name} | {means[0]:+.1f}, {means[1]:+.1f} ± {1e6 * spread / np.sqrt(kept.sum()):.1f} | "
            f"{1e6 * off.mean():+.2f} ± {1e6 * error:.2f} | {other[kept].std(ddof=1) / spread:.4f} |"
        )
    auto = 1e6 * (full[-1][np.isfinite(full[-1])] - 10.0)
    error = auto.std(ddof=1) / np.sqrt(auto.size)
    return [*lines, f"| auto, a frame | in full {auto.mean():+.1f} ± {error:.1f} | | |"]
