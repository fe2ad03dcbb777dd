"""The way to any instrument, by name or by file; the file, a telescope in twenty lines of TOML.

::

    [instrument]
    name = "testbed"
    base = "toliman"            # optional: a preset that fills what is not said here
    plate_scale = 0.375         # arcsec/pixel
    plate_scale_err = 1e-5      # relative, optional
    # plate_scale_free = true   # fit the plate scale, with that error as a prior
    # transmission = ["x", "y", "r"]    # fit gradients of the pupil's transmission, and one along the radius
    # modes_of_b = ["noll7", "noll8"]   # fit what the wavefront of B has more of these than that of A
    shape = [128, 128]          # rows, columns
    exposure = 0.1              # s
    flux = 1e5                  # photons per frame, for simulations
    aberration_sigma = 20       # nm, optional: how well each is known beforehand, a prior of single frames

    [telescope]                 # a plain one, or a pupil file, or (instead) a [psf]
    diameter = 0.125            # m
    obscuration = 0.04          # m, diameter of the central one
    struts = 3
    strut_width = 0.002         # m
    noll = [4, 5, 6, 7, 8]      # aberrations that may vary
    # pupil = "pupil.npz"       # transmission, opd, basis: see jitterkit.optics.pupil_file

    [psf]
    file = "star.fits"          # an unblurred star, background subtracted
    # oversample = 4            # samples per pixel, each the light of a whole pixel
    # centre = [127.5, 127.5]   # where the star is, in samples from the first; its centroid if omitted
    # enclosed = 0.98           # share of the star's light inside the image

    [spectrum]                  # of the detected photons: one of three
    band = [530, 640]           # nm, flat
    samples = 13
    # lines = [532, 633]        # nm
    # file = "spectrum.csv"     # wavelength_nm, photons
    # temperatures = [5790, 5260]   # K, of A and B or of any star: their spectra over the instrument's
    # indices = [0.3, 0.7]      # or their spectral indices
    # index_err = 2             # prior error of each; 0 if they are exact
    # wavelength_err = 2e-3     # relative error of all wavelengths; 0 if they are exact

    [detector]                  # all optional: see jitterkit.instruments.sections
    base = "imx183"             # a detector that fills what is not said here
    gain = 3.7                  # e-/ADU
    bits = 12

    [sky]                       # all optional: see jitterkit.instruments.sky
    target = [219.9, -60.83]    # deg
    velocity = "earth"          # of the observer: for velocity aberration

Files are looked for beside the TOML.
"""

from __future__ import annotations

import logging
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from jitterkit.detectors import Detector
from jitterkit.errors import ConfigurationError, ErrorCode, reading_code
from jitterkit.frames.scale import ARCSEC_PER_RADIAN
from jitterkit.instruments import pupils
from jitterkit.instruments.instrument import Instrument
from jitterkit.instruments.presets import preset
from jitterkit.instruments.section import Section, refuse_unknown
from jitterkit.instruments.sections import DETECTOR_KEYS, SPECTRUM_KEYS, read_detector, read_spectrum_section
from jitterkit.instruments.sky import SKY_KEYS, read_sky

_LOG = logging.getLogger(__name__)

SECTIONS: Mapping[str, Mapping[str, str]] = {
    "instrument": {
        "name": "",
        "base": "",
        "plate_scale": "arcsec/pixel",
        "plate_scale_err": "",
        "plate_scale_free": "",
        "transmission": "",
        "modes_of_b": "",
        "shape": "pixel",
        "exposure": "s",
        "flux": "photons per frame",
        "aberration_sigma": "nm",
    },
    "telescope": {
        "diameter": "m",
        "obscuration": "m",
        "struts": "",
        "strut_width": "m",
        "noll": "",
        "samples": "",
        "pupil": "",
    },
    "psf": {
        "file": "",
        "hdu": "",
        "oversample": "samples per pixel",
        "centre": "samples",
        "enclosed": "share",
    },
    "spectrum": SPECTRUM_KEYS,
    "detector": DETECTOR_KEYS,
    "sky": SKY_KEYS,
}
"""Every table of an instrument file, its keys and their units."""


