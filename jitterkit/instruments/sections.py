"""The tables ``[detector]`` and ``[spectrum]`` of an instrument file.

A spectrum is the instrument's light, with the colours of the stars; a detector is numbers, and maps from
files.

::

    [detector]                  # all optional
    base = "imx183"             # a detector that fills what is not said here
    gain = 3.7                  # e-/ADU
    read_noise = 2.4            # e-, or a file
    bias = 30                   # ADU, or a file: "bias.fits"
    dark_current = 0.5          # e-/s, or a file; a hot pixel has more
    flat = "flat.fits"          # response relative to the mean; zero where dead
    bad_pixels = "bad.fits"     # not zero where bad
    full_well = 15000           # e-
    saturation = 4000           # ADU
    bits = 12
    nonlinearity = [-1e-6]      # c1, c2, ...: q e- are measured as q (1 + c1 q + c2 q² + ...)
    coupling = 0.002            # share of a pixel's charge with which each neighbour is read
    brighter_fatter = 1e-6      # pixels that a border moves per electron of difference
    pixel_shift_x = "x.fits"    # pixels from where an even grid has each one to where it is, along columns
    pixel_shift_y = "y.fits"    # and along rows
    diffusion = 0.2             # pixel, one sigma
    line_time = 15e-6           # s, from one row of the file to the next; 0 for a global shutter
    cosmic_rays = 1e-6          # hits per pixel and second, for simulations
    bad_bits = 4096             # sum of the bits of a DQ or MASK plane that mask a pixel

A map is a FITS or TIFF file of the whole detector, on the rows of the frames it is for; a pixel without
a finite number in it counts as bad.  It is one image, in the unit above.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from jitterkit.detectors import Detector, detector_preset
from jitterkit.detectors.characteristics import MAPS, ONLY_MAPS
from jitterkit.errors import ConfigurationError, ErrorCode, FrameError
from jitterkit.frames import open_frames
from jitterkit.frames.beside import ROW_ORDERS
from jitterkit.frames.metadata import Sourced
from jitterkit.frames.units import resolve_unit
from jitterkit.instruments.section import Section
from jitterkit.optics.colours import INDEX_ERROR, WAVELENGTH_ERROR, Colours, colours_of, mean_spectrum
from jitterkit.optics.spectrum import Spectrum, flat_band
from jitterkit.optics.spectrum_file import read_spectrum

_LOG = logging.getLogger(__name__)

DETECTOR_KEYS: Mapping[str, str] = {
    "base": "",
    "gain": "e-/ADU",
    "read_noise": "e-",
    "bias": "ADU",
    "dark_current": "e-/s",
    "flat": "",
    "bad_pixels": "",
    "full_well": "e-",
    "saturation": "ADU",
    "bits": "",
    "nonlinearity": "1/e-, 1/e-², ...",
    "coupling": "share of a pixel's charge",
    "brighter_fatter": "pixel per electron",
    "pixel_shift_x": "",
    "pixel_shift_y": "",
    "diffusion": "pixel",
    "line_time": "s",
    "cosmic_rays": "hits per pixel and second",
    "bad_bits": "",
}
"""Keys of the table, with their units."""

_MAP = "a FITS or TIFF file of the whole detector"

_DARK = 1.0
"""Seconds from which an unlit frame is a dark: many cameras take no bias of zero."""


def read_detector(section: Section, base: Detector) -> Detector:
    """Read the table.

    Parameters
    ----------
    section : Section
    base : Detector
        Fills what the table does not say, unless the table names a base of its own.

    Returns
    -------
    detector : Detector
        Every number of the file has the source ``"instrument file NAME [detector] key"``; what a base
        fills keeps its own.

    Raises
    ------
    ConfigurationError
        If a value is of the wrong type or impossible, there is no such file, or the maps are not of one
        detector.
    FrameError
        If a map cannot be read.
    """
    base = detector_preset(section.text("base")) if "base" in section else base
    fields = {key: read(section, key) for key, read in _READERS.items() if key in section}
    sources = {**base.sources, **{key: section.source(key) for key in fields}}
    return replace(base, **fields, sources=sources, **_placed_maps(section))


def _placed_maps(section: Section) -> dict[str, Any]:
    """Return which part of the detector the maps are, and what became of rows without a ``ROWORDER``."""
    orders, windows = set(), {}
    for key in MAPS:
        if isinstance(section.values.get(key), str):
            with open_frames(section.path(key)) as frames:
                order, windows[key] = frames.text("ROWORDER").upper(), frames.metadata.window
                orders |= {frames.metadata.row_order} if order not in ROW_ORDERS else set()
            if order not in ("", *ROW_ORDERS):
                _LOG.warning(
                    "%s: ROWORDER = %r is neither TOP-DOWN nor BOTTOM-UP and is ignored.",
                    section.path(key), order
                )  # fmt: skip
    return {"map_orders": tuple(sorted(orders)), "map_windows": windows}


_UNITS = {"bias": "adu", "read_noise": "electron", "dark_current": "electron/s"}
"""Units of the maps that have one, as :func:`~jitterkit.frames.units.resolve_unit` names them."""


def _number_or_map(section: Section, key: str) -> float | np.ndarray:
    value = section.number_or_path(key, _MAP)
    return _map(section, key) if isinstance(value, Path) else value


def _map(section: Section, key: str) -> np.ndarray:
    """Return a map in single precision, which is finer than any detector is known; NaN where it is masked."""
    path = section.path(key)
    with open_frames(path) as frames:
        frame, count, unit = frames[0], len(frames), frames.text("BUNIT").strip()
    if count > 1:
        problem, remedy = f"holds {count} images, and {key} is one", "write their mean, or the one for it"
        raise FrameError(ErrorCode.WRONG_SHAPE, path, problem, remedy)
    known = frame.metadata.exposure
    from_header = known is not None and known.source.startswith("header")  # a TOML is of all TIFFs beside it
    _check_quantity(path, key, unit, known if from_header else None)
    return np.where(frame.mask, np.nan, frame.data).astype(np.float32)


def _check_quantity(path: Path, key: str, unit: str, exposure: Sourced | None) -> None:
    """Refuse a map in another unit, and a dark frame as a dark current; warn of a dark frame as a bias."""
    wanted = _UNITS.get(key)
    if wanted and unit and resolve_unit(unit) != wanted:
        remedy = f"give {key} in {DETECTOR_KEYS[key]}, and say so in BUNIT"
        raise FrameError(ErrorCode.UNKNOWN_UNIT, path, f"is in {unit!r} (BUNIT)", remedy)
    if exposure is None:
        return
    if key == "dark_current" and exposure.value and not unit:
        said = f"{exposure.value:g} s ({exposure.source})"
        problem = f"has an exposure of {said} and no unit, as a dark frame has"
        remedy = "give electrons per second, bias subtracted, and write BUNIT = 'electron/s'"
        raise FrameError(ErrorCode.UNKNOWN_UNIT, path, problem, remedy)
    if key == "bias" and exposure.value >= _DARK:
        _LOG.warning(
            "%s: is given as the bias and has an exposure of %g s (%s): the dark current of that time is "
            "subtracted from frames of any exposure.", path, exposure.value, exposure.source
        )  # fmt: skip


def _bad_pixels(section: Section, key: str) -> np.ndarray:
    """Return where a map is not zero; refuse one that leaves no pixel, warn of one that leaves the fewer."""
    bad = ~(_map(section, key) == 0)
    if bad.all():
        section.refuse(
            ErrorCode.OUT_OF_RANGE, key, "all its pixels are bad: give a map with zeros for good ones"
        )
    if bad.mean() > 0.5:  # as of the masks of frames
        _LOG.warning(
            "%s: marks %.3g %% of the pixels as bad: 1 may mean good, and must mean bad.",
            section.path(key), 100 * bad.mean()
        )  # fmt: skip
    return bad


def _not_negative(section: Section, key: str) -> float | np.ndarray:
    """Return a map that noise has made negative in places with zeros there: no current, a dead pixel."""
    values = _number_or_map(section, key) if key not in ONLY_MAPS else _map(section, key)
    return np.maximum(values, np.float32(0)) if isinstance(values, np.ndarray) else values


_READERS: Mapping[str, Any] = {
    **dict.fromkeys(DETECTOR_KEYS.keys() - {"base"}, Section.number),
    **dict.fromkeys(("read_noise", "bias"), _number_or_map),
    **dict.fromkeys(("bits", "bad_bits"), Section.integer),
    "nonlinearity": Section.numbers,
    **dict.fromkeys(ONLY_MAPS, _map),
    **dict.fromkeys(("dark_current", "flat"), _not_negative),
    "bad_pixels": _bad_pixels,
}


SPECTRUM_KEYS: Mapping[str, str] = {
    "band": "nm",
    "samples": "",
    "lines": "nm",
    "weights": "any",
    "file": "",
    "temperatures": "K",
    "indices": "",
    "index_err": "",
    "wavelength_err": "",
}
"""Its keys and their units."""


def read_spectrum_section(section: Section) -> dict[str, Any]:
    """Return the spectrum of an instrument and what its file says of the stars' colours, by field."""
    kinds = [key for key in ("band", "lines", "file") if key in section]
    if len(kinds) != 1:
        given = " and ".join(kinds) if kinds else "neither band nor lines nor file"
        problem = f"{section.file}: [spectrum] has {given}; give exactly one of band, lines, file."
        raise ConfigurationError(ErrorCode.CONFLICT if kinds else ErrorCode.MISSING_VALUE, problem)
    for key, wanted in (("samples", ("band", "file")), ("weights", ("lines",))):
        if key in section and kinds[0] not in wanted:
            section.refuse(ErrorCode.CONFLICT, key, f"leave it out: it does not go with {kinds[0]}")
    spectrum, indices = _spectrum_of_kind(section, kinds[0])
    return {"spectrum": spectrum, "colours": _colours(section, spectrum, indices)}


