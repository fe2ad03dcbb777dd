"""Simulate frames whose truth is known: ``jitterkit simulate``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from jitterkit.cli import options
from jitterkit.cli.pointing import Motion
from jitterkit.cli.runtime import log, open_instrument
from jitterkit.errors import ErrorCode, refuse_if

_SCENES = {"star": options.OF_PAIRS, "binary": (), "stars": (*options.OF_PAIRS, "flux")}
"""Scenes, and the options that each one does not use."""


def simulate(
    context: typer.Context,
    *,
    output: Annotated[Path, typer.Argument()],
    instrument: options.InstrumentName = "toliman",
    jitter: options.Jitter,
    motion: Motion,
    scene: str = "binary",
    stars: Path | None = None,
    pair: options.Pair,
    aberrations: Annotated[float, typer.Option(min=0)] = 0.0,
    background: float = 0.0,
    scatter: bool = False,
    dither: Annotated[float, typer.Option(min=0)] = 0.0,
    frames: Annotated[int, typer.Option(min=1)] = 1,
    seed: Annotated[int, typer.Option(min=0)] = 0,
    noise: bool = True,
    detector: bool = True,
    overwrite: bool = False,
) -> None:
    """Simulate frames and write them with their truth in the header.

    Where the detector rolls, its rows are exposed one after the other to a drift, a trace or a spectrum.

    Parameters
    ----------
    output : FILE
        FITS or TIFF file, by its ending; several frames get numbers.
    scene : star|binary|stars
        One star, at --x and --y, a pair, or the stars of --stars, moved by --x and --y.
    stars : TABLE
        Table (ECSV or CSV) with columns x, y (arcsec from the centre) and flux (electrons): the stars of
        --scene stars, or further stars beside another scene.
    aberrations
        Rms of each aberration, nm, drawn for each frame.
    background
        Sky background, electrons per pixel.
    scatter
        Draw theta, and x and y within 5 arcsec, for each frame.
    dither
        Draw x and y within so many arcsec, for each frame.
    frames
        Number of frames.
    seed
        Seed of the random generator.
    noise
        Add photon and read noise.
    detector
        Read out in ADU, or keep electrons.
    """
    paths = _paths(output, frames)
    _check_paths(paths, overwrite)
    options.check_scene_options(scene, stars, _SCENES, context)
    drawn_too = ("dither", *(("theta",) if scene == "binary" else ()))
    options.refuse_given(context, drawn_too if scatter else (), "has no effect beside --scatter")
    telescope = open_instrument(instrument)
    import numpy as np

    from jitterkit.simulate import simulate_sequence

    generator = np.random.default_rng(seed)
    row_order = -1 if _is_tiff(output) else 1
    pointing = motion.pointing(jitter, telescope, frames, row_order, generator)
    drawn: dict[str, Any] = {}
    if pointing.positions is not None:
        drawn = {"x": pair.x + pointing.positions[:, 0], "y": pair.y + pointing.positions[:, 1]}
    if scatter and scene == "binary":
        drawn["theta"] = generator.uniform(0, 360, frames)
    if (reach := 5.0 if scatter else dither) > 0:
        drawn |= {
            axis: drawn.get(axis, getattr(pair, axis)) + generator.uniform(-reach, reach, frames)
            for axis in "xy"
        }
    sequence = simulate_sequence(
        telescope,
        options.sources(pair.of(scene, telescope), options.read_stars(stars)),
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
        _write(path, simulated, telescope, seed, overwrite)
        log(f"wrote {path}")


def _write(path: Path, simulated, telescope, seed: int, overwrite: bool) -> None:
    """Write a simulated frame with its truth as FITS or TIFF."""
    from jitterkit.frames import write_fits, write_tiff
    from jitterkit.simulate import fits_header, tiff_metadata

    pixels = _stored(simulated.raw)
    if _is_tiff(path):
        write_tiff(path, pixels, metadata=tiff_metadata(simulated, seed=seed), overwrite=overwrite)
    else:
        header = fits_header(simulated, telescope, seed=seed)
        write_fits(path, pixels, header=header, overwrite=overwrite)


def _is_tiff(path: Path) -> bool:
    return path.name.lower().endswith((".tif", ".tiff"))


def _paths(path: Path, frames: int) -> list[Path]:
    """Return the file of each frame: of several frames, each with its number."""
    if frames == 1:
        return [path]
    suffix = "".join(path.suffixes[-2:]) if path.suffix in (".gz", ".fz") else path.suffix
    stem, digits = path.name.removesuffix(suffix), len(str(frames - 1))
    return [path.with_name(f"{stem}-{index:0{digits}d}{suffix}") for index in range(frames)]


def _check_paths(paths: list[Path], overwrite: bool) -> None:
    """Refuse files that cannot be written."""
    from jitterkit.frames.files import EXTENSIONS
    from jitterkit.report.outputs import check_file

    problem = f"{paths[0]} ends in none of {', '.join(EXTENSIONS)}; give it one of them."
    refuse_if(not paths[0].name.lower().endswith(EXTENSIONS), ErrorCode.WRONG_SUFFIX, problem)
    for path in paths:
        check_file(path, overwrite)


def _stored(raw):
    """Return pixels as a camera would store them: whole ADU in 16 bits."""
    import numpy as np

    data = raw.data
    whole = raw.unit == "adu" and np.all((data >= 0) & (data < 65536) & (data == np.round(data)))
    return data.astype(np.uint16) if whole else data
