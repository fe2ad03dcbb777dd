"""The table ``[spectrum]`` of an instrument file: the instrument's light, and the colours of the stars."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.instruments.section import Section
from jitterkit.optics.colours import INDEX_ERROR, WAVELENGTH_ERROR, Colours, colours_of
from jitterkit.optics.spectrum import Spectrum, flat_band
from jitterkit.optics.spectrum_file import read_spectrum

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
        said = " and ".join(kinds) if kinds else "neither band nor lines nor file"
        raise ConfigurationError(
            ErrorCode.CONFLICT if kinds else ErrorCode.MISSING_VALUE,
            f"{section.file}: [spectrum] has {said}; give exactly one of band, lines, file.",
        )
    for key, wanted in (("samples", ("band", "file")), ("weights", ("lines",))):
        if key in section and kinds[0] not in wanted:
            section.refuse(ErrorCode.CONFLICT, key, f"leave it out: it does not go with {kinds[0]}")
    spectrum = _spectrum_of_kind(section, kinds[0])
    return {"spectrum": spectrum, "colours": _colours(section, spectrum)}


def _colours(section: Section, spectrum: Spectrum) -> Colours:
    """What a file says of the stars' spectra."""
    given = [key for key in ("temperatures", "indices") if key in section]
    if len(given) > 1:
        section.refuse(ErrorCode.CONFLICT, "indices", "leave it out: temperatures say it")
    error = section.number("index_err", INDEX_ERROR)
    wavelength = section.number("wavelength_err", WAVELENGTH_ERROR)
    for key, value in (("index_err", error), ("wavelength_err", wavelength)):
        if not 0 <= value < math.inf:
            section.refuse(ErrorCode.OUT_OF_RANGE, key, "give zero or a positive number")
    numbers = section.numbers(given[0]) if given else [0.0]
    if len(numbers) > 2 or not numbers:
        section.refuse(ErrorCode.WRONG_SHAPE, given[0], "give one number, or those of A and B")
    try:
        if given == ["temperatures"]:
            return replace(colours_of(numbers, spectrum, error), wavelength_err=wavelength)
        return Colours(tuple(numbers), error, wavelength_err=wavelength)
    except ConfigurationError as problem:
        raise ConfigurationError(problem.code, f"{section.file}: [spectrum] {problem}") from None


def _spectrum_of_kind(section: Section, kind: str) -> Spectrum:
    samples = section.integer("samples", 13)
    if samples < 1:
        section.refuse(ErrorCode.OUT_OF_RANGE, "samples", "give at least 1; 13 suit TOLIMAN")
    if kind == "file":
        return read_spectrum(section.path("file"), samples)
    if kind == "lines":
        wavelengths = section.numbers("lines")
        weights = section.numbers("weights", len(wavelengths)) if "weights" in section else None
        return Spectrum(tuple(wavelengths), tuple(weights or [1.0] * len(wavelengths)))
    low, high = section.numbers("band", 2)
    if not 0 < low < high:
        section.refuse(ErrorCode.OUT_OF_RANGE, "band", "give [shortest, longest], in nm")
    return flat_band(low, high, samples)
