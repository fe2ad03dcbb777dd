"""``jitterkit simulate``: frames whose truth is known."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from jitterkit.cli import options
from jitterkit.cli.loci import build_locus, parse_sizes, size_option
from jitterkit.cli.pair import OF_PAIRS, refuse_unused
from jitterkit.cli.pointing import drifting, resting, shaken, traced
from jitterkit.cli.runtime import prepare_jax, say

__all__ = ["simulate"]


_SCENES = {"star": OF_PAIRS, "binary": (), "stars": (*OF_PAIRS, "flux")}
"""Scenes, and the options that each has no use for."""


def simulate(
    context: typer.Context,
    output: Annotated[
        Path,
        typer.Argument(
            metavar="FILE",
            help="FITS or TIFF by its ending; of several, each gets a number.",
            show_default=False,
        ),
    ],
    instrument: options.InstrumentName = "toliman",
    locus: options.LocusName = "stable",
    length: options.Length = None,
    sigma: options.Sigma = None,
    shear: options.Shear = None,
    angle: options.Angle = None,
    sizes: options.Sizes = None,
    trace: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.csv",
            help="A measured pointing in place of a locus: columns t,x,y in s and arcsec. Every frame gets "
            "the same exposure of it, the first; --set start=SECONDS for another.",
            show_default=False,
        ),
    ] = None,
    spectrum: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.csv",
            help="A spectrum of the motion in place of a locus: columns f,x,y[,xy] in Hz and arcsec²/Hz, or "
            "lines frequency,amplitude,angle[,minor] in Hz, arcsec and degrees. Of one motion drawn from it "
            "every frame gets a piece of its own, and stands where that is.",
            show_default=False,
        ),
    ] = None,
    kind: options.SpectrumKind = None,
    drift: Annotated[
        str | None,
        typer.Option(
            metavar="VX,VY",
            help="A uniform drift beside the locus, arcsec/s. The frames follow each other without a gap: "
            "each is smeared by speed times exposure, and the pair moves on; --x and --y are its middle.",
            show_default=False,
        ),
    ] = None,
    scene: Annotated[
        str,
        typer.Option(
            metavar="star|binary|stars",
            help="One star, at --x and --y, a pair, or the stars of --stars, moved by --x and --y.",
        ),
    ] = "binary",
    stars: Annotated[
        Path | None,
        typer.Option(
            metavar="TABLE",
            help="Table (ECSV or CSV) with columns x, y (arcsec from the centre) and flux (electrons): the "
            "stars of --scene stars, or further stars beside another scene.",
            show_default=False,
        ),
    ] = None,
    separation: options.Separation = 10.0,
    theta: options.Theta = 180.0,
    x: options.MiddleX = 0.0,
    y: options.MiddleY = 0.0,
    flux: options.Flux = None,
    contrast: options.Contrast = 3.37,
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
    """Simulate frames and write them with their truth in the header.

    Where the detector rolls, its rows are exposed one after the other to a drift, a trace or a spectrum.
    """
    paths = _paths(output, frames)
    _check_paths(paths, overwrite)
    prepare_jax()
    import numpy as np

    from jitterkit.errors import ConfigurationError, ErrorCode
    from jitterkit.frames import write_fits, write_tiff
    from jitterkit.instruments import load_instrument
    from jitterkit.scene import Binary, FurtherStars, Star
    from jitterkit.simulate import fits_header, read_stars, simulate_sequence, tiff_metadata

    refuse_unused(scene, _SCENES, context)
    if scene == "stars" and stars is None:
        raise ConfigurationError(ErrorCode.MISSING_VALUE, "--scene stars needs their table: give --stars.")
    telescope = load_instrument(instrument)
    generator = np.random.default_rng(seed)
    given = {"length": length, "sigma_major": sigma, "shear": shear, "angle": angle}
    given = {name: value for name, value in given.items() if value is not None} | parse_sizes(sizes or [])
    tiff = output.name.lower().endswith((".tif", ".tiff"))
    row_order = -1 if tiff else 1
    if spectrum is not None:
        _check_alone("--spectrum", given, locus, **{"--trace": trace, "--drift": drift})
        pointing = shaken(spectrum, telescope, frames, row_order, generator, kind)
    elif trace is not None:
        _check_alone("--trace", {}, "stable", **{"--drift": drift})
        pointing = traced(trace, telescope, locus, given, row_order)
    elif drift is not None:
        pointing = drifting(drift, telescope, build_locus(locus, given), frames)
    else:
        pointing = resting(build_locus(locus, given), locus, telescope.detector)
    drawn: dict[str, Any] = {}
    if pointing.places is not None:
        drawn = {"x": x + pointing.places[:, 0], "y": y + pointing.places[:, 1]}
    if scatter:
        drawn = ({"theta": generator.uniform(0, 360, frames)} if scene == "binary" else {}) | {
            "x": drawn.get("x", x) + generator.uniform(-5, 5, frames),
            "y": drawn.get("y", y) + generator.uniform(-5, 5, frames),
        }
    place = {"x": x, "y": y, "flux": telescope.flux if flux is None else flux}
    lamps: Any
    if scene == "stars":
        assert stars is not None
        lamps = read_stars(stars).shifted(x, y)
    else:
        pair = {"separation": separation, "theta": theta, "contrast": contrast}
        lamps = Binary(**pair, **place) if scene == "binary" else Star(**place)
        lamps = lamps if stars is None else lamps.joined(FurtherStars(*read_stars(stars).sources()))
    sequence = simulate_sequence(
        telescope,
        lamps,
        pointing.loci,
        frames,
        aberrations=aberrations * generator.standard_normal((frames, len(telescope.aberrations))),
        background=background,
        velocity=pointing.velocity,
        shutter=pointing.shutters,
        row_order=row_order,
        rng=generator if noise else None,
        detector=detector,
        **drawn,
    )
    for path, simulated in zip(paths, sequence, strict=True):
        if tiff:
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


def _check_alone(option: str, sizes: dict[str, Any], locus: str, **motions: Any) -> None:
    """Refuse another motion beside a measured or a drawn one."""
    from jitterkit.errors import ConfigurationError, ErrorCode

    others = [name for name, motion in motions.items() if motion is not None]
    others += ["--locus"] if locus != "stable" else []
    others += [size_option(size) for size in sizes]
    if others:
        raise ConfigurationError(
            ErrorCode.CONFLICT, f"A {option} takes the place of a locus; leave out {others[0]}."
        )


def _paths(path: Path, frames: int) -> list[Path]:
    """The file of each frame: of several, each with its number."""
    if frames == 1:
        return [path]
    suffix = "".join(path.suffixes[-2:]) if path.suffix in (".gz", ".fz") else path.suffix
    stem, digits = path.name.removesuffix(suffix), len(str(frames - 1))
    return [path.with_name(f"{stem}-{index:0{digits}d}{suffix}") for index in range(frames)]


def _check_paths(paths: list[Path], overwrite: bool) -> None:
    """Refuse files that cannot be written."""
    from jitterkit.errors import ConfigurationError, ErrorCode
    from jitterkit.frames.files import EXTENSIONS
    from jitterkit.report.outputs import check_file

    if not paths[0].name.lower().endswith(EXTENSIONS):
        raise ConfigurationError(
            ErrorCode.WRONG_SUFFIX,
            f"{paths[0]} ends in none of {', '.join(EXTENSIONS)}; give it one of them.",
        )
    for path in paths:
        check_file(path, overwrite)


def _stored(raw):
    """Pixels as a camera would store them: whole ADU in 16 bits."""
    import numpy as np

    data = raw.data
    whole = raw.unit == "adu" and np.all((data >= 0) & (data < 65536) & (data == np.round(data)))
    return data.astype(np.uint16) if whole else data
