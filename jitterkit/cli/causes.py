"""Distinguish jitter, diffusion, defocus and seeing: ``jitterkit causes``."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Annotated

import typer

from jitterkit.cli import options
from jitterkit.cli.command import Default
from jitterkit.cli.loci import build_locus
from jitterkit.cli.quantities import named, parse_angle, parse_number, parse_share
from jitterkit.cli.runtime import dark_exposure, open_instrument, print_table
from jitterkit.errors import ErrorCode, refuse_if

_USUAL = 0.3
"""Sigma in pixels, of a jitter and of a diffusion that are not given."""


def causes(
    *,
    instrument: options.InstrumentName = "toliman",
    jitter: Annotated[options.Jitter, Default(locus="mvn")],
    diffusion: str | None = None,
    seeing: str | None = None,
    aberration: list[str] | None = None,
    target: str = "10%",
    frames: Annotated[int, typer.Option(min=1)] = 8,
    telemetry: str = "5%",
    refocus: Annotated[float, typer.Option(min=1)] = 100.0,
    pair: options.Pair,
    background: bool = True,
    products: options.Products,
) -> None:
    """Distinguish the causes of a wide image: jitter, charge diffusion, defocus and seeing.

    Prints the error of each cause in one frame, if the others are known and if none is; which of them one
    frame cannot distinguish; and the errors with further data, from the cheapest to the most expensive, by
    the expected Fisher information. A cause is determined where its error is below the target, and
    undetermined where it is as large as the cause.

    Parameters
    ----------
    diffusion : 0.3px|110mas
        Charge diffusion, one sigma; by default the detector's, or 0.3px; for a measured PSF the diffusion
        beyond it, by default none.
    seeing : 1.2arcsec
        FWHM of a long exposure through the air; by default there is none.
    aberration : NAME=NM
        Aberration of the optics, nm; repeat the option for several: noll4=30.
    target : 10%
        Required error of each cause, as a share of its size, or of a pixel if its size is zero.
    frames
        Number of further frames that could be taken.
    telemetry : 5%
        Error of telemetry of the jitter's variances.
    refocus
        Defocus on both sides that could be set, nm of noll4.
    plot : FILE.png
        Draw the effect of each cause, and their similarity.
    """
    products.check()
    goal, known = _share(target, "--target"), _share(telemetry, "--telemetry")
    sizes = jitter.size_values()
    telescope = open_instrument(instrument)
    from jitterkit.forecast.causes import forecast_causes
    from jitterkit.forecast.causes_data import FollowUp, further_data
    from jitterkit.report import causes_plots as report

    if jitter.locus == "mvn":
        sizes = {"sigma_major": _USUAL * telescope.plate_scale} | sizes
    locus = build_locus(jitter.locus, sizes)
    setting = _setting(telescope, pair.parameters(telescope), locus, diffusion, seeing, aberration or [])
    found = forecast_causes(replace(setting, hold=options.held(background)), locus)
    sets = further_data(found, FollowUp(frames=frames, telemetry=known, diversity=refocus))
    table, remedy = report.data_table(found, sets), report.remedy_sentence(found, sets, goal)
    sentences = report.causes_sentences(found)
    print_table(report.causes_table(found, goal), align="<")
    typer.echo("\n".join(["", *sentences, ""]))
    print_table(table, align="<")
    typer.echo(f"\n{remedy}")
    table.meta |= {"confusions": sentences, "remedy": remedy}
    products.write(table, lambda: report.plot_causes(found).axes[0])


def _setting(telescope, scene, jitter, diffusion: str | None, seeing: str | None, aberrations: list[str]):
    from jitterkit.forecast.causes_frame import Setting
    from jitterkit.optics import OpticalSystem
    from jitterkit.scene import Binary
    from jitterkit.simulate import check_reach, check_scene

    pair, optics, own = Binary(**scene), telescope.system(), telescope.detector.diffusion
    usual = 0.0
    if isinstance(optics, OpticalSystem):  # diffusion is a parameter here, not part of the optics
        optics, usual = replace(optics, diffusion=0.0), _USUAL if own is None else own
    check_scene(pair, jitter)
    check_reach(pair, jitter, optics.nominal)
    state, scale = _aberrations(aberrations, telescope.aberrations), telescope.plate_scale
    sigma = usual * scale if diffusion is None else _sigma(diffusion, scale)
    fwhm = None if seeing is None else parse_angle(seeing, "--seeing")
    dark = dark_exposure(telescope)
    return Setting(pair, optics, telescope.detector, state, sigma**2, fwhm, exposure=dark)


def _sigma(text: str, plate_scale: float) -> float:
    """Return the diffusion in arcsec, from pixels or an angle."""
    number = text.strip().removesuffix("px").removesuffix("pix")
    if number == text.strip():
        return parse_angle(text, "--diffusion")
    problem = f"--diffusion {text} is not a size in pixels; write 0.3px, or an angle."
    return parse_number(number, lambda pixels: 0 <= pixels < float("inf"), problem) * plate_scale


def _aberrations(texts: list[str], names: tuple[str, ...]) -> tuple[float, ...]:
    """Return all aberrations of the optics [nm], with those that are given as ``noll4=30``."""
    values = dict.fromkeys(names, 0.0)
    for name, value in named(texts, "--aberration"):
        known = f"there are {', '.join(names)}" if names else "a measured PSF has none"
        problem = f"The optics have no aberration {name!r}; {known}."
        refuse_if(name not in values, ErrorCode.UNKNOWN_NAME, problem)
        problem = f"--aberration {name}={value} is not understood; write noll4=30."
        values[name] = parse_number(value, math.isfinite, problem)
    return tuple(values.values())


def _share(text: str, option: str) -> float:
    return parse_share(text, f"{option} {text} is not a positive share; write 10%.")
