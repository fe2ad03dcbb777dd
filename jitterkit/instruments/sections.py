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
a finite number in it counts as bad.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from jitterkit.detectors import Detector, detector_preset
from jitterkit.detectors.characteristics import ONLY_MAPS
from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.frames import open_frames
from jitterkit.instruments.section import Section
from jitterkit.optics.colours import INDEX_ERROR, WAVELENGTH_ERROR, Colours, colours_of, mean_spectrum
from jitterkit.optics.spectrum import Spectrum, flat_band
from jitterkit.optics.spectrum_file import read_spectrum

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
    return replace(base, **fields, sources=sources)


def _number_or_map(section: Section, key: str) -> float | np.ndarray:
    value = section.number_or_path(key, _MAP)
    return _map(value) if isinstance(value, Path) else value


def _map(path: Path) -> np.ndarray:
    """Return a map in single precision, which is finer than any detector is known; NaN where it is masked."""
    with open_frames(path) as frames:
        frame = frames[0]
    return np.where(frame.mask, np.nan, frame.data).astype(np.float32)


_READERS: Mapping[str, Any] = {
    **dict.fromkeys(DETECTOR_KEYS.keys() - {"base"}, Section.number),
    **dict.fromkeys(("read_noise", "bias", "dark_current"), _number_or_map),
    **dict.fromkeys(("bits", "bad_bits"), Section.integer),
    "nonlinearity": Section.numbers,
    **dict.fromkeys(ONLY_MAPS, lambda section, key: _map(section.path(key))),
    "bad_pixels": lambda section, key: ~(_map(section.path(key)) == 0),
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
