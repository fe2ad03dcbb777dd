"""What the variants of a frame are made with: the exposures, and writers of several programs' files."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from astropy.io import fits

GAIN, NOISE, BIAS, SCALE, EXPOSURE, TIME = 1.7, 4.0, 100.0, 0.4, 10.0, "2026-11-21T03:00:00"
FOCUS = 206264.80624709636 * 3.8e-3 / SCALE
"""mm, behind which a pixel of 3.8 um sees SCALE."""

ALL = "gain read_noise bias plate_scale exposure"
LACKS_BIAS = "gain read_noise plate_scale exposure"
CAMERA = "plate_scale exposure"
"""Numbers that a file states, or does not need."""


@dataclass(frozen=True)
class Made:
    """Four exposures of one star that differ by noise: uint16 ADU."""

    exposures: tuple[np.ndarray, ...]

    @property
    def adu(self) -> np.ndarray:
        return self.exposures[0]

    @property
    def second(self) -> Made:
        """The same with another exposure first."""
        return Made(self.exposures[1:])

    @property
    def signal(self) -> np.ndarray:
        """ADU above the bias."""
        return self.adu.astype(np.float32) - BIAS

    @property
    def electrons(self) -> np.ndarray:
        return (self.signal * GAIN).astype(np.float32)

    @property
    def total(self) -> np.ndarray:
        return np.sum(self.exposures, axis=0, dtype=np.uint16)


@dataclass(frozen=True)
class Variant:
    """A way to store the frame.

    Parameters
    ----------
    name, stored : str
        Who writes so, and what.
    write : callable
        Called with a path and :class:`Made`.
    file : str
        Numbers that the file states, or does not need; the instrument file gives the others.
    truth : mapping
        Numbers that differ from the frame's: those of the pixels, ``pixels`` themselves (a function of
        :class:`Made`), ``per``, exposures that are averaged, and ``flux``, exposures that are summed.
    said : mapping
        What the instrument file says in their place.
    frames : int
        That are in the file.
    suffix : str
    """

    name: str
    stored: str
    write: Callable[[Path, Made], Any]
    file: str = ALL
    truth: Mapping[str, Any] = field(default_factory=dict)
    said: Mapping[str, Any] = field(default_factory=dict)
    frames: int = 1
    suffix: str = ".fits"


def head(cards: Mapping[str, Any] | None = None, *, wcs: bool = False, time: bool = True) -> fits.Header:
    header = fits.Header()
    for key, value in {**({"DATE-OBS": TIME} if time else {}), **(cards or {})}.items():
        header[key] = value
    if wcs:
        header.update(CTYPE1="RA---TAN", CTYPE2="DEC--TAN", CRVAL1=219.9, CRVAL2=-60.8)
        header.update(CRPIX1=24.5, CRPIX2=24.5, CD1_1=-SCALE / 3600, CD1_2=0.0, CD2_1=0.0, CD2_2=SCALE / 3600)
    return header


def hdu(data: np.ndarray | None, name: str = "", version: int = 1, wcs: bool = False, **cards: Any):
    made = fits.ImageHDU(data, head(cards, wcs=wcs, time=False))
    if name:
        made.name, made.ver = name, version
    return made


def save(path: Path, primary: Mapping[str, Any], *hdus: Any, wcs: bool = False) -> None:
    fits.HDUList([fits.PrimaryHDU(None, head(primary, wcs=wcs)), *hdus]).writeto(path)


def simple(pixels: Callable[[Made], np.ndarray], wcs: bool = False, **cards: Any):
    """Return what writes one primary HDU."""

    def write(path: Path, made: Made) -> None:
        fits.PrimaryHDU(pixels(made), head(cards, wcs=wcs)).writeto(path)

    return write


def adu(made: Made) -> np.ndarray:
    return made.adu


def spoiled(image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the image with a bad pixel in the star, and where it is."""
    bad = np.zeros(image.shape, bool)
    bad[22, 27] = True
    return np.where(bad, 3 * image.max(), image).astype(image.dtype), bad


def error_of(electrons: np.ndarray, factor: float = 1.0) -> np.ndarray:
    return (np.sqrt(np.maximum(electrons, 0) + NOISE**2) * factor).astype(np.float32)


