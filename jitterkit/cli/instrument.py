"""``jitterkit instrument``: a PSF or a pupil of poppy or stpsf as an instrument file."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import typer

from jitterkit.cli import options
from jitterkit.cli.runtime import log, prepare_jax

__all__ = ["instrument"]


@dataclass(frozen=True, kw_only=True)
class Contents:
    """Say about a file of a PSF or a pupil what it does not hold itself.

    Parameters
    ----------
    kind : psf|pupil
        What the file holds; its header tells.
    plate_scale
        arcsec per detector pixel; a pupil never tells it.
    shape : ROWS COLUMNS
        Pixels that are fitted; half of a PSF's width and height by default.
    centre : X Y
        Of a PSF: its optical axis, in samples from the first; by default the middle of the array.
    jittered
        Take a PSF that holds jitter already; fits find what is beyond it.
    band : LOW HIGH
        Of a pupil: flat band, nm.
    wavelength
        Of a pupil: one wavelength, nm.
    opd : FILE.fits
        Of a pupil: the file of its wavefront error.
    opd_unit
        Unit of the wavefront error where BUNIT does not tell.
    plane
        Of a cube of wavefront errors, from 0.
    diameter
        Width of a pupil's array, m, where its header does not tell.
    noll
        Of a pupil: an aberration that may vary, by Noll's number; repeat it.
    """

    kind: str | None = None
    plate_scale: float | None = None
    shape: tuple[int, int] | None = None
    hdu: options.Hdu = None
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
    overwrite: options.Overwrite = False,
) -> None:
    """Write an instrument file of a PSF or a pupil in FITS.

    What the file does not tell is asked for by the name of an option.

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
