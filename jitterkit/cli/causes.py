"""``jitterkit causes``: jitter, diffusion, defocus and seeing told apart, or not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from jitterkit.cli import options
from jitterkit.cli.loci import build_locus, parse_sizes
from jitterkit.cli.pair import pair_before
from jitterkit.cli.products import check_products, write_picture
from jitterkit.cli.quantities import parse_angle
from jitterkit.cli.runtime import command_line, prepare_jax, show_table

__all__ = ["causes"]

_USUAL = 0.3
"""Sigma in pixels, of a jitter and of a diffusion that nobody gives."""


def causes(
    instrument: options.InstrumentName = "toliman",
    locus: options.LocusName = "mvn",
    length: options.Length = None,
    sigma: options.Sigma = None,
    shear: options.Shear = None,
    angle: options.Angle = None,
    sizes: options.Sizes = None,
    diffusion: Annotated[
        str | None,
        typer.Option(
            metavar="0.3px|110mas",
            help=f"Charge diffusion, one sigma; by default the detector's, or {_USUAL:g}px; of a "
            "measured PSF what comes beyond it, by default none.",
            show_default=False,
        ),
    ] = None,
    seeing: Annotated[
        str | None,
        typer.Option(
            metavar="1.2arcsec",
            help="FWHM of a long exposure through the air; by default there is none.",
            show_default=False,
        ),
    ] = None,
    aberration: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=NM", help="Of the optics, several times for several: noll4=30.", show_default=False
        ),
    ] = None,
    target: Annotated[
        str,
        typer.Option(
            metavar="10%",
            help="Share of its size to which each cause is to be told; of a pixel where it has none.",
        ),
    ] = "10%",
    frames: Annotated[int, typer.Option(min=1, help="Further frames that might be taken.")] = 8,
    telemetry: Annotated[
        str, typer.Option(metavar="5%", help="What telemetry of the jitter's variances is good to.")
    ] = "5%",
    refocus: Annotated[
        float, typer.Option(min=1, help="Defocus on both sides that might be set, nm of noll4.")
    ] = 100.0,
    separation: options.Separation = 10.0,
    theta: options.Theta = 180.0,
    x: options.MiddleX = 0.0,
    y: options.MiddleY = 0.0,
    flux: options.Flux = None,
    contrast: options.Contrast = 3.37,
    background: options.Background = True,
    plot: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.png", help="Draw what each cause does, and how alike that is.", show_default=False
        ),
    ] = None,
    output: options.TableOutput = None,
    overwrite: options.Overwrite = False,
) -> None:
    """Tell what widens the image apart: jitter, charge diffusion, defocus and seeing.

    Prints the error of each cause in one frame, if the others were known and if none is; which of them the
    frame takes for each other; and the errors with further data, from the cheapest to the dearest, by the
    expected Fisher information. A cause is told where its error is below the target, not told where it is as
    large as the cause.
    """
    check_products(plot, output, overwrite)
    goal, known = _share(target, "--target"), _share(telemetry, "--telemetry")
    given = {"length": length, "sigma_major": sigma, "shear": shear, "angle": angle}
    given = {name: value for name, value in given.items() if value is not None} | parse_sizes(sizes or [])
    prepare_jax()
    from jitterkit.forecast.causes import tell_causes
    from jitterkit.forecast.causes_data import Offer, further_data
    from jitterkit.instruments import load_instrument
    from jitterkit.report.causes_plots import plot_causes
    from jitterkit.report.causes_text import causes_sentences, causes_table, data_table, remedy_sentence
    from jitterkit.report.table import write_table

    telescope = load_instrument(instrument)
    if locus == "mvn" and "sigma_major" not in given:
        given["sigma_major"] = _USUAL * telescope.plate_scale
    scene = pair_before(telescope, flux, separation=separation, theta=theta, x=x, y=y, contrast=contrast)
    jitter = build_locus(locus, given)
    setting = _setting(telescope, scene, jitter, diffusion, seeing, aberration or [])
    if not background:
        setting = replace(setting, hold=("background",))
    found = tell_causes(setting, jitter)
    sets = further_data(found, Offer(frames=frames, telemetry=known, diversity=refocus))
    table, remedy = data_table(found, sets), remedy_sentence(found, sets, goal)
    words = causes_sentences(found)
    show_table(causes_table(found, goal), align="<")
    typer.echo("\n".join(["", *words, ""]))
    show_table(table, align="<")
    typer.echo(f"\n{remedy}")
    if output is not None:
        table.meta |= {"command": command_line(), "confusions": words, "remedy": remedy}
        write_table(output, table, overwrite=overwrite)
    if plot is not None:
        write_picture(plot, plot_causes(found).axes[0], overwrite)


def _setting(telescope, scene, jitter, diffusion: str | None, seeing: str | None, aberrations: list[str]):
    from jitterkit.forecast.causes_frame import Setting
    from jitterkit.optics import OpticalSystem
    from jitterkit.scene import Binary
    from jitterkit.simulate import check_reach, check_scene

    pair, optics, own = Binary(**scene), telescope.system(), telescope.detector.diffusion
    usual = 0.0
    if isinstance(optics, OpticalSystem):  # what is asked about is a parameter, not the optics'
        optics, usual = replace(optics, diffusion=0.0), _USUAL if own is None else own
    check_scene(pair, jitter)
    check_reach(pair, jitter, optics.nominal)
    state, scale = _aberrations(aberrations, telescope.aberrations), telescope.plate_scale
    sigma = usual * scale if diffusion is None else _sigma(diffusion, scale)
    fwhm = None if seeing is None else parse_angle(seeing, "--seeing")
    return Setting(pair, optics, telescope.detector, state, sigma**2, fwhm)


def _sigma(text: str, plate_scale: float) -> float:
    """Diffusion in arcsec, from pixels or an angle."""
    from jitterkit.errors import ConfigurationError, ErrorCode

    number = text.strip().removesuffix("px").removesuffix("pix")
    if number == text.strip():
        return parse_angle(text, "--diffusion")
    code = ErrorCode.OUT_OF_RANGE
    try:
        pixels = float(number)
    except ValueError:
        code, pixels = ErrorCode.MALFORMED, -1.0
    if not 0 <= pixels < float("inf"):
        raise ConfigurationError(
            code, f"--diffusion {text} is not a size in pixels; write 0.3px, or an angle."
        )
    return pixels * plate_scale


def _aberrations(texts: list[str], names: tuple[str, ...]) -> tuple[float, ...]:
    from jitterkit.errors import ConfigurationError, ErrorCode

    values = dict.fromkeys(names, 0.0)
    for text in texts:
        name, _, value = text.partition("=")
        if name.strip() not in values:
            there = f"there are {', '.join(names)}" if names else "a measured PSF has none"
            raise ConfigurationError(
                ErrorCode.UNKNOWN_NAME, f"The optics have no aberration {name.strip()!r}; {there}."
            )
        code = ErrorCode.OUT_OF_RANGE
        try:
            values[name.strip()] = float(value)
        except ValueError:
            code, values[name.strip()] = ErrorCode.MALFORMED, float("nan")
        if not abs(values[name.strip()]) < float("inf"):
            raise ConfigurationError(code, f"--aberration {text} is not understood; write noll4=30.")
    return tuple(values.values())


def _share(text: str, option: str) -> float:
    from jitterkit.errors import ConfigurationError, ErrorCode

    code = ErrorCode.OUT_OF_RANGE if text.strip().endswith("%") else ErrorCode.MALFORMED
    try:
        share = float(text.strip().removesuffix("%")) / 100
    except ValueError:
        code, share = ErrorCode.MALFORMED, 0.0
    if not 0 < share < float("inf") or not text.strip().endswith("%"):
        raise ConfigurationError(code, f"{option} {text} is not a positive share; write 10%.")
    return share
