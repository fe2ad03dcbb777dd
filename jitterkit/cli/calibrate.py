"""Measure a detector from calibration frames: ``jitterkit calibrate``."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from jitterkit.cli import options
from jitterkit.cli.runtime import aligned, command_line, log

if TYPE_CHECKING:
    from jitterkit.calibration import Calibration, Stack
    from jitterkit.detectors import Detector
    from jitterkit.instruments import Instrument


_PICTURE, _LEVELS = "calibration.png", "photon_transfer.ecsv"


def calibrate(
    context: typer.Context,
    *,
    output: options.OutputDirectory,
    bias: list[Path] | None = None,
    dark: list[Path] | None = None,
    flat: list[Path] | None = None,
    instrument: options.InstrumentName = "toliman",
    exposure: float | None = None,
    gain: float | None = None,
    bias_level: float | None = None,
    clip: float = 5.0,
    hot: float = 10.0,
    dead: float = 0.5,
    smooth: bool = False,
    memory: float = 1200.0,
    overwrite: bool = False,
) -> None:
    """Measure a detector from bias, dark and flat frames, or from some of them.

    Writes bias.fits, read_noise.fits, dark_current.fits, flat.fits, bad_pixels.fits, photon_transfer.ecsv,
    calibration.png and detector.toml, an instrument file for the other commands, process -i
    DIR/detector.toml.

    Parameters
    ----------
    bias : FILE_OR_DIR
        Bias frames: FITS or TIFF, a directory of them, or the option several times.
    dark : FILE_OR_DIR
        Dark frames, of one exposure or several.
    flat : FILE_OR_DIR
        Flat frames, two or more of each level of light.
    exposure
        Exposure time of darks and flats, s, in place of the headers'.
    gain
        Gain, e-/ADU, if there are no flats; by default the header's, or else the instrument's.
    bias_level
        Bias level, ADU, if there are no bias frames; by default the instrument file's.
    clip
        Deviation beyond which a value is excluded, in standard deviations of a frame's noise; 3 or more.
    hot
        Robust sigmas over the median dark current from which a pixel is hot.
    dead
        Share of the neighbouring response below which a pixel is dead.
    smooth
        Divide the flat by a smooth surface (third order in x and y): its smooth part then counts as the
        lamp's. Without this option, vignetting is corrected, and the unevenness of the lamp with it.
    memory
        Memory for the pixels that are read at a time, megabytes.
    """
    from jitterkit.calibration import Settings, open_stacks
    from jitterkit.calibration import calibrate as measure
    from jitterkit.calibration.products import FILES
    from jitterkit.frames.window import WINDOW_CARDS
    from jitterkit.instruments import load_instrument
    from jitterkit.report.calibration_table import calibration_rows, calibration_sentences, stack_sentences
    from jitterkit.report.outputs import check_directory

    check_directory(output, (*FILES, _PICTURE, _LEVELS), overwrite)
    for useless, names, why in (
        (flat, ("gain",), "is not used beside flats, which measure it"),
        (bias, ("bias_level",), "is not used beside bias frames, which measure it"),
        (not dark and not flat, ("exposure",), "is that of darks and flats"),
        (not dark, ("hot",), "is for darks"),
        (not flat, ("dead", "smooth"), "is for flats"),
    ):
        options.refuse_given(context, names if useless else (), why)
    telescope = load_instrument(instrument)
    chosen = Settings(clip=clip, hot=hot, dead=dead, smooth=smooth, memory=memory * 1e6)
    biases = open_stacks("bias", bias)[0] if bias else None
    darks = open_stacks("dark", dark, exposure) if dark else ()
    flats = open_stacks("flat", flat, exposure) if flat else ()
    stacks = [*([biases] if biases else []), *darks, *flats]
    level, level_source = _level(bias_level, telescope) if flat and not bias else (bias_level, "")
    own_gain, gain_source = (None, "") if flat else _gain(gain, stacks, telescope)
    calibration = measure(biases, darks, flats, bias_level=level, gain=own_gain, settings=chosen)
    said = (*stack_sentences(stacks), level_source, gain_source, *calibration_sentences(calibration))
    for sentence in filter(None, said):
        log(sentence)
    typer.echo("\n".join(aligned(_cells(*row) for row in calibration_rows(calibration))))
    shots = [shot for stack in stacks for shot in stack.shots]
    cards = {card: said for shot in shots for card, said in shot.settings.items() if card in WINDOW_CARDS}
    _write_outputs(calibration, output, instrument, telescope.detector, cards)
    log(f"wrote {output}; use it by -i {output / 'detector.toml'}")


def _gain(given: float | None, stacks: list[Stack], telescope: Instrument) -> tuple[float | None, str]:
    """Return the gain where there are no flats, and a sentence on its source."""
    header = next((shot.gain for stack in stacks for shot in stack.shots if shot.gain), None)
    own = telescope.detector.gain, f"the instrument {telescope.name!r}"
    for value, source in ((given, "--gain"), (header, "the headers"), own):
        if value is not None:
            return value, f"A gain of {value:g} e-/ADU is taken from {source}."
    return None, ""


def _level(given: float | None, telescope: Instrument) -> tuple[float | None, str]:
    """Return the bias level of the flats, and a sentence if it is the instrument file's.

    A preset's is a choice: no camera has it.
    """
    import numpy as np

    level = telescope.detector.bias
    chosen = telescope.detector.sources.get("bias", "").startswith("preset")
    if given is not None or level is None or chosen:
        return given, ""
    value = float(np.median(level))
    return value, f"A bias of {value:g} ADU is taken from the instrument {telescope.name!r}."


def _cells(name: str, value: float, error: float, unit: str) -> tuple[str, str, str]:
    """Return a row of the table as text: a count, a value, or a value with its error."""
    from jitterkit.report.words import number, with_error

    if not unit:
        return name, f"{value:.0f}", unit
    return name, number(value, 5) if math.isnan(error) else with_error(value, error), unit


def _write_outputs(
    calibration: Calibration, output: Path, instrument: str, detector: Detector, cards: dict[str, str]
) -> None:
    """Write all files or none; read the instrument file once before the others are kept."""
    from jitterkit.calibration import together, write_calibration
    from jitterkit.calibration.products import DETECTOR
    from jitterkit.instruments import load_instrument
    from jitterkit.report.calibration_plots import plot_calibration
    from jitterkit.report.calibration_table import levels_table
    from jitterkit.report.plots import png
    from jitterkit.report.table import write_table

    with together(output) as directory:
        known = {"full_well": detector.full_well, "gain": detector.gain}
        write_calibration(calibration, directory, instrument, **known, cards=cards)
        write_table(directory / _LEVELS, levels_table(calibration, command_line()))
        (directory / _PICTURE).write_bytes(png(plot_calibration(calibration)[0], dpi=150))
        load_instrument(directory / DETECTOR)
