"""Pupils on disk: what an instrument's pupil file holds.

``.npz`` holds ``transmission`` and, as far as there are any, ``opd`` [nm], ``basis``, ``names`` and
``diameter`` [m].  FITS holds the image extensions ``TRANSMISSION``, ``OPD`` (in the unit of its ``BUNIT``,
nm without one) and ``BASIS`` and the keyword ``DIAMETER`` in the primary header; the modes may be named
``MODE0``, ``MODE1``... there.
"""

from __future__ import annotations

import os
import tempfile
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from jitterkit.errors import ConfigurationError, ErrorCode, FrameError, reading_code
from jitterkit.optics.pupil import Pupil


def read_pupil(path: str | Path, diameter: float | None = None) -> Pupil:
    """Read a pupil from an ``.npz`` or FITS file.

    Parameters
    ----------
    path : str or Path
        FITS unless the name ends in ``.npz``.
    diameter : float, optional
        Width of the grid in m; takes precedence over the file's own.

    Returns
    -------
    pupil : Pupil

    Raises
    ------
    ConfigurationError
        If the file is missing, damaged or incomplete, or its arrays do not make a pupil.
    """
    path = Path(path)
    if not path.is_file():
        message = f"There is no pupil file {path}; give its path relative to where you are."
        raise ConfigurationError(ErrorCode.NOT_FOUND, message)
    content = _read_npz(path) if path.suffix.lower() == ".npz" else _read_fits(path)
    if "transmission" not in content:
        message = f"The pupil file {path} holds no transmission, only {sorted(content)}"
        remedy = "add it, or convert a file of poppy or stpsf with jitterkit instrument"
        raise ConfigurationError(ErrorCode.MISSING_VALUE, f"{message}; {remedy}.")
    _check_arrays(path, content)
    diameter = content.get("diameter") if diameter is None else diameter
    if diameter is None:
        message = f"The pupil file {path} does not say its diameter; give one, in m."
        raise ConfigurationError(ErrorCode.MISSING_VALUE, message)
    try:
        return Pupil(
            content["transmission"],
            float(diameter),
            content.get("opd"),
            content.get("basis"),
            content.get("names"),
            light=content.get("light"),
        )
    except ConfigurationError as problem:
        raise ConfigurationError(problem.code, f"{path}: {problem}") from None
    except (TypeError, ValueError) as problem:
        message = f"{path}: {problem}; a pupil is made of numbers."
        raise ConfigurationError(ErrorCode.WRONG_TYPE, message) from None


_LEAST_OPD = 1e-3
"""nm: a wavefront error that is nowhere as large is below what is measured, and mostly in metres."""


def _check_arrays(path: Path, content: Mapping[str, Any]) -> None:
    """Refuse complex fields, whose phase would be lost, and a wavefront error that must be in metres."""
    for name in ("transmission", "opd", "basis"):
        if np.iscomplexobj(content.get(name, 0.0)):
            message = (
                f"{path}: {name} is complex; give the amplitude as transmission and the phase as opd, in nm."
            )
            raise ConfigurationError(ErrorCode.WRONG_TYPE, message)
    opd = np.asarray(content.get("opd", 0.0))
    largest = float(np.abs(opd[np.isfinite(opd)]).max(initial=0.0)) if opd.dtype.kind in "iuf" else 0.0
    if 0 < largest < _LEAST_OPD:
        message = f"{path}: the wavefront error is {largest:.3g} nm at most; give it in nm, or as zeros."
        raise ConfigurationError(ErrorCode.UNKNOWN_UNIT, message)


def write_pupil(path: str | Path, pupil: Pupil) -> None:
    """Write a pupil to an ``.npz`` file; :func:`read_pupil` returns the same, bit for bit.

    The file appears whole or not at all.

    Raises
    ------
    ConfigurationError
        If the name does not end in ``.npz``.
    OSError
        If it cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() != ".npz":
        raise ConfigurationError(ErrorCode.WRONG_SUFFIX, f"A pupil is written as .npz; rename {path}.")
    with tempfile.NamedTemporaryFile(dir=path.parent, suffix=".part", delete=False) as part:
        try:
            np.savez(
                part,
                transmission=pupil.transmission,
                opd=pupil.opd,
                basis=pupil.basis,
                names=np.array(pupil.names, dtype=str),
                diameter=pupil.diameter,
                light=pupil.light,
            )
            part.close()
            os.replace(part.name, path)
        except BaseException:
            part.close()
            Path(part.name).unlink(missing_ok=True)
            raise


def _read_npz(path: Path) -> dict[str, Any]:
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            content: dict[str, Any] = dict(archive)
    except (OSError, ValueError, EOFError, TypeError, zipfile.BadZipFile) as problem:
        message = f"The pupil file {path} cannot be read ({problem}); make it again."
        raise ConfigurationError(reading_code(problem, ErrorCode.DAMAGED), message) from None
    if "names" in content:
        content["names"] = [str(name) for name in content["names"]]
    return content


def _read_fits(path: Path) -> dict[str, Any]:
    from jitterkit.frames.cards import Cards
    from jitterkit.frames.fits import read_images  # costs 0.3 s, and an .npz does not need it

    try:
        images, header = read_images(path)
    except FrameError as problem:
        raise ConfigurationError(problem.code, f"The pupil file cannot be read: {problem}") from None
    content: dict[str, Any] = {
        image.name.lower(): image.pixels for image in images if image.hdu and image.name
    }
    for image in images:
        if image.name == "OPD" and "BUNIT" in image.header:
            content["opd"] = image.pixels * nanometres(path, image.header["BUNIT"])
    number = Cards(header).quantity("pupil_scale", "DIAMETER")
    content["diameter"] = None if number is None else number.value
    names = _mode_names(header, len(content.get("basis", ())))
    return content | ({"names": names} if names else {})


def nanometres(path: Path, unit: Any) -> float:
    """Return how many nm a unit of the wavefront error in a FITS file is, such as poppy's ``microns``.

    Raises
    ------
    ConfigurationError
        If it is no unit of length.
    """
    import astropy.units as u

    name = str(unit).strip().lower().replace("metre", "meter")
    for spelling in (name, name.removesuffix("s")):
        try:
            return float(u.Unit(spelling).to(u.nm))
        except (ValueError, TypeError):  # astropy's UnitConversionError is both
            continue
    problem = f"{path}: the wavefront error is in {unit!r} (BUNIT), which is no length; give m, um or nm."
    raise ConfigurationError(ErrorCode.UNKNOWN_UNIT, problem)


def _mode_names(header: Mapping[str, Any], count: int) -> list[str]:
    """Return the names of the modes, if every mode has one."""
    names = [header.get(f"MODE{k}") for k in range(count)]
    return [str(name) for name in names] if all(names) else []
