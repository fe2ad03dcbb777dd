"""``jitterkit trade``: what speed costs in accuracy, measured on this machine."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any

import typer

from jitterkit.cli import options
from jitterkit.cli.loci import build_locus, parse_sizes
from jitterkit.cli.pair import pair_before
from jitterkit.cli.products import check_products, deliver
from jitterkit.cli.runtime import prepare_jax, say

__all__ = ["trade"]

_USUAL = {"linear": {"length": 0.375}}
"""Sizes where none are given: of a pixel of TOLIMAN."""


def trade(
    instrument: options.InstrumentName = "toliman",
    locus: options.LocusName = "linear",
    length: options.Length = None,
    sigma: options.Sigma = None,
    shear: options.Shear = None,
    angle: options.Angle = None,
    sizes: options.Sizes = None,
    separation: options.Separation = 10.0,
    flux: options.Flux = None,
    contrast: options.Contrast = 3.37,
    frames: Annotated[
        int,
        typer.Option(
            min=1, help="Frames that each setting fits, with noise and without, and as many turned."
        ),
    ] = 4,
    seed: Annotated[int, typer.Option(min=0, help="Of the generator of the frames.")] = 0,
    plot: Annotated[
        Path | None,
        typer.Option(metavar="FILE.png", help="Draw time against error.", show_default=False),
    ] = None,
    output: options.TableOutput = None,
    overwrite: options.Overwrite = False,
) -> None:
    """Measure what each setting costs in time and in accuracy, for your scene, on this machine.

    The presets first, then every setting from fast to exact with the others as in balanced, and every method:
    from the scoring step of a glance to draws from the posterior. bias is what is wrong with the separation
    of frames without noise, scatter how far that of noisy frames is from what exact finds in them; error is
    both together, as a share of the least error that the frames allow. sigma is the error that is stated.
    Rows on the front are beaten by none in both time and error. Of TOLIMAN under linear jitter the settings
    of dLuxToliman, if it is installed, stand beside them. Frames that stand still are fitted as by 'process
    --locus auto', which does not know it. Takes a quarter of an hour, most of it compiling.
    """
    check_products(plot, output, overwrite)
    prepare_jax(alone=True)
    import numpy as np

    from jitterkit.instruments import load_instrument
    from jitterkit.report.trade_plots import plot_trade
    from jitterkit.scene import Binary
    from jitterkit.simulate import check_scene
    from jitterkit.trade import PRESETS, TradeScene, climb_ladder, front
    from jitterkit.trade.public import public_points
    from jitterkit.trade.table import trade_table

    telescope = load_instrument(instrument)
    scene = pair_before(telescope, flux, separation=separation, theta=0.0, x=0.0, y=0.0, contrast=contrast)
    given: dict[str, Any] = {"length": length, "sigma_major": sigma, "shear": shear, "angle": angle}
    given = {name: value for name, value in given.items() if value is not None} | parse_sizes(sizes or [])
    given = given or _USUAL.get(locus, {})
    jitter = build_locus(locus, given)
    check_scene(Binary(**scene), jitter)
    drawn = TradeScene.of(telescope, Binary(**scene), jitter, frames, np.random.default_rng(seed))
    points = []
    fitted = "auto" if locus == "stable" else locus
    for point in climb_ladder(telescope, drawn, locus=fitted):
        numbers = f"{1e3 * point.seconds:.1f} ms a frame, error {point.error:.2g} of the least"
        say(f"{point.name}: {point.message or numbers}")
        points.append(point)
    if instrument == "toliman" and locus == "linear" and find_spec("dLuxToliman"):
        for point in public_points(Binary(**scene), given["length"]):
            say(f"{point.name}: {1e3 * point.seconds:.0f} ms a frame, error {point.error:.2g} of the least")
            points.append(point)

    def draw():
        columns = ([point.name for point in points], [p.seconds for p in points], [p.error for p in points])
        best = [point.name for point in front(points)]
        peers = [point.name for point in points if point.settings is None]
        return plot_trade(*columns, front=best, presets=list(PRESETS), peers=peers)

    deliver(trade_table(points, telescope), draw, plot, output, overwrite)