def hst(path: Path, made: Made, chips: int = 1, rate: bool = False, **cards: Any) -> None:
    time, unit = (EXPOSURE, "ELECTRONS/S") if rate else (1.0, "ELECTRONS")
    images = [spoiled(one.electrons / np.float32(time)) for one in (made, made.second)]
    primary = {"TELESCOP": "HST", "INSTRUME": "WFC3", "DETECTOR": "UVIS", "EXPTIME": EXPOSURE, "CCDAMP": "A"}
    primary |= {"CCDGAIN": 1.5, "ATODGNA": GAIN, "READNSEA": NOISE, "BIASCORR": "COMPLETE", **cards}
    planes = []
    for chip, (image, bad) in enumerate(images[:chips], 1):
        planes += [
            hdu(image, "SCI", chip, wcs=True, BUNIT=unit, CCDCHIP=chip),
            hdu(error_of(made.electrons, 1 / time), "ERR", chip, BUNIT=unit),
            hdu((bad * 16).astype(np.int16), "DQ", chip, BUNIT="UNITLESS"),
        ]
    save(path, primary, *planes)


def jwst(path: Path, made: Made, unit: str = "DN/s", planes: int = 0, factor: float = 1.0, **cards: Any):
    scale, count = factor / EXPOSURE, max(planes, 1)
    images = [spoiled(one.signal * np.float32(scale)) for one in (made, made.second)][:count]
    shot = np.maximum(made.signal, 0) / GAIN * scale**2
    read = np.full_like(shot, (NOISE / GAIN * scale) ** 2)

    def cube(*layers: np.ndarray) -> np.ndarray:
        return np.stack(layers * (count // len(layers))) if planes else layers[0]

    primary = {"TELESCOP": "JWST", "INSTRUME": "NIRCAM", "EXPOSURE": ("00006", "Exposure request number")}
    primary |= {"EFFEXPTM": EXPOSURE * count, "EFFINTTM": EXPOSURE, "NINTS": count, "DATE-BEG": TIME}
    science, quality = (cube(*layers) for layers in zip(*images, strict=True))
    hdus = [
        hdu(science, "SCI", wcs=True, BUNIT=unit, PIXAR_A2=SCALE**2, **cards),
        hdu(cube(np.sqrt(shot + read)), "ERR", BUNIT=unit),
        hdu(quality.astype(np.uint32), "DQ"),
        hdu(cube(shot), "VAR_POISSON"),
        hdu(cube(read), "VAR_RNOISE"),
    ]
    save(path, primary, *hdus)


def lsst(path: Path, made: Made, unit: str = "electron", **cards: Any) -> None:
    image, bad = spoiled(made.electrons if unit != "adu" else made.signal)
    variance = error_of(made.electrons) ** 2 / (GAIN**2 if unit == "adu" else 1)
    science = hdu(image, wcs=True, EXTTYPE="IMAGE", **({"BUNIT": unit} if unit else {}))
    mask = hdu((bad * 1 + (made.signal > 50) * 32).astype(np.int32), EXTTYPE="MASK", MP_BAD=0, MP_DETECTED=5)
    save(path, {"EXPTIME": EXPOSURE, **cards}, science, mask, hdu(variance, EXTTYPE="VARIANCE"))


def with_overscan(image: np.ndarray) -> np.ndarray:
    """Return the image with eight columns of the bias level on the right."""
    noise = np.random.default_rng(5).normal(BIAS, NOISE / GAIN, (len(image), 8))
    return np.hstack([image, np.rint(noise).astype(image.dtype)])


SECTIONS = {"BIASSEC": "[49:56,1:48]", "TRIMSEC": "[1:48,1:48]", "DATASEC": "[1:48,1:48]"}


def mosaic(
    path: Path, made: Made, names: tuple[str, ...], primary: Mapping[str, Any], over: bool, **cards: Any
):
    cards |= SECTIONS if over else {}
    images = [with_overscan(one.adu) if over else one.adu for one in (made, made.second)]
    named = zip(images, names, (1, 2), strict=False)
    save(path, primary, *(hdu(image, name, version, **cards) for image, name, version in named))


def decam(path: Path, made: Made) -> None:
    image, bad = spoiled(made.electrons)
    stem = str(path)
    primary = {"INSTRUME": "DECam", "TELESCOP": "CTIO 4.0-m telescope", "EXPTIME": EXPOSURE}
    own = {"GAINA": 1.0, "GAINB": 1.0, "RDNOISEA": NOISE, "RDNOISEB": NOISE, "CCDNUM": 1}
    save(path, primary, hdu(image, "N1", wcs=True, BUNIT="electrons", **own))
    save(Path(stem.replace("ooi", "ood")), primary, hdu(bad.astype(np.int16), "N1"))
    weight = 1 / error_of(made.electrons) ** 2
    save(Path(stem.replace("ooi", "oow")), primary, hdu(weight, "N1"))
