"""Compute what effects that the model leaves out do to a separation: ``jitterkit budget``."""

from __future__ import annotations

import math
from typing import Annotated

import typer

from jitterkit.cli import options
from jitterkit.cli.command import Default, Fixed
from jitterkit.cli.loci import build_locus
from jitterkit.cli.quantities import named, parse_angle, parse_number
from jitterkit.cli.runtime import dark_exposure, log, open_instrument, print_table

_USUAL = 0.15
"""Sigma in pixels of a jitter that is not given: that of a drift of half a pixel."""


def budget(
    *,
    instrument: options.InstrumentName = "toliman",
    jitter: Annotated[options.Jitter, Default(locus="mvn")],
    pair: options.Pair,
    effect: list[str] | None = None,
    frames: Annotated[int, typer.Option(min=1)] = 10_000,
    target: str = "1uas",
    background: bool = True,
    products: Annotated[options.Products, Fixed(plot=None)],
) -> None:
    """List the effects that the model leaves out or holds, and what each does to the separation of a pair.

    Prints for each effect of a usual size: the bias of the separation; by what factor the error of the
    separation grows if the effect is free in a fit; after how many frames their chi-squared shows it; and the
    size at which the bias is the target, which is how well the effect must be known. To first order, from the
    expected Fisher information.

    Parameters
    ----------
    effect : NAME=SIZE
        Size of an effect, in the unit of its row; repeat the option for several: plate_scale=1e-6.
    frames
        Number of frames of a night.
    target : ANGLE
        Bias of the separation for which the size of each effect is computed.
    """
    products.check()
    goal, sizes, own = parse_angle(target, "--target"), _sizes(effect or []), jitter.size_values()
    telescope = open_instrument(instrument)
    import numpy as np

    from jitterkit.forecast import systematic_errors
    from jitterkit.forward import Parameters
    from jitterkit.refit import FitOptions, Priors
    from jitterkit.report.forecast_table import systematics_table
    from jitterkit.report.words import angle_size
    from jitterkit.scene import Binary
    from jitterkit.simulate import check_inside, check_scene

    if jitter.locus == "mvn":
        own = {"sigma_major": _USUAL * telescope.plate_scale} | own
    scene, locus = Binary(**pair.parameters(telescope)), build_locus(jitter.locus, own)
    check_scene(scene, locus)
    check_inside(scene, telescope.shape, telescope.plate_scale)
    known = Priors.alike(telescope.aberrations, telescope.aberration_sigma)
    fit = FitOptions(hold=options.held(background), priors=known)
    dark_exposure(telescope)  # refuses what would be left out
    parameters = Parameters(scene, locus, np.zeros(len(telescope.aberrations)))
    error, errors = systematic_errors(telescope, parameters, fit, sizes=sizes, target=goal)
    table = systematics_table(errors, frames)
    print_table(table)
    mean = angle_size(error / math.sqrt(frames))
    log(f"separation: {angle_size(error)} per frame, {mean} from {frames:,} frames.")
    products.write(table, lambda: None)


def _sizes(texts: list[str]) -> dict[str, float]:
    """Return sizes by the names of effects."""
    sizes = {}
    for name, value in named(texts, "--effect"):
        problem = f"--effect {name}={value} has no positive size; write plate_scale=1e-6."
        sizes[name] = parse_number(value, lambda size: 0 < size < math.inf, problem)
    return sizes
