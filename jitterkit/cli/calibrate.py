"""``jitterkit calibrate``: from bias, dark and flat frames to a detector that the other commands know."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from jitterkit.cli import options
from jitterkit.cli.runtime import command_line, say

if TYPE_CHECKING:
    from jitterkit.calibration import Calibration, Stack
    from jitterkit.instruments import Instrument

__all__ = ["calibrate"]

_PICTURE, _LEVELS = "calibration.png", "photon_transfer.ecsv"
_FRAMES = "FILE_OR_DIR"


def calibrate(
    output: Annotated[Path, typer.Option("--output", "-o", metavar="DIR", help="Directory for the results.")],
    bias: Annotated[
        list[Path] | None,
        typer.Option(
            metavar=_FRAMES,
            help="Bias frames: FITS or TIFF, a directory of them, or the option several times.",
            show_default=False,
        ),
    ] = None,
    dark: Annotated[
        list[Path] | None,
        typer.Option(metavar=_FRAMES, help="Dark frames, of one exposure or several.", show_default=False),
    ] = None,
    flat: Annotated[
        list[Path] | None,
        typer.Option(
            metavar=_FRAMES,
            help="Flat frames, two or more of each level of light.",
            show_default=False,
        ),
    ] = None,
    instrument: options.InstrumentName = "toliman",
    exposure: Annotated[
        float | None,
        typer.Option(help="Of the darks and flats, s, whatever their headers say.", show_default=False),
    ] = None,
    gain: Annotated[
        float | None,
        typer.Option(
            help="e-/ADU, where there are no flats; by default the header's, or else the instrument's.",
            show_default=False,
        ),
    ] = None,
    bias_level: Annotated[
        float | None,
        typer.Option(
            help="ADU, where there are no bias frames; by default the instrument's.",
            show_default=False,
        ),
    ] = None,
    clip: Annotated[
        float, typer.Option(help="Noises of a frame beyond which a value is left out, 3 or more.")
    ] = 5.0,
    hot: Annotated[
        float, typer.Option(help="Robust sigmas over the median dark current from which a pixel is hot.")
    ] = 10.0,
    dead: Annotated[
        float, typer.Option(help="Share of the response around it below which a pixel is dead.")
    ] = 0.5,
    smooth: Annotated[
        bool,
        typer.Option(
            "--smooth",
            help="Divide the flat by a smooth surface (third order in x and y): what is smooth is the "
            "lamp's. Without it vignetting is corrected, and the lamp's unevenness with it.",
        ),
    ] = False,
    memory: Annotated[
        float, typer.Option(help="Megabytes that the pixels read at a time may take.")
    ] = 1200.0,
    overwrite: options.Overwrite = False,
) -> None:
    """Measure a detector from bias, dark and flat frames; whatever is given of them.

    Writes bias.fits, read_noise.fits, dark_current.fits, flat.fits, bad_pixels.fits, photon_transfer.ecsv,
    calibration.png and detector.toml, an instrument file for the other commands, process -i
    DIR/detector.toml.
    """
    from jitterkit.calibration import Settings, open_stacks
    from jitterkit.calibration import calibrate as measure
    from jitterkit.calibration.products import FILES
    from jitterkit.instruments import load_instrument
    from jitterkit.report.calibration_table import calibration_rows, calibration_sentences
    from jitterkit.report.outputs import check_directory

    check_directory(output, (*FILES, _PICTURE, _LEVELS), overwrite)
    telescope = load_instrument(instrument)
    chosen = Settings(clip=clip, hot=hot, dead=dead, smooth=smooth, memory=memory * 1e6)
    biases = open_stacks("bias", bias)[0] if bias else None
    darks, flats = (
        open_stacks(kind, given, exposure) if given else ()
        for kind, given in (("dark", dark), ("flat", flat))
    )
    stacks = [*([biases] if biases else []), *darks, *flats]
    level, of_level = _level(bias_level, telescope) if flat and not bias else (bias_level, "")
    own_gain, of_gain = (None, "") if flat else _gain(gain, stacks, telescope)
    calibration = measure(
        biases,
        darks,
        flats,
        bias_level=level,
        gain=own_gain,
        settings=chosen,
    )
    for sentence in filter(None, (of_level, of_gain, *calibration_sentences(calibration))):
        say(sentence)
    _print(calibration_rows(calibration))
    _write(calibration, output, instrument, telescope.detector.full_well)
    say(f"wrote {output}; use it by -i {output / 'detector.toml'}")


def _gain(given: float | None, stacks: list[Stack], telescope: Instrument) -> tuple[float | None, str]:
    """The gain where no flats tell it, and a sentence on whose it is."""
    said = next((shot.gain for stack in stacks for shot in stack.shots if shot.gain), None)
    for value, whose in ((given, "--gain"), (said, "the headers")):
        if value is not None:
            return value, f"A gain of {value:g} e-/ADU is taken from {whose}."
    value = telescope.detector.gain
    if value is None:
        return None, ""
    return value, f"A gain of {value:g} e-/ADU is taken from the instrument {telescope.name!r}."


def _level(given: float | None, telescope: Instrument) -> tuple[float | None, str]:
    """The level that flats stand on, and a sentence where the instrument says it."""
    import numpy as np

    level = telescope.detector.bias
    if given is not None or level is None:
        return given, ""
    value = float(np.median(level))
    return value, f"A bias of {value:g} ADU is taken from the instrument {telescope.name!r}."


def _print(rows: list[tuple[str, float, float, str]]) -> None:
    from jitterkit.report.words import number, with_error

    cells = [
        [
            name,
            f"{value:.0f}"
            if not unit
            else number(value, 5)
            if math.isnan(error)
            else with_error(value, error),
            unit,
        ]
        for name, value, error, unit in rows
    ]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    typer.echo("\n".join("  ".join(map(str.ljust, row, widths)).rstrip() for row in cells))


def _write(calibration: Calibration, output: Path, instrument: str, full_well: float | None) -> None:
    """Everything or nothing; the instrument file is read once before it is handed out."""
    from jitterkit.calibration import together, write_calibration
    from jitterkit.calibration.products import DETECTOR
    from jitterkit.instruments import load_instrument
    from jitterkit.report.calibration_plots import plot_calibration
    from jitterkit.report.calibration_table import levels_table
    from jitterkit.report.plots import png
    from jitterkit.report.table import write_table

    with together(output) as directory:
        write_calibration(calibration, directory, instrument, full_well=full_well)
        write_table(directory / _LEVELS, levels_table(calibration, command_line()))
        (directory / _PICTURE).write_bytes(png(plot_calibration(calibration)[0], dpi=150))
        load_instrument(directory / DETECTOR)
