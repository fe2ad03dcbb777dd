"""Pupils and star images, made only when an instrument's optics are first asked for.

Making one loads JAX, and TOLIMAN's takes seconds; ``jitterkit info`` needs neither.

:func:`pupil_arrays` reads a pupil as poppy, webbpsf and stpsf write it.  They keep amplitude and wavefront
error in files of their own, or in HDUs: metres per sample in ``PIXELSCL``, ``PUPLSCAL`` or ``PIXSCALE``, the
unit of the wavefront error in ``BUNIT``.  In poppy an error that grows with +x moves the image towards -x
(see its ``test_sign_conventions``), here towards +x: its sign is changed.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.frames import open_frames
from jitterkit.frames.fits import NamedImage
from jitterkit.frames.units import factor

if TYPE_CHECKING:
    from jitterkit.optics.pupil import Pupil

_LOG = logging.getLogger(__name__)

_STEPS = 1000
"""Fewest whole numbers from dark to peak: of 255, moments were off by nine errors of 3e5 electrons."""

_SHARE, _FALLEN = 0.01, 0.7
"""Share of the light that a level as at the edge would have, and ratio of the edge to what lies a quarter of
the way to the middle, from which it is no star's wing: one that falls with the distance squared has 0.56."""

_SAME, _CUT, _POWERS = 0.01, 0.02, (2.5, 4.0)
"""Relative difference of two scales, share of the light that may be cut off, and powers of the distance with
which wings fall: of a hard aperture with the third."""


def toliman(**options: int) -> Pupil:
    """Make TOLIMAN's diffractive pupil; see :func:`jitterkit.optics.toliman.toliman_pupil`."""
    from jitterkit.optics.toliman import toliman_pupil

    return toliman_pupil(**options)


def jwst() -> Pupil:
    """Draw a pupil like JWST's; see :func:`jitterkit.optics.observatories.jwst_pupil`."""
    from jitterkit.optics.observatories import jwst_pupil

    return jwst_pupil()


def hst() -> Pupil:
    """Draw a pupil like Hubble's; see :func:`jitterkit.optics.observatories.hst_pupil`."""
    from jitterkit.optics.observatories import hst_pupil

    return hst_pupil()


def plain(diameter: float, obscuration: float = 0.0, **options: Any) -> Pupil:
    """Make an obstructed circle; see :func:`jitterkit.optics.pupil.obstructed_circle`."""
    from jitterkit.optics.pupil import obstructed_circle

    return obstructed_circle(diameter, obscuration, **options)


def from_file(path: Path, diameter: float | None = None) -> Pupil:
    """Read a pupil; see :func:`jitterkit.optics.pupil_file.read_pupil`."""
    from jitterkit.optics.pupil_file import read_pupil

    return read_pupil(path, diameter)


def star(path: Path, hdu: int | None = None, pitch: float | None = None, *, whole: bool = True) -> np.ndarray:
    """Read a star image ``(ny, nx)`` from a FITS or TIFF file, less the bias that its header names.

    Parameters
    ----------
    path : Path
    hdu : int, optional
    pitch : float, optional
        arcsec that a sample is said to be wide; a header that contradicts it is warned of.
    whole : bool
        Whether the image is taken to hold all light; if much lies beyond its edge, that is warned of.

    Raises
    ------
    ConfigurationError
        If a pixel of it is masked, its samples are light at points, or :func:`check_star` refuses it.
    FrameError
        If it cannot be read.
    """
    with open_frames(path, hdu=hdu) as frames:
        frame, points = frames[0], frames.text("DET_SAMP")
    if points:
        problem = f"{path}: has the light at points, by DET_SAMP = {points}, and not that of whole pixels"
        raise ConfigurationError(ErrorCode.SAMPLING, f"{problem}; convert it by 'jitterkit instrument'.")
    if frame.mask.any():
        problem = f"{path}: {int(frame.mask.sum())} pixels of the star have no value"
        raise ConfigurationError(ErrorCode.MISSING_VALUE, f"{problem}; interpolate over them first.")
    image = frame.data - frame.metadata.value("bias", 0.0)
    check_star(path, image)
    scale = frame.metadata.plate_scale
    if scale is not None and pitch is not None and abs(scale.value / pitch - 1) > _SAME:
        _LOG.warning(
            "%s: a sample is %.4g arcsec wide by its %s, and %.4g by plate_scale and oversample, which are "
            "used.", path, scale.value, scale.source, pitch
        )  # fmt: skip
    beyond = _beyond(image)
    if whole and beyond > _CUT:
        _LOG.warning(
            "%s: about %.0f %% of the star's light lie beyond the edge, so that fluxes are too small; say "
            "enclosed, the share inside.", path, 100 * beyond
        )  # fmt: skip
    return image


def check_star(path: Path, image: np.ndarray) -> None:
    """Refuse a star image of few steps or with a pedestal, and warn of a small background.

    Raises
    ------
    ConfigurationError
        If it has fewer than 1000 whole numbers from dark to bright, its sum is not positive, or its edge
        would hold a third of all its light.
    """
    steps = image - image.min()
    if np.all(steps == np.rint(steps)) and 0 < steps.max() < _STEPS:
        problem = f"{path}: the star has {steps.max():g} steps from dark to bright, which cut its wings"
        remedy = "give it in 16 bits, exposed for longer, or as the mean of several frames"
        raise ConfigurationError(ErrorCode.SAMPLING, f"{problem}; {remedy}.")
    if not image.sum() > 0:
        problem = f"{path}: the star's image sums to {image.sum():.4g}, and must be positive"
        message = f"{problem}; subtract the background level, not more."
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, message)
    edge = _edge(image)
    if edge * image.size > image.sum() / 3:
        problem = f"{path}: the edge of the star's image stands at {edge:g}"
        found = "so that a third or more of its sum is background; subtract it"
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, f"{problem}, {found}.")
    ny, nx = image.shape
    inside = _edge(image[ny // 8 : ny - ny // 8, nx // 8 : nx - nx // 8])
    share = edge * image.size / (image.sum() - edge * image.size)
    if abs(share) > _SHARE and abs(edge) > _FALLEN * abs(inside):
        _LOG.warning(
            "%s: the star's image does not fall towards its edge, which stands at %.3g: if that is "
            "background, fluxes are wrong by %.0f %%; subtract it.", path, edge, 100 * share
        )  # fmt: skip


def _beyond(image: np.ndarray) -> float:
    """Return the share of the light outside, if a wing goes on to fall as it does towards the edge."""
    ny, nx = image.shape
    edge, inside = _edge(image), _edge(image[ny // 8 : ny - ny // 8, nx // 8 : nx - nx // 8])
    if not 0 < edge < _FALLEN * inside:
        return 0.0
    power = np.clip(np.log(inside / edge) / np.log(4 / 3), *_POWERS)
    outside = 0.5 * np.pi * edge * image.size / (power - 2)
    return float(outside / (image.sum() + outside))


def _edge(image: np.ndarray) -> float:
    """Return the median of the outermost pixels."""
    return float(np.median(np.concatenate([image[0], image[-1], image[:, 0], image[:, -1]])))


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
