"""Write an instrument file of a PSF or a pupil of poppy or stpsf: ``jitterkit instrument``."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import typer

from jitterkit.cli.runtime import log, prepare_jax


@dataclass(frozen=True, kw_only=True)
class Contents:
    """Give what a file of a PSF or a pupil does not hold.

    Parameters
    ----------
    kind : psf|pupil
        Kind of the file; by default its header decides.
    plate_scale
        Plate scale, arcsec per detector pixel; a pupil always needs it.
    shape : ROWS COLUMNS
        Pixels that are fitted; by default half of a PSF's height and width.
    centre : X Y
        Optical axis of a PSF, in samples from the first; by default the middle of the array.
    jittered
        Accept a PSF that contains jitter; fits then measure the jitter beyond it.
    band : LOW HIGH
        Flat band of a pupil, nm.
    wavelength
        Single wavelength of a pupil, nm.
    opd : FILE.fits
        File of a pupil's wavefront error.
    opd_unit
        Unit of the wavefront error, if BUNIT does not give it.
    plane
        Plane of a cube of wavefront errors, from 0.
    diameter
        Width of a pupil's array, m, if its header does not give it.
    noll
        Aberration of a pupil that may vary, by Noll's number; repeat the option for several.
    """

    kind: str | None = None
    plate_scale: float | None = None
    shape: tuple[int, int] | None = None
    hdu: int | None = None
    centre: tuple[float, float] | None = None
    jittered: bool = False
    band: tuple[float, float] | None = None
    wavelength: float | None = None
    opd: Path | None = None
    opd_unit: str | None = None
    plane: int | None = None
    diameter: float | None = None
    noll: list[int] | None = None


def instrument(
    *,
    file: Annotated[Path, typer.Argument()],
    output: Annotated[Path, typer.Option("--output", "-o")],
    contents: Contents,
    overwrite: bool = False,
) -> None:
    """Write an instrument file of a PSF or a pupil in FITS.

    If the file lacks a value, the error message names the option that gives it.

    Parameters
    ----------
    file : FILE.fits
        A PSF or a pupil that poppy, webbpsf or stpsf wrote.
    output : FILE.toml
        The instrument file.
    """
    prepare_jax()
    from jitterkit.instruments import instrument_from_fits

    given = asdict(contents) | {"noll": contents.noll or ()}
    for remark in instrument_from_fits(file, output, overwrite=overwrite, **given):
        log(remark)
