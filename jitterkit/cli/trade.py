"""``jitterkit trade``: what speed costs in accuracy, measured on this machine."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Annotated

import typer

from jitterkit.cli import options
from jitterkit.cli.command import Default, Fixed
from jitterkit.cli.loci import build_locus
from jitterkit.cli.products import Products
from jitterkit.cli.runtime import log, prepare_jax, print_table

__all__ = ["trade"]

_USUAL = {"linear": {"length": 0.375}}
"""Sizes of a locus where none are given: one pixel of TOLIMAN, arcsec."""


def trade(
    *,
    instrument: options.InstrumentName = "toliman",
    jitter: Annotated[options.Jitter, Default(locus="linear")],
    pair: Annotated[options.Pair, Fixed(theta=0.0, x=0.0, y=0.0)],
    frames: Annotated[int, typer.Option(min=1)] = 4,
    seed: Annotated[int, typer.Option(min=0)] = 0,
    products: Products,
) -> None:
    """Measure what each setting costs in time and in accuracy, for your scene, on this machine.

    The presets first, then every setting from fast to exact with the others as in balanced, and every method:
    from the scoring step of a glance to draws from the posterior. bias is what is wrong with the separation
    of frames without noise, scatter how far that of noisy frames is from what exact finds in them; error is
    both together, as a share of the least error that the frames allow. sigma is the error that is stated.
    Rows on the front are beaten by none in both time and error. Of TOLIMAN under linear jitter the settings
    of dLuxToliman, if it is installed, stand beside them. Frames that stand still are fitted as by 'process
    --locus auto', which does not know it. Takes a quarter of an hour, most of it compiling.

    Parameters
    ----------
    frames
        Frames that each setting fits, with noise and without, and as many turned.
    seed
        Of the generator of the frames.
    plot : FILE.png
        Draw time against error.
    """
    products.check()
    prepare_jax(single_threaded=True)
    import numpy as np

    from jitterkit.instruments import load_instrument
    from jitterkit.report.trade_plots import plot_trade
    from jitterkit.scene import Binary
    from jitterkit.simulate import check_scene
    from jitterkit.trade import PRESETS, TradeScene, climb_ladder, front
    from jitterkit.trade.public import public_points
    from jitterkit.trade.table import trade_table

    telescope = load_instrument(instrument)
    binary = Binary(**pair.parameters(telescope))
    sizes = jitter.size_values() or _USUAL.get(jitter.locus, {})
    locus = build_locus(jitter.locus, sizes)
    check_scene(binary, locus)
    scene = TradeScene.of(telescope, binary, locus, frames, np.random.default_rng(seed))
    points = []
    for point in climb_ladder(telescope, scene, locus="auto" if jitter.locus == "stable" else jitter.locus):
        numbers = f"{1e3 * point.seconds:.1f} ms a frame, error {point.error:.2g} of the least"
        log(f"{point.name}: {point.message or numbers}")
        points.append(point)
    if instrument == "toliman" and jitter.locus == "linear" and find_spec("dLuxToliman"):
        for point in public_points(binary, sizes["length"]):
            log(f"{point.name}: {1e3 * point.seconds:.0f} ms a frame, error {point.error:.2g} of the least")
            points.append(point)

    def draw():
        columns = ([point.name for point in points], [p.seconds for p in points], [p.error for p in points])
        best = [point.name for point in front(points)]
        peers = [point.name for point in points if point.settings is None]
        return plot_trade(*columns, front=best, presets=list(PRESETS), peers=peers)

    table = trade_table(points, telescope)
    print_table(table)
    products.write(table, draw)
