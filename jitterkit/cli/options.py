"""Options that several commands share, worded once."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from jitterkit.cli.loci import locus_sizes, other_sizes

__all__ = [
    "Angle",
    "Background",
    "BadBits",
    "Bias",
    "Censored",
    "Contrast",
    "Device",
    "Exposure",
    "Files",
    "Float32",
    "Flux",
    "Gain",
    "Hdu",
    "InstrumentName",
    "Length",
    "LocusName",
    "MiddleX",
    "MiddleY",
    "Overwrite",
    "PlateScale",
    "ReadNoise",
    "Saturation",
    "SceneName",
    "Separation",
    "Shear",
    "Sigma",
    "Sizes",
    "SpectrumKind",
    "TableOutput",
    "Theta",
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
Device = Annotated[
    str | None,
    typer.Option(
        metavar="cpu|gpu", help="Where to compute; by default on a GPU if JAX finds one.", show_default=False
    ),
]
Float32 = Annotated[
    bool,
    typer.Option("--float32", help="Compute in 32 bits, where speed matters more than the last digits."),
]
SceneName = Annotated[
    str,
    typer.Option(
        "--scene",
        metavar="auto|star|binary|stars",
        help="What the frames show: auto is the simplest scene that they support.",
    ),
]
Background = Annotated[
    bool,
    typer.Option(
        "--background/--no-background",
        help="Fit a constant background; held at zero, sky of 1 e-/pixel biases a separation by 43 µas.",
    ),
]
Censored = Annotated[
    bool,
    typer.Option(
        "--censored",
        help="Count pixels at saturation as holding at least so much, instead of leaving out all that come "
        "near it: costs nothing of the error, and asks that the response is linear up to there.",
    ),
]
Gain = Annotated[float | None, typer.Option(help="Gain, e-/ADU.", show_default=False)]
ReadNoise = Annotated[float | None, typer.Option(help="Read noise, e-.", show_default=False)]
Bias = Annotated[float | None, typer.Option(help="Bias level, ADU.", show_default=False)]
Saturation = Annotated[float | None, typer.Option(help="Saturation level, ADU.", show_default=False)]
BadBits = Annotated[
    int | None,
    typer.Option(
        min=0,
        metavar="SUM",
        help="Bits of a DQ or MASK extension that mask a pixel, their values added up; 0 for none. By "
        "default those that the observatory calls bad.",
        show_default=False,
    ),
]
PlateScale = Annotated[float | None, typer.Option(help="Plate scale, arcsec/pixel.", show_default=False)]
Exposure = Annotated[float | None, typer.Option(help="Exposure time, s.", show_default=False)]
TableOutput = Annotated[
    Path | None,
    typer.Option(
        "--output",
        "-o",
        metavar="FILE.ecsv",
        help="Also write the table; the name ends in .ecsv, .csv, .fits, .parquet or .json.",
        show_default=False,
    ),
]

SpectrumKind = Annotated[
    str | None,
    typer.Option(
        "--kind",
        metavar="bins|curve",
        help="What the rows of a spectrum are: bins of a measured one, such as Welch's, that hold power, "
        "or points of a drawn curve, with power laws between them. By default their spacing tells.",
        show_default=False,
    ),
]

# a jitter, by its name and sizes
LocusName = Annotated[
    str, typer.Option("--locus", metavar="NAME", help=f"Jitter: {', '.join(locus_sizes())}.")
]
Length = Annotated[
    float | None,
    typer.Option(help="Full length, or peak to peak of a vibration, arcsec.", show_default=False),
]
Sigma = Annotated[
    float | None, typer.Option(help="One sigma along the major axis, arcsec.", show_default=False)
]
Shear = Annotated[
    float | None, typer.Option(help="1 - sigma_minor/sigma_major (mvn), 0 to 1.", show_default=False)
]
Angle = Annotated[
    float | None,
    typer.Option(help="Axis of the jitter, degrees counter-clockwise from +x.", show_default=False),
]
Sizes = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="SIZE=VALUE",
        help="Any other size of the locus: --set cycles=0.7 --set phase=30; places in arcsec: --set "
        f"knots=0:0,0.2:0.1,0.3:0.3. There are {other_sizes()}.",
        show_default=False,
    ),
]

# a binary
Separation = Annotated[float, typer.Option(help="Separation, arcsec.")]
Theta = Annotated[float, typer.Option(help="Direction from A to B, degrees counter-clockwise from +x.")]
MiddleX = Annotated[float, typer.Option(help="Midpoint of the pair, arcsec from the frame's centre.")]
MiddleY = Annotated[float, typer.Option(help="Likewise, upwards.")]
Flux = Annotated[
    float | None,
    typer.Option(
        help="Photons detected per frame from both stars; by default the instrument's.", show_default=False
    ),
]
Contrast = Annotated[float, typer.Option(help="Flux of A over flux of B.")]


def overrides(
    gain: float | None,
    read_noise: float | None,
    bias: float | None,
    saturation: float | None,
    plate_scale: float | None,
    exposure: float | None,
    bad_bits: int | None,
) -> dict[str, Any]:
    """Metadata given on the command line; what was not given is left out."""
    given = {
        "gain": gain,
        "read_noise": read_noise,
        "bias": bias,
        "saturation": saturation,
        "plate_scale": plate_scale,
        "exposure": exposure,
        "bad_bits": bad_bits,
    }
    return {name: value for name, value in given.items() if value is not None}