def read_instrument(path: str | Path) -> Instrument:
    """Read an instrument file; the module's introduction shows one.

    Parameters
    ----------
    path : str or Path
        TOML.

    Returns
    -------
    instrument : Instrument
        Every number of the file has the source ``"instrument file NAME [table] key"``; what a ``base``
        fills keeps the preset's.  A pupil file is opened when the optics are first asked for.

    Raises
    ------
    ConfigurationError
        If the file is missing or no TOML, a table or key is unknown or missing, or a value is of the
        wrong type or impossible; the message names file, key, value and remedy.
    """
    path = Path(path)
    sections = _sections(path)
    head = sections["instrument"]
    readers: dict[str, Callable[[Section], dict[str, Any]]] = {"telescope": _telescope, "psf": _psf}
    readers |= {"spectrum": read_spectrum_section, "sky": read_sky}
    try:
        base = preset(head.text("base")) if "base" in head else None
        fields = _head(head, path.stem)
        for name, reader in readers.items():
            if name in sections:
                fields |= reader(sections[name])
                fields["sources"][name] = f"instrument file {path.name} [{name}]"
        fields["detector"] = Detector() if base is None else base.detector
        if "detector" in sections:
            fields["detector"] = read_detector(sections["detector"], fields["detector"])
        made = _assemble(path, fields, base)
        if "psf" in sections:
            samples, whole = made.psf_options.get("oversample", 1), "enclosed" not in made.psf_options
            said = {"pitch": made.plate_scale / samples, "whole": whole, "oversample": samples}
            made = replace(made, psf_from=partial(fields["psf_from"], **said))
    except ConfigurationError as error:
        text = str(error) if str(error).startswith(str(path)) else f"{path}: {error}"
        raise ConfigurationError(error.code, text) from None
    if "telescope" in sections and (diameter := sections["telescope"].number("diameter")) and made.spectrum:
        width = np.mean(made.spectrum.wavelengths) * 1e-9 / diameter * ARCSEC_PER_RADIAN / made.plate_scale
        if not _WIDTHS[0] < width < _WIDTHS[1]:
            _LOG.warning(
                "%s: the resolution, wavelength over diameter, is %.3g pixels: check the units of diameter "
                "(m), wavelengths (nm) and plate_scale (arcsec).", path, width
            )  # fmt: skip
    return made


def _sections(path: Path) -> dict[str, Section]:
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        problem = f"{path}: cannot be read ({error.strerror}); give a preset's name or an instrument file."
        raise ConfigurationError(reading_code(error), problem) from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        message = f"{path}: is not readable as TOML ({error}); correct it."
        raise ConfigurationError(ErrorCode.MALFORMED, message) from None
    refuse_unknown(path, "table", content, SECTIONS)
    content.setdefault("instrument", {})
    sections = {name: Section(path, name, values, SECTIONS[name]) for name, values in content.items()}
    if "psf" in sections and not {"telescope", "spectrum"}.isdisjoint(sections):
        message = f"{path}: [psf] stands beside a [telescope] or [spectrum]; a star holds both: keep one."
        raise ConfigurationError(ErrorCode.CONFLICT, message)
    return sections


def _assemble(path: Path, fields: dict[str, Any], base: Instrument | None) -> Instrument:
    if base is not None:
        fields["sources"] = {**base.sources, **fields["sources"]}
        return replace(base, **fields)
    if "plate_scale" not in fields:
        problem = f"{path}: [instrument] has no plate_scale; give it, in arcsec/pixel."
        raise ConfigurationError(ErrorCode.MISSING_VALUE, problem)
    if "pupil_from" not in fields:
        problem = f"{path}: there is neither a [telescope] nor a [psf]; add one of them"
        raise ConfigurationError(ErrorCode.MISSING_VALUE, f"{problem}, with diameter or file.")
    if fields["pupil_from"] is not None and "spectrum" not in fields:
        problem = f"{path}: there is no [spectrum]; add one, such as band = [530, 640]."
        raise ConfigurationError(ErrorCode.MISSING_VALUE, problem)
    return Instrument(**{"shape": (128, 128), **fields})


def _head(section: Section, stem: str) -> dict[str, Any]:
    fields: dict[str, Any] = {
        "name": section.text("name", stem),
        "plate_scale": section.number("plate_scale"),
        "plate_scale_err": section.number("plate_scale_err"),
        "exposure": section.number("exposure"),
        "flux": section.number("flux"),
        "aberration_sigma": section.number("aberration_sigma"),
        "plate_scale_free": section.truth("plate_scale_free"),
        "transmission": section.texts("transmission"),
        "modes_of_b": section.texts("modes_of_b"),
        "shape": section.whole_numbers("shape", 2, "[rows, columns]") if "shape" in section else None,
    }
    fields = {name: value for name, value in fields.items() if value is not None}
    return {**fields, "sources": {name: section.source(name) for name in fields}}


