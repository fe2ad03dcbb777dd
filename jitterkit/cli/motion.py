"""Assess a pointing trace or a spectrum for an exposure: ``jitterkit motion``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from jitterkit.cli import options
from jitterkit.cli.runtime import log, open_instrument, print_table

if TYPE_CHECKING:
    from astropy.table import QTable

    from jitterkit.instruments import Instrument
    from jitterkit.loci import Locus


_MOMENTS = ("_sxx", "_sxy", "_syy")
"""Endings of columns that are written to the file, not printed."""

_SEPARATION, _CONTRAST = 10.0, 3.37
"""Of the pair whose separation is forecast, arcsec: those of ``simulate``."""


def motion(
    *,
    file: Annotated[Path, typer.Argument()],
    instrument: options.InstrumentName = "toliman",
    exposure: float | None = None,
    cadence: float | None = None,
    bandwidth: float | None = None,
    kind: str | None = None,
    rates: str | None = None,
    loss: bool = True,
    products: options.Products,
) -> None:
    """Report the effect of a motion on an exposure: displacement, smear, jitter, regime, locus, and the cost.

    Prints the budget, a row per source of motion: one sigma along x and y of the mean pointing from frame to
    frame (displacement), of the straight motion within a frame (smear; its length is √12 times that) and of
    the rest (jitter). Then the predicted error of the separation of a pair of 10 arcsec, once along the blur
    and once across it, without the motion and with it, and how much more time the same precision takes; at
    the instrument's usual flux per frame, for every exposure.

    Parameters
    ----------
    file : FILE.csv
        A spectrum: columns f,x,y[,xy] in Hz and arcsec²/Hz (one-sided); lines:
        frequency,amplitude,angle[,minor] in Hz, arcsec (zero to peak) and degrees; both, one below the
        other; or a pointing trace t,x,y in s and arcsec, or rates t,wx,wy in arcsec/s. The header may give
        other units: x [mas].
    exposure
        Exposure time, s; by default the instrument's.
    cadence
        Time from the start of one frame to the start of the next, s, for the motion between frames; by
        default the exposure.
    bandwidth : HZ
        Bandwidth of a pointing loop (a fine tip/tilt stage), which removes slower motion: a first-order
        integrator leaves f²/(f²+bandwidth²) of the power.
    rates : UNIT
        Unit of the rates in a trace whose header does not give it, such as deg/s; they are integrated.
    loss
        Forecast what the blur costs the separation; needs the instrument's optics and flux.
    plot : FILE.png
        Draw spectrum, budget, predicted blur and its transfer function.
    """
    products.check()
    telescope = open_instrument(instrument)
    from jitterkit.motion import assess_motion, read_motion
    from jitterkit.report.motion_table import motion_sentences, motion_table

    moved = read_motion(file, kind=kind, rates=rates, log=log)
    seconds = options.required(telescope, "exposure; give --exposure", exposure, telescope.exposure)
    assessed = assess_motion(moved, seconds, cadence=cadence, bandwidth=bandwidth)
    for sentence in motion_sentences(assessed, telescope.plate_scale):
        log(sentence)
    table = motion_table(assessed)
    _print(table[[name for name in table.colnames if not name.endswith(_MOMENTS)]])
    if loss and telescope.flux is None:
        problem = f"What the blur costs is not forecast: the instrument {telescope.name!r} has no flux"
        log(f"{problem}; give it photons per frame in its file.")
    elif loss:
        costs = _loss_table(telescope, assessed.locus, seconds)
        typer.echo()
        _print(costs)
        table.meta["loss"] = {name: costs[name].value.tolist() for name in costs.colnames}

    def draw():
        from jitterkit.report.motion_plots import plot_motion

        return plot_motion(assessed, f"{file.name}, exposures of {assessed.exposure:g} s")[0]

    products.write(table, draw)


def _print(table: QTable) -> None:
    for name in table.colnames:
        if table[name].dtype.kind == "f" and table[name].info.format is None:
            table[name].info.format = "{:.4g}"
    print_table(table)


def _loss_table(telescope: Instrument, locus: Locus, exposure: float) -> QTable:
    """Errors of the separation of a pair along the blur and across it, without the blur and with it.

    The shape of the blur is taken for known, and three moments on top of it are free, as in a fit.
    """
    import jax.numpy as jnp

    from jitterkit.conventions import direction_angle
    from jitterkit.forecast import forecast
    from jitterkit.forward import Parameters
    from jitterkit.loci import Mvn, Product, Stable, principal_axes
    from jitterkit.refit import FitOptions
    from jitterkit.report.columns import Column, bind_rows
    from jitterkit.scene import Binary

    blurred = Product(locus, Mvn(jnp.zeros(3)))
    known = FitOptions(hold=blurred.names[:-3])
    otf, aberrations = telescope.optics(), jnp.zeros(len(telescope.aberrations))
    rows = []
    for turn in (0.0, 90.0):
        theta = direction_angle(principal_axes(locus.moments())[2] + turn)
        scene = Binary(_SEPARATION, theta, 0.0, 0.0, telescope.flux, _CONTRAST)
        still = Parameters(scene, Stable.of(), aberrations)
        sharp = forecast(still, otf, telescope.detector, exposure=exposure)
        moving = Parameters(scene, blurred, aberrations)
        shaken = forecast(moving, otf, telescope.detector, known, exposure=exposure)
        errors = [forecasted.error("separation") * 1e6 for forecasted in (sharp, shaken)]
        rows.append((theta, *errors, (errors[1] / errors[0]) ** 2 - 1))
    columns = (
        Column("theta", unit="deg", format="{:.1f}"),
        Column("error_without", unit="uas", format="{:.1f}"),
        Column("error_with", unit="uas", format="{:.1f}"),
        Column("more_time", format="{:.2%}"),
    )
    return bind_rows(columns, rows)
