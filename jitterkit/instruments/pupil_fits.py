"""A pupil as poppy, webbpsf and stpsf write it, turned into the arrays of a pupil file.

They keep amplitude and wavefront error in files of their own, or in HDUs: metres per sample in
``PIXELSCL``, ``PUPLSCAL`` or ``PIXSCALE``, the unit of the wavefront error in ``BUNIT``.  In poppy an
error that grows with +x moves the image towards -x (see its ``test_sign_conventions``), here towards +x: its
sign is changed.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from jitterkit.errors import ConfigurationError, ErrorCode, refuse_if
from jitterkit.frames.fits import NamedImage
from jitterkit.frames.units import factor

_SCALES = ("PUPLSCAL", "PIXELSCL", "PIXSCALE")
"""Keywords of the metres per sample, in the order of trust: the first is of pupils alone."""

_WIDTHS = ("PUPLDIAM", "DIAM", "DIAMETER")
"""Keywords of the pupil's diameter, m; it may lie in a wider array."""

_AGREEMENT = 0.02
"""Relative difference of two widths up to which they are one: an edge is a sample or two uncertain."""


def is_pupil(images: Sequence[NamedImage]) -> bool | None:
    """Tell whether a file holds a pupil or a PSF, from its cards; None if they do not tell."""
    headers = [image.header for image in images]
    names = {image.name for image in images}
    in_metres = any(factor("pupil_scale", str(header.get("PIXUNIT", ""))) for header in headers)
    if in_metres or names & {"TRANSMISSION", "OPD"}:
        return True
    if any(key in header for header in headers for key in ("WAVELEN", "DIFFLMT", "OVERSAMP", "DET_SAMP")):
        return False
    found = any(key in header for header in headers for key in ("PUPLSCAL", "PUPLDIAM", "CONTENTS"))
    return True if found else None


