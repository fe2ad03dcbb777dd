"""Measure time and accuracy of the settings on this machine: ``jitterkit trade``."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Annotated

import typer

from jitterkit.cli import options
from jitterkit.cli.command import Default, Fixed
from jitterkit.cli.loci import build_locus
from jitterkit.cli.runtime import log, open_instrument, print_table

_USUAL = {"linear": {"length": 0.375}}
"""Sizes of a locus where none are given: one pixel of TOLIMAN, arcsec."""


def trade(
    *,
    instrument: options.InstrumentName = "toliman",
    jitter: Annotated[options.Jitter, Default(locus="linear")],
    pair: Annotated[options.Pair, Fixed(theta=0.0, x=0.0, y=0.0)],
    frames: Annotated[int, typer.Option(min=1)] = 4,
    seed: Annotated[int, typer.Option(min=0)] = 0,
    products: options.Products,
) -> None:
    """Measure what each setting costs in time and in accuracy, for your scene, on this machine.

    Measures the presets first, then every setting from fast to exact with the others as in balanced, and
    every method, from one scoring step to draws from the posterior. bias is the error of the separation in
    frames without noise; scatter is the difference from 'exact' in noisy frames; error combines
    both, as a share of the smallest error that the frames permit. sigma is the reported error. No other row
    is better than a row on the front in both time and error. For TOLIMAN under linear jitter, the settings
    of dLuxToliman are added if it is installed. Frames without jitter are fitted as by 'process --locus
    auto', which does not know that. Takes a quarter of an hour, most of it compiling.

    Parameters
    ----------
    frames
        Number of frames that each setting fits, with noise and without, and as many rotated ones.
    seed
        Seed of the random generator.
    plot : FILE.png
        Draw time against error.
    """
    products.check()
    telescope = open_instrument(instrument, single_threaded=True)
    import numpy as np

    from jitterkit.report.trade_plots import plot_trade
    from jitterkit.scene import Binary
    from jitterkit.simulate import check_scene
    from jitterkit.trade import PRESETS, TradeScene, front, measure_grid
    from jitterkit.trade.public import public_points
    from jitterkit.trade.table import trade_table

    binary = Binary(**pair.parameters(telescope))
    sizes = jitter.size_values() or _USUAL.get(jitter.locus, {})
    locus = build_locus(jitter.locus, sizes)
    check_scene(binary, locus)
    scene = TradeScene.of(telescope, binary, locus, frames, np.random.default_rng(seed))
    points = []
    for point in measure_grid(telescope, scene, locus="auto" if jitter.locus == "stable" else jitter.locus):
        numbers = f"{1e3 * point.seconds:.1f} ms per frame, error {point.error:.2g} of the least"
        log(f"{point.name}: {point.message or numbers}")
        points.append(point)
    if instrument == "toliman" and jitter.locus == "linear" and find_spec("dLuxToliman"):
        for point in public_points(binary, sizes["length"]):
            log(f"{point.name}: {1e3 * point.seconds:.0f} ms per frame, error {point.error:.2g} of the least")
            points.append(point)

    def draw():
        columns = ([point.name for point in points], [p.seconds for p in points], [p.error for p in points])
        best = [point.name for point in front(points)]
        peers = [point.name for point in points if point.settings is None]
        return plot_trade(*columns, front=best, presets=list(PRESETS), peers=peers)

    table = trade_table(points, telescope)
    print_table(table)
    products.write(table, draw)
