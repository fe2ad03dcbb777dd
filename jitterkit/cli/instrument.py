"""``jitterkit instrument``: a PSF or a pupil of poppy or stpsf as an instrument file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from jitterkit.cli import options
from jitterkit.cli.runtime import prepare_jax, say

__all__ = ["instrument"]


def instrument(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE.fits",
            help="A PSF or a pupil that poppy, webbpsf or stpsf wrote.",
            show_default=False,
        ),
    ],
    output: Annotated[
        Path,
        typer.Option("--output", "-o", metavar="FILE.toml", help="The instrument file.", show_default=False),
    ],
    kind: Annotated[
        str | None,
        typer.Option(metavar="psf|pupil", help="What the file holds; its header tells.", show_default=False),
    ] = None,
    plate_scale: Annotated[
        float | None,
        typer.Option(help="arcsec per detector pixel; a pupil never tells it.", show_default=False),
    ] = None,
    shape: Annotated[
        tuple[int, int] | None,
        typer.Option(
            metavar="ROWS COLUMNS",
            help="Pixels that are fitted; half of a PSF's width and height by default.",
            show_default=False,
        ),
    ] = None,
    hdu: options.Hdu = None,
    centre: Annotated[
        tuple[float, float] | None,
        typer.Option(
            metavar="X Y",
            help="Of a PSF: its optical axis, in samples from the first; by default the middle of the array.",
            show_default=False,
        ),
    ] = None,
    jittered: Annotated[
        bool,
        typer.Option("--jittered", help="Take a PSF that holds jitter already; fits find what is beyond it."),
    ] = False,
    band: Annotated[
        tuple[float, float] | None,
        typer.Option(metavar="LOW HIGH", help="Of a pupil: flat band, nm.", show_default=False),
    ] = None,
    wavelength: Annotated[
        float | None, typer.Option(help="Of a pupil: one wavelength, nm.", show_default=False)
    ] = None,
    opd: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.fits", help="Of a pupil: the file of its wavefront error.", show_default=False
        ),
    ] = None,
    opd_unit: Annotated[
        str | None,
        typer.Option(help="Unit of the wavefront error where BUNIT does not tell.", show_default=False),
    ] = None,
    plane: Annotated[
        int | None, typer.Option(help="Of a cube of wavefront errors, from 0.", show_default=False)
    ] = None,
    diameter: Annotated[
        float | None,
        typer.Option(help="Width of a pupil's array, m, where its header does not tell.", show_default=False),
    ] = None,
    noll: Annotated[
        list[int] | None,
        typer.Option(
            help="Of a pupil: an aberration that may vary, by Noll's number; repeat it.", show_default=False
        ),
    ] = None,
    overwrite: options.Overwrite = False,
) -> None:
    """Write an instrument file of a PSF or a pupil in FITS.

    What the file does not tell is asked for by the name of an option.
    """
    prepare_jax()
    from jitterkit.instruments import instrument_from_fits

    remarks = instrument_from_fits(
        file,
        output,
        kind=kind,
        plate_scale=plate_scale,
        shape=shape,
        hdu=hdu,
        centre=centre,
        jittered=jittered,
        band=band,
        wavelength=wavelength,
        opd=opd,
        opd_unit=opd_unit,
        plane=plane,
        diameter=diameter,
        noll=noll or (),
        overwrite=overwrite,
    )
    for remark in remarks:
        say(remark)
