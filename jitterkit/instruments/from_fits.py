"""An instrument file of a PSF or a pupil that poppy, webbpsf or stpsf wrote.

:func:`instrument_from_fits` is the way in, and the command ``jitterkit instrument``.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from jitterkit.errors import ConfigurationError, ErrorCode, FrameError, refuse_if
from jitterkit.frames import write_fits
from jitterkit.frames.fits import NamedImage, read_images
from jitterkit.frames.sidecar import toml_text
from jitterkit.frames.writer import replacing
from jitterkit.instruments.instrument import Instrument
from jitterkit.instruments.psf_fits import EffectivePsf, effective_psf
from jitterkit.instruments.pupil_fits import is_pupil, pupil_arrays
from jitterkit.optics.spectrum import LIGHT, Spectrum, flat_band

Tables = dict[str, dict[str, Any]]


def instrument_from_fits(
    path: str | Path,
    output: str | Path,
    *,
    kind: str | None = None,
    plate_scale: float | None = None,
    shape: tuple[int, int] | None = None,
    hdu: int | None = None,
    centre: tuple[float, float] | None = None,
    jittered: bool = False,
    band: tuple[float, float] | None = None,
    wavelength: float | None = None,
    opd: str | Path | None = None,
    opd_unit: str | None = None,
    plane: int | None = None,
    diameter: float | None = None,
    noll: Sequence[int] = (),
    overwrite: bool = False,
) -> list[str]:
    """Write an instrument file, and the PSF or pupil that it names, of a FITS file.

    Parameters
    ----------
    path : str or Path
        FITS: a PSF or a pupil of poppy, webbpsf or stpsf.
    output : str or Path
        The instrument file, ``.toml``; the PSF (``-psf.fits``) or pupil (``-pupil.npz``) lies beside it.
    kind : str, optional
        ``psf`` or ``pupil``, where the header does not tell.
    plate_scale : float, optional
        arcsec per detector pixel; a pupil never tells.
    shape : (int, int), optional
        Rows and columns that are fitted.  By default half of a PSF's width and height, so that wherever in it
        a star is, the PSF reaches every pixel; that of the instrument file for a pupil.
    hdu, centre, jittered
        Of a PSF: see :func:`~jitterkit.instruments.psf_fits.effective_psf`.
    band : (float, float), optional
        nm, of a pupil's light, flat in photons.
    wavelength : float, optional
        nm, of a pupil's light, in place of a band.
    opd, opd_unit, plane, diameter
        Of a pupil: see :func:`~jitterkit.instruments.pupils.pupil_arrays`.
    noll : sequence of int
        Of a pupil: the aberrations that may vary, on the circle about its lit samples.
    overwrite : bool
        Whether files that exist may be replaced.

    Returns
    -------
    remarks : list of str
        What was read and what was taken, a sentence each.

    Raises
    ------
    ConfigurationError
        If a value is missing, impossible or does not go with the kind of file.
    FrameError
        If a file cannot be read or written.
    """
    path, output = Path(path), Path(output)
    if output.suffix.lower() != ".toml":
        raise ConfigurationError(ErrorCode.WRONG_SUFFIX, f"{output}: an instrument file ends in .toml.")
    images, _ = read_images(path)
    if not images:
        raise FrameError(ErrorCode.NO_IMAGE, path, "holds no image", "give a PSF or a pupil")
    of_psf = {"hdu": hdu, "centre": centre, "jittered": jittered or None}
    of_light = {"band": band, "wavelength": wavelength}
    of_wavefront = {"opd": opd, "opd_unit": opd_unit, "plane": plane}
    of_pupil = of_light | of_wavefront | {"diameter": diameter, "noll": noll or None}
    holds_pupil = is_pupil(images) if kind is None else kind == "pupil"
    if holds_pupil is None or kind not in (None, "psf", "pupil"):
        code = ErrorCode.MISSING_VALUE if kind is None else ErrorCode.UNKNOWN_NAME
        problem = f"{path}: whether it is a PSF or a pupil is not said (kind = {kind})"
        raise ConfigurationError(code, f"{problem}; give --kind psf or pupil.")
    given = " --noll ".join(map(str, noll))
    problem = f"{path}: --noll {given}; give each of Noll's indices once, from 2."
    refuse_if(any(j < 2 for j in noll), ErrorCode.OUT_OF_RANGE, problem)
    refuse_if(len(set(noll)) < len(noll), ErrorCode.DUPLICATE, problem)
    kind, others = ("pupil", of_psf) if holds_pupil else ("psf", of_pupil)
    for key, value in others.items():
        if value is not None:
            problem = f"{path}: {key} = {value!r} does not go with a {kind}; leave it out."
            raise ConfigurationError(ErrorCode.CONFLICT, problem)
    names = [str(images[0].header.get(key, "")).strip() for key in ("INSTRUME", "FILTER")]
    name = " ".join(filter(None, names)) or path.name.partition(".")[0]
    if not holds_pupil:
        psf = effective_psf(path, images, hdu=hdu, plate_scale=plate_scale, centre=centre, jittered=jittered)
        file = output.with_name(f"{output.stem}-psf.fits")
        tables, remarks = _write_psf(file, psf, name, shape, overwrite)
    else:
        second = None if opd is None else (Path(opd), read_images(Path(opd))[0])
        arrays = pupil_arrays(path, images, second, diameter=diameter, opd_unit=opd_unit, plane=plane)
        light = _light(path, images, band, wavelength)
        if plate_scale is None:
            problem = (
                f"{path}: a pupil does not say how wide a pixel is; give --plate-scale, in arcsec/pixel."
            )
            raise ConfigurationError(ErrorCode.MISSING_VALUE, problem)
        head: dict[str, Any] = {"name": name, "plate_scale": plate_scale}
        head |= {} if shape is None else {"shape": list(shape)}
        file = output.with_name(f"{output.stem}-pupil.npz")
        tables, remarks = _write_pupil(file, arrays, head, light, noll, overwrite)
    with replacing(output, overwrite) as temporary:
        temporary.write_text(toml_text(tables, *_source(path, images)), encoding="utf-8")
    return [*remarks, f"wrote {file}", f"wrote {output}"]


def _source(path: Path, images: Sequence[NamedImage]) -> list[str]:
    """Comments for the head of the file: where it comes from, and the wavelengths of a PSF."""
    header = images[0].header
    count = header.get("NWAVES")
    waves = [header.get(f"WAVE{k}") for k in range(count)] if isinstance(count, int) and count < 1000 else []
    known = [float(wave) for wave in [*waves, header.get("WAVELEN")] if isinstance(wave, float)]
    light = [f"light of {min(known) * 1e9:g} to {max(known) * 1e9:g} nm"] if known else []
    return [f"made by jitterkit instrument of {path.name}", *light]


def _light(
    path: Path, images: Sequence[NamedImage], band: tuple[float, float] | None, wavelength: float | None
) -> dict[str, Any]:
    """Read the table [spectrum]."""
    if band is not None and wavelength is not None:
        problem = f"{path}: --band {band} and --wavelength {wavelength:g}: give one of the two."
        raise ConfigurationError(ErrorCode.CONFLICT, problem)
    if band is not None:
        return {"band": list(band)}
    written = images[0].quantity("pupil_scale", "WAVELEN")  # of a wavefront that poppy wrote
    wavelength = written * 1e9 if wavelength is None and written is not None else wavelength
    if wavelength is None:
        problem = f"{path}: a pupil does not say which light it is for; give --band or --wavelength, in nm."
        raise ConfigurationError(ErrorCode.MISSING_VALUE, problem)
    low, high = LIGHT
    if not low <= wavelength <= high:
        problem = f"{path}: {wavelength:g} nm is no wavelength of light ({low:g} to {high:g} nm)"
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, f"{problem}; give --wavelength, in nm.")
    return {"lines": [wavelength]}


def _write_psf(
    file: Path, psf: EffectivePsf, name: str, shape: tuple[int, int] | None, overwrite: bool
) -> tuple[Tables, list[str]]:
    """Write a PSF; return the tables of the instrument file, and remarks."""
    shape = tuple(max(1, n // 2) for n in psf.width) if shape is None else shape  # type: ignore[assignment]
    assert shape is not None
    options: dict[str, Any] = {"oversample": psf.oversample, "centre": list(psf.centre)}
    if psf.enclosed is not None:
        options["enclosed"] = psf.enclosed
    Instrument(name, psf.plate_scale, shape, psf_from=psf.pixels, psf_options=options).system()
    write_fits(file, psf.pixels, header={"OVERSAMP": psf.oversample}, overwrite=overwrite)
    head = {"name": name, "plate_scale": psf.plate_scale, "shape": list(shape)}
    x, y = psf.offset
    light = "" if psf.enclosed is None else f", which holds {psf.enclosed:.2%} of the light"
    size = f"{psf.plate_scale:.6g} arcsec/pixel, {psf.width[1]} x {psf.width[0]} pixels"
    return {"instrument": head, "psf": {"file": file.name, **options}}, [
        f"HDU {psf.hdu} {psf.name}: {size}{light}",
        f"the light's centroid lies ({x:+.4g}, {y:+.4g}) arcsec from the axis, which is sample "
        f"({psf.centre[0]:g}, {psf.centre[1]:g}) of {file.name}",
        f"shape = {list(shape)} is fitted",
    ]


def _write_pupil(
    file: Path,
    arrays: tuple[np.ndarray, np.ndarray, float],
    head: dict[str, Any],
    light: dict[str, Any],
    noll: Sequence[int],
    overwrite: bool,
) -> tuple[Tables, list[str]]:
    """Write a pupil; return the tables of the instrument file, and remarks."""
    from jitterkit.conventions import offsets
    from jitterkit.optics.pupil import Pupil, zernike
    from jitterkit.optics.pupil_file import write_pupil

    transmission, opd, width = arrays
    # modes on the smallest circle about the array's centre that holds all lit samples
    axis = offsets(len(transmission), 1.0)
    x, y = np.meshgrid(axis, axis)
    radius = np.hypot(x, y)[transmission > 0].max(initial=1.0) + 0.5
    modes = np.array([zernike(j, x / radius, y / radius) for j in noll]).reshape(-1, *transmission.shape)
    pupil = Pupil(transmission, width, opd, modes, [f"noll{j}" for j in noll])
    spectrum = flat_band(*light["band"]) if "band" in light else Spectrum(tuple(light["lines"]), (1.0,))
    shape = tuple(head.get("shape", (128, 128)))
    Instrument(head["name"], head["plate_scale"], shape, spectrum=spectrum, pupil_from=pupil).system()
    with replacing(file, overwrite) as temporary:
        write_pupil(temporary, pupil)
    lit = transmission > 0
    rms = float(np.std(opd[lit])) if lit.any() else 0.0
    size = f"{len(transmission)} x {len(transmission)} samples, {width:.6g} m wide"
    remark = f"{size}, {pupil.cutoff_diameter:.4g} m lit, wavefront error {rms:.4g} nm rms"
    return {"instrument": head, "telescope": {"pupil": file.name}, "spectrum": light}, [remark]