_WIDTHS = (0.1, 16.0)
"""Pixels from lenses to oversampled images."""

_LARGEST = 100.0
"""Metres; a larger one is in mm."""


def _telescope(section: Section) -> dict[str, Any]:
    diameter = section.number("diameter")
    if diameter is not None and not 0 < diameter <= _LARGEST:
        section.refuse(ErrorCode.OUT_OF_RANGE, "diameter", f"give it in m, above 0 and up to {_LARGEST:g} m")
    if "pupil" in section:
        for key in (key for key in section.values if key not in ("pupil", "diameter")):
            section.refuse(ErrorCode.CONFLICT, key, "leave it out: the pupil file says it")
        return {"pupil_from": partial(pupils.from_file, section.path("pupil"), diameter), "psf_from": None}
    section.require("diameter", "give it, in m, or a pupil file")
    options: dict[str, Any] = {
        "obscuration": section.number("obscuration", 0.0),
        "struts": section.integer("struts", 0),
        "strut_width": section.number("strut_width", 0.0),
        "samples": section.integer("samples", 256),
    }
    if not 0 <= options["obscuration"] < diameter:
        remedy = f"give its diameter in m, less than the aperture's {diameter:g}"
        section.refuse(ErrorCode.OUT_OF_RANGE, "obscuration", remedy)
    if options["strut_width"] >= diameter:
        remedy = f"give it in m, less than the aperture's {diameter:g}"
        section.refuse(ErrorCode.OUT_OF_RANGE, "strut_width", remedy)
    for key, least in (("struts", 0), ("strut_width", 0.0), ("samples", 16)):
        if options[key] < least:
            section.refuse(ErrorCode.OUT_OF_RANGE, key, f"give at least {least}")
    if options["struts"] and not options["strut_width"]:
        problem = f"{section.file}: [telescope] has struts but no strut_width; give it, in m."
        raise ConfigurationError(ErrorCode.MISSING_VALUE, problem)
    if "noll" in section:
        options["noll"] = section.whole_numbers("noll", None, "a list of Noll's indices, from 2")
        too_low = any(j < 2 for j in options["noll"])
        if too_low or len(set(options["noll"])) < len(options["noll"]):
            code = ErrorCode.OUT_OF_RANGE if too_low else ErrorCode.DUPLICATE
            section.refuse(code, "noll", "give each of Noll's indices once, from 2")
    return {"pupil_from": partial(pupils.plain, diameter, **options), "psf_from": None}


def _psf(section: Section) -> dict[str, Any]:
    section.require("file", "give the star image")
    options: dict[str, Any] = {}
    if "oversample" in section:
        options["oversample"] = section.integer("oversample")
        if options["oversample"] < 1:
            section.refuse(ErrorCode.OUT_OF_RANGE, "oversample", "give at least 1 sample per pixel")
    options |= {"centre": tuple(section.numbers("centre", 2))} if "centre" in section else {}
    if "enclosed" in section:
        options["enclosed"] = section.number("enclosed")
        if not 0 < options["enclosed"] <= 1:
            section.refuse(ErrorCode.OUT_OF_RANGE, "enclosed", "give a share above 0, up to 1")
    star = partial(pupils.star, section.path("file"), section.integer("hdu"))
    return {"psf_from": star, "psf_options": options, "pupil_from": None, "spectrum": None}


def load_instrument(name_or_path: str | Path) -> Instrument:
    """Load an instrument.

    Parameters
    ----------
    name_or_path : str or Path
        A name in :data:`~jitterkit.instruments.presets.PRESETS`, or an instrument file (see
        :mod:`jitterkit.instruments.toml`): what ends in ``.toml`` or contains a directory is a file.

    Returns
    -------
    instrument : Instrument

    Raises
    ------
    ConfigurationError
        If there is no such preset or file, or the file cannot be used.
    """
    path = Path(name_or_path)
    is_file = path.suffix.lower() == ".toml" or len(path.parts) > 1
    return read_instrument(path) if is_file else preset(str(name_or_path))