def _colours(section: Section, spectrum: Spectrum, indices: tuple[float, ...]) -> Colours:
    """Return what a file says of the stars' spectra; their indices where two spectra give them."""
    given = [key for key in ("temperatures", "indices") if key in section]
    if len(given) > 1:
        section.refuse(ErrorCode.CONFLICT, "indices", "leave it out: temperatures say it")
    if given and indices:
        section.refuse(ErrorCode.CONFLICT, given[0], "leave it out: the files of A and B say it")
    error = section.number("index_err", INDEX_ERROR)
    wavelength = section.number("wavelength_err", WAVELENGTH_ERROR)
    for key, value in (("index_err", error), ("wavelength_err", wavelength)):
        if not 0 <= value < math.inf:
            section.refuse(ErrorCode.OUT_OF_RANGE, key, "give zero or a positive number")
    numbers = section.numbers(given[0]) if given else list(indices or (0.0,))
    if len(numbers) > 2 or not numbers:
        section.refuse(ErrorCode.WRONG_SHAPE, given[0], "give one number, or those of A and B")
    try:
        if given == ["temperatures"]:
            return replace(colours_of(numbers, spectrum, error), wavelength_err=wavelength)
        return Colours(tuple(numbers), error, wavelength_err=wavelength)
    except ConfigurationError as problem:
        raise ConfigurationError(problem.code, f"{section.file}: [spectrum] {problem}") from None


def _spectrum_of_kind(section: Section, kind: str) -> tuple[Spectrum, tuple[float, ...]]:
    """Return the spectrum, and the indices of A and B where each has a file of its own."""
    samples = section.integer("samples", 13)
    if samples < 1:
        section.refuse(ErrorCode.OUT_OF_RANGE, "samples", "give at least 1; 13 suit TOLIMAN")
    if kind == "file":
        files = section.paths("file")
        if not 1 <= len(files) <= 2:
            section.refuse(ErrorCode.WRONG_SHAPE, "file", "give one file, or those of A and B")
        spectra = [read_spectrum(file, samples) for file in files]
        return (spectra[0], ()) if len(files) == 1 else mean_spectrum(spectra, samples)
    if kind == "lines":
        wavelengths = section.numbers("lines")
        weights = section.numbers("weights", len(wavelengths)) if "weights" in section else None
        return Spectrum(tuple(wavelengths), tuple(weights or [1.0] * len(wavelengths))), ()
    low, high = section.numbers("band", 2)
    if not 0 < low < high:
        section.refuse(ErrorCode.OUT_OF_RANGE, "band", "give [shortest, longest], in nm")
    return flat_band(low, high, samples), ()