def pupil_arrays(
    path: Path,
    images: Sequence[NamedImage],
    opd: tuple[Path, Sequence[NamedImage]] | None = None,
    *,
    diameter: float | None = None,
    opd_unit: str | None = None,
    plane: int | None = None,
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return transmission, wavefront error and width of a pupil.

    Parameters
    ----------
    path : Path
        Named in complaints.
    images : sequence of NamedImage
    opd : (Path, sequence of NamedImage), optional
        Another file that holds the wavefront error.
    diameter : float, optional
        Width of the array, m, where the file does not tell.
    opd_unit : str, optional
        Unit of the wavefront error, where its BUNIT does not tell.
    plane : int, optional
        Of a cube of wavefront errors, from 0.

    Returns
    -------
    transmission : (n, n) array
        Amplitude.
    opd : (n, n) array
        nm, in the sign of :class:`jitterkit.optics.Pupil`; zero where no light passes.
    diameter : float
        Of the array, m.

    Raises
    ------
    ConfigurationError
        If a value is missing, impossible or contradicts another.
    """
    amplitude = next((image for image in images if not _is_opd(image)), None)
    if amplitude is None or amplitude.pixels.ndim != 2 or len(set(amplitude.pixels.shape)) > 1:
        found = "a wavefront error" if amplitude is None else amplitude.pixels.shape
        problem = f"{path}: there is no transmission (n, n) of a pupil, but {found}"
        remedy = "give the file of the transmission first, and that of the wavefront error as --opd"
        raise ConfigurationError(ErrorCode.MISSING_VALUE, f"{problem}; {remedy}.")
    transmission = _amplitude(path, amplitude)
    where, candidates = (path, images) if opd is None else opd
    errors = [image for image in candidates if _is_opd(image)] or list(candidates if opd else ())
    cubes = [image for image in errors if image.pixels.ndim == 3]
    for option, value, of, there in (
        ("--opd-unit", opd_unit, "wavefront error", errors),
        ("--plane", plane, "cube of wavefront errors", cubes),
    ):
        problem = f"{path}: {option} {value} is of a {of}, and there is none; give --opd, or leave it out."
        refuse_if(value is not None and not there, ErrorCode.CONFLICT, problem)
    wavefront = np.zeros_like(transmission)
    if errors:
        wavefront = _wavefront(where, errors[0], transmission, opd_unit, plane)
        of_errors, scale = (image.quantity("pupil_scale", *_SCALES) for image in (errors[0], amplitude))
        if of_errors and scale and abs(of_errors / scale - 1) > _AGREEMENT:
            problem = f"HDU {errors[0].hdu} has samples of {of_errors:g} m, the transmission of {scale:g} m"
            remedy = "give both on the same samples"
            raise ConfigurationError(ErrorCode.CONFLICT, f"{where}: {problem}; {remedy}.")
    width = _width(path, amplitude, transmission) if diameter is None else diameter
    return transmission, wavefront, width


def _is_opd(image: NamedImage) -> bool:
    contents = str(image.header.get("CONTENTS", "")).strip().lower()
    return image.name == "OPD" or contents in ("opd", "phase") or (not contents and "BUNIT" in image.header)


def _amplitude(path: Path, image: NamedImage) -> np.ndarray:
    """Return the amplitude transmission; of a file of the intensity its root."""
    content = str(image.header.get("CONTENTS", image.header.get("PLANE1", ""))).lower()
    if image.pixels.min() < 0:
        problem = f"{path}: the transmission in HDU {image.hdu} goes down to {image.pixels.min():.4g}"
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, f"{problem}; give 0 to 1.")
    return np.sqrt(image.pixels) if "intensity" in content else image.pixels


def _wavefront(
    path: Path, image: NamedImage, transmission: np.ndarray, unit: str | None, plane: int | None
) -> np.ndarray:
    from jitterkit.optics.pupil_file import nanometres

    errors = image.pixels
    if errors.ndim == 3:
        if plane is None or not 0 <= plane < len(errors):
            problem = f"{path}: HDU {image.hdu} holds {len(errors)} wavefront errors"
            raise ConfigurationError(ErrorCode.MISSING_VALUE, f"{problem}; choose one with --plane, from 0.")
        errors = errors[plane]
    if errors.shape != transmission.shape:
        problem = f"{path}: the wavefront error has the shape {errors.shape}"
        found = f"the transmission {transmission.shape}; give both on the same samples"
        raise ConfigurationError(ErrorCode.WRONG_SHAPE, f"{problem}, {found}.")
    unit = image.header.get("BUNIT") if unit is None else unit
    if unit is None:
        problem = f"{path}: HDU {image.hdu} does not say the unit of the wavefront error (BUNIT)"
        raise ConfigurationError(ErrorCode.MISSING_VALUE, f"{problem}; give --opd-unit.")
    return np.where(transmission > 0, -nanometres(path, unit) * errors, 0.0)


def _width(path: Path, image: NamedImage, transmission: np.ndarray) -> float:
    """Width of the array, m; what its scale and the pupil's diameter say must not contradict each other."""
    lit = np.flatnonzero((transmission > 0).any(axis=0) | (transmission > 0).any(axis=1))
    n, extent = len(transmission), int(lit[-1] - lit[0] + 1) if lit.size else 0
    scale, diameter = (image.quantity("pupil_scale", *keys) for keys in (_SCALES, _WIDTHS))
    if scale is None and (diameter is None or extent < n - 2):
        problem = f"{path}: HDU {image.hdu} does not say how many metres a sample is wide"
        found = f"({', '.join(_SCALES)}), and the light fills {extent} of {n} samples"
        remedy = "give --diameter, of the whole array, in m"
        raise ConfigurationError(ErrorCode.MISSING_VALUE, f"{problem} {found}; {remedy}.")
    if scale is None:
        assert diameter is not None
        return diameter
    if diameter is not None and min(abs(scale * k / diameter - 1) for k in (n, extent)) > _AGREEMENT:
        problem = f"{path}: {n} samples of {scale:g} m, {extent} of them lit, are no pupil of {diameter:g} m"
        raise ConfigurationError(ErrorCode.CONFLICT, f"{problem}; give --diameter, of the whole array, in m.")
    return scale * n
