"""``jitterkit simulate``: frames whose truth is known."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from jitterkit.cli import options
from jitterkit.cli.loci import build_locus, locus_sizes, other_sizes, parse_sizes, trace_of
from jitterkit.cli.runtime import prepare_jax, say

__all__ = ["simulate"]


def simulate(
    output: Annotated[
        Path,
        typer.Argument(
            metavar="FILE",
            help="FITS or TIFF by its ending; of several, each gets a number.",
            show_default=False,
        ),
    ],
    instrument: options.InstrumentName = "toliman",
    locus: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            help=f"Jitter: {', '.join(locus_sizes())}.",
        ),
    ] = "stable",
    length: Annotated[
        float | None,
        typer.Option(help="Full length, or peak to peak of a vibration, arcsec.", show_default=False),
    ] = None,
    sigma: Annotated[
        float | None, typer.Option(help="One sigma along the major axis, arcsec.", show_default=False)
    ] = None,
    shear: Annotated[
        float | None, typer.Option(help="1 - sigma_minor/sigma_major (mvn), 0 to 1.", show_default=False)
    ] = None,
    angle: Annotated[
        float | None,
        typer.Option(help="Axis of the jitter, degrees counter-clockwise from +x.", show_default=False),
    ] = None,
    sizes: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="SIZE=VALUE",
            help="Any other size of the locus: --set cycles=0.7 --set phase=30; places in arcsec: --set "
            f"knots=0:0,0.2:0.1,0.3:0.3. There are {other_sizes()}.",
            show_default=False,
        ),
    ] = None,
    trace: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.csv",
            help="A measured pointing in place of a locus: columns t,x,y in s and arcsec. Every frame gets "
            "the same exposure of it, the first; --set start=SECONDS for another.",
            show_default=False,
        ),
    ] = None,
    separation: Annotated[float, typer.Option(help="Separation, arcsec.")] = 10.0,
    theta: Annotated[
        float, typer.Option(help="Direction from A to B, degrees counter-clockwise from +x.")
    ] = 180.0,
    x: Annotated[float, typer.Option(help="Midpoint of the pair, arcsec from the frame's centre.")] = 0.0,
    y: Annotated[float, typer.Option(help="Likewise, upwards.")] = 0.0,
    flux: Annotated[
        float | None,
        typer.Option(
            help="Photons detected per frame from both stars; by default the instrument's.",
            show_default=False,
        ),
    ] = None,
    contrast: Annotated[float, typer.Option(help="Flux of A over flux of B.")] = 3.37,
    aberrations: Annotated[
        float, typer.Option(min=0, help="Rms of each aberration, drawn anew a frame, nm.")
    ] = 0.0,
    background: Annotated[float, typer.Option(help="Sky, electrons a pixel.")] = 0.0,
    scatter: Annotated[
        bool, typer.Option("--scatter", help="Draw theta, and x and y within 5 arcsec, anew for each frame.")
    ] = False,
    frames: Annotated[int, typer.Option(min=1, help="How many frames.")] = 1,
    seed: Annotated[int, typer.Option(min=0, help="Of the generator of every random draw.")] = 0,
    noise: Annotated[bool, typer.Option("--noise/--no-noise", help="Photon and read noise.")] = True,
    detector: Annotated[
        bool, typer.Option("--detector/--no-detector", help="Read out in ADU, or leave in electrons.")
    ] = True,
    overwrite: options.Overwrite = False,
) -> None:
    """Simulate frames and write them with their truth in the header."""
    paths = _paths(output, frames)
    _check_paths(paths, overwrite)
    prepare_jax()
    import numpy as np

    from jitterkit.frames import write_fits, write_tiff
    from jitterkit.instruments import load_instrument
    from jitterkit.scene import Binary
    from jitterkit.simulate import fits_header, simulate_sequence, tiff_metadata

    telescope = load_instrument(instrument)
    generator = np.random.default_rng(seed)
    given = {"length": length, "sigma_major": sigma, "shear": shear, "angle": angle}
    given = {name: value for name, value in given.items() if value is not None} | parse_sizes(sizes or [])
    jitter = build_locus(locus, given) if trace is None else trace_of(trace, telescope.exposure, locus, given)
    drawn: dict[str, Any] = {}
    if scatter:
        drawn = {
            "theta": generator.uniform(0, 360, frames),
            "x": x + generator.uniform(-5, 5, frames),
            "y": y + generator.uniform(-5, 5, frames),
        }
    photons = telescope.flux if flux is None else flux
    sequence = simulate_sequence(
        telescope,
        Binary(separation, theta, x, y, photons, contrast),
        jitter,
        frames,
        aberrations=aberrations * generator.standard_normal((frames, len(telescope.aberrations))),
        background=background,
        rng=generator if noise else None,
        detector=detector,
        **drawn,
    )
    for path, simulated in zip(paths, sequence, strict=True):
        if path.name.lower().endswith((".tif", ".tiff")):
            write_tiff(
                path,
                _stored(simulated.raw),
                metadata=tiff_metadata(simulated, seed=seed),
                overwrite=overwrite,
            )
        else:
            header = fits_header(simulated, telescope, seed=seed)
            write_fits(path, _stored(simulated.raw), header=header, overwrite=overwrite)
        say(f"wrote {path}")


def _paths(path: Path, frames: int) -> list[Path]:
    """The file of each frame: of several, each with its number."""
    if frames == 1:
        return [path]
    suffix = "".join(path.suffixes[-2:]) if path.suffix in (".gz", ".fz") else path.suffix
    stem, digits = path.name.removesuffix(suffix), len(str(frames - 1))
    return [path.with_name(f"{stem}-{index:0{digits}d}{suffix}") for index in range(frames)]


def _check_paths(paths: list[Path], overwrite: bool) -> None:
    """Refuse files that cannot be written."""
    from jitterkit.errors import ConfigurationError
    from jitterkit.frames.files import EXTENSIONS
    from jitterkit.report.outputs import check_file

    if not paths[0].name.lower().endswith(EXTENSIONS):
        raise ConfigurationError(f"{paths[0]} ends in none of {', '.join(EXTENSIONS)}; give it one of them.")
    for path in paths:
        check_file(path, overwrite)


def _stored(raw):
    """Pixels as a camera would store them: whole ADU in 16 bits."""
    import numpy as np

    data = raw.data
    whole = raw.unit == "adu" and np.all((data >= 0) & (data < 65536) & (data == np.round(data)))
    return data.astype(np.uint16) if whole else data
