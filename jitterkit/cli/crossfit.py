"""Measure the bias of a separation that is fitted with the wrong locus: ``jitterkit crossfit``."""

from __future__ import annotations

import itertools
from typing import Annotated

import typer

from jitterkit.cli import options
from jitterkit.cli.command import Fixed
from jitterkit.cli.runtime import dark_exposure, log, open_instrument, print_table

_DATA = ["linear", "shm", "mvn,shear=0.1", "mvn,shear=0.7"]
_FITTED = ["stable", "linear", "shm", "mvn", "auto"]
_SIZES, _ANGLES = [0.075, 0.15, 0.225], [0.0, 45.0, 90.0]
"""Those of the paper: fifths of a TOLIMAN pixel, arcsec; degrees."""


def crossfit(
    *,
    data: list[str] | None = None,
    fit: list[str] | None = None,
    size: list[float] | None = None,
    angle: list[float] | None = None,
    draws: Annotated[int, typer.Option(min=2)] = 1000,
    seed: Annotated[int, typer.Option(min=0)] = 0,
    instrument: options.InstrumentName = "toliman",
    pair: Annotated[options.Pair, Fixed(x=0.0, y=0.0)],
    products: options.Products,
) -> None:
    """Fit frames of one jitter with the loci of others: bias and scatter of the separation.

    The bias is exact: that of the expected image, fitted without noise. Mean and scatter are of noisy frames.
    misfit is the chi-squared that a wrong locus adds to a frame, whose own noise is about 180 for 128 x 128
    pixels.

    Parameters
    ----------
    data : KIND
        Jitter of the data; repeat the option for several: linear, shm, mvn,shear=0.7, ellipse,ratio=0.5,
        partial,cycles=0.7,phase=30. By default linear shm mvn,shear=0.1 mvn,shear=0.7.
    fit : LOCUS
        Locus to fit; repeat the option for several. auto chooses by the evidence of all frames. By default
        stable, linear, shm, mvn, auto.
    size
        Size of the data's jitter, arcsec: length, peak to peak, FWHM of a normal, whole major axis of an
        ellipse, as in the paper. By default [0.075, 0.15, 0.225].
    angle
        Angle of the data's jitter, degrees counter-clockwise from +x. By default [0.0, 45.0, 90.0].
    draws
        Number of noisy frames of each setting, fitted by one step.
    seed
        Seed of the random generator.
    plot : FILE.png
        Draw the histograms.
    """
    products.check()
    telescope = open_instrument(instrument)
    import numpy as np

    from jitterkit.forecast import cross_fit, forecast, jitter_of_kind
    from jitterkit.forward import Parameters
    from jitterkit.loci import Stable
    from jitterkit.report.crossfit_plots import crossfit_table, plot_crossfit
    from jitterkit.scene import Binary
    from jitterkit.simulate import check_reach, check_scene

    binary = Binary(**pair.parameters(telescope))
    still = Parameters(binary, Stable.of(), np.zeros(len(telescope.aberrations)))
    settings = list(itertools.product(size or _SIZES, angle or _ANGLES))
    columns = {kind: [jitter_of_kind(kind, *setting) for setting in settings] for kind in data or _DATA}
    optics = telescope.system()
    for locus in itertools.chain(*columns.values()):
        check_scene(binary, locus)
        check_reach(binary, locus, optics.nominal)
    rng = np.random.default_rng(seed)
    panels = []
    detector, exposure = telescope.detector, dark_exposure(telescope)
    loci = columns, fit or _FITTED
    for panel in cross_fit(*loci, still, optics, draws, rng, detector, exposure=exposure):
        mean, error = panel.mean
        log(f"{panel.data} fitted with {panel.fitted}: {1e6 * mean:+.1f} ± {1e6 * error:.1f} µas")
        panels.append(panel)

    def draw():
        alone = forecast(still, optics.nominal, detector, exposure=exposure).error("separation")
        return plot_crossfit(panels, alone).axes[0]

    table = crossfit_table(panels, settings)
    print_table(table)
    products.write(table, draw)
