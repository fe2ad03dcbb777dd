"""``jitterkit crossfit``: what fitting the wrong locus does to the separation."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Annotated

import typer

from jitterkit.cli import options
from jitterkit.cli.pair import pair_before
from jitterkit.cli.products import check_products, deliver
from jitterkit.cli.runtime import prepare_jax, say

__all__ = ["crossfit"]

_DATA, _FITTED = (
    ["linear", "shm", "mvn,shear=0.1", "mvn,shear=0.7"],
    ["stable", "linear", "shm", "mvn", "auto"],
)
_SIZES, _ANGLES = [0.075, 0.15, 0.225], [0.0, 45.0, 90.0]
"""The paper's: fifths of a TOLIMAN pixel."""


def crossfit(
    data: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KIND",
            help="Jitter of the data, several times for several: linear, shm, mvn,shear=0.7, "
            f"ellipse,ratio=0.5, partial,cycles=0.7,phase=30. By default {' '.join(_DATA)}.",
            show_default=False,
        ),
    ] = None,
    fit: Annotated[
        list[str] | None,
        typer.Option(
            metavar="LOCUS",
            help="Locus to fit, several times for several; auto chooses by the evidence of all frames. By "
            f"default {', '.join(_FITTED)}.",
            show_default=False,
        ),
    ] = None,
    size: Annotated[
        list[float] | None,
        typer.Option(
            help="Size of the data's jitter, arcsec: length, peak to peak, FWHM of a normal, whole major "
            f"axis of an ellipse, as in the paper. By default {_SIZES}.",
            show_default=False,
        ),
    ] = None,
    angle: Annotated[
        list[float] | None,
        typer.Option(
            help=f"Its angle, degrees counter-clockwise from +x. By default {_ANGLES}.", show_default=False
        ),
    ] = None,
    draws: Annotated[
        int, typer.Option(min=2, help="Noisy frames of each setting, fitted by one step.")
    ] = 1000,
    seed: Annotated[int, typer.Option(min=0, help="Of the generator of the draws.")] = 0,
    instrument: options.InstrumentName = "toliman",
    separation: options.Separation = 10.0,
    theta: options.Theta = 180.0,
    flux: options.Flux = None,
    contrast: options.Contrast = 3.37,
    plot: Annotated[
        Path | None,
        typer.Option(metavar="FILE.png", help="Draw the histograms.", show_default=False),
    ] = None,
    output: options.TableOutput = None,
    overwrite: options.Overwrite = False,
) -> None:
    """Fit frames of one jitter with the loci of others: bias and scatter of the separation.

    The bias is exact: that of the expected image, fitted without noise. Mean and scatter are of noisy frames.
    misfit is the chi-squared that a wrong locus adds to a frame, whose own noise is about 180 for 128 x 128
    pixels.
    """
    check_products(plot, output, overwrite)
    prepare_jax()
    import numpy as np

    from jitterkit.forecast import cross_fit, forecast, jitter_of_kind
    from jitterkit.forward import Parameters
    from jitterkit.instruments import load_instrument
    from jitterkit.loci import Stable
    from jitterkit.report.crossfit_plots import crossfit_table, plot_crossfit
    from jitterkit.scene import Binary
    from jitterkit.simulate import check_reach, check_scene

    telescope = load_instrument(instrument)
    scene = pair_before(telescope, flux, separation=separation, theta=theta, x=0.0, y=0.0, contrast=contrast)
    still = Parameters(Binary(**scene), Stable.of(), np.zeros(len(telescope.aberrations)))
    settings = list(itertools.product(size or _SIZES, angle or _ANGLES))
    columns = {kind: [jitter_of_kind(kind, *setting) for setting in settings] for kind in data or _DATA}
    optics = telescope.system()
    for locus in itertools.chain(*columns.values()):
        check_scene(still.binary, locus)
        check_reach(still.binary, locus, optics.nominal)
    rng = np.random.default_rng(seed)
    panels = []
    for panel in cross_fit(columns, fit or _FITTED, still, optics, draws, rng, telescope.detector):
        mean, error = panel.mean
        say(f"{panel.data} fitted with {panel.fitted}: {1e6 * mean:+.1f} ± {1e6 * error:.1f} µas")
        panels.append(panel)

    def draw():
        alone = forecast(still, optics.nominal, telescope.detector).error("separation")
        return plot_crossfit(panels, alone).axes[0]

    deliver(crossfit_table(panels, settings), draw, plot, output, overwrite)
