"""Options that several commands share, worded once."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

__all__ = [
    "Background",
    "Bias",
    "Exposure",
    "Files",
    "Gain",
    "Hdu",
    "InstrumentName",
    "Overwrite",
    "PlateScale",
    "ReadNoise",
    "Saturation",
    "overrides",
]

Files = Annotated[
    list[Path],
    typer.Argument(
        metavar="FILES_OR_DIRS", help="FITS or TIFF files, or directories of them.", show_default=False
    ),
]
InstrumentName = Annotated[
    str, typer.Option("--instrument", "-i", metavar="NAME|FILE.toml", help="A preset, or an instrument file.")
]
Hdu = Annotated[
    int | None,
    typer.Option(help="HDU to read; by default the first that holds an image.", show_default=False),
]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace files that exist.")]
Background = Annotated[
    bool, typer.Option("--background", help="Fit a constant background too, for frames with sky.")
]
Gain = Annotated[float | None, typer.Option(help="Gain, e-/ADU.", show_default=False)]
ReadNoise = Annotated[float | None, typer.Option(help="Read noise, e-.", show_default=False)]
Bias = Annotated[float | None, typer.Option(help="Bias level, ADU.", show_default=False)]
Saturation = Annotated[float | None, typer.Option(help="Saturation level, ADU.", show_default=False)]
PlateScale = Annotated[float | None, typer.Option(help="Plate scale, arcsec/pixel.", show_default=False)]
Exposure = Annotated[float | None, typer.Option(help="Exposure time, s.", show_default=False)]


def overrides(
    gain: float | None,
    read_noise: float | None,
    bias: float | None,
    saturation: float | None,
    plate_scale: float | None,
    exposure: float | None,
) -> dict[str, Any]:
    """Metadata given on the command line; what was not given is left out."""
    given = {
        "gain": gain,
        "read_noise": read_noise,
        "bias": bias,
        "saturation": saturation,
        "plate_scale": plate_scale,
        "exposure": exposure,
    }
    return {name: value for name, value in given.items() if value is not None}
