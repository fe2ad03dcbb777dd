"""One frame in the layouts, types and numbers that any program may write: FITS, astropy's objects, TIFF."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from astropy import units
from astropy.io import fits
from astropy.nddata import CCDData, InverseVariance, StdDevUncertainty, VarianceUncertainty
from frames_variants import (
    ALL,
    BIAS,
    EXPOSURE,
    GAIN,
    LACKS_BIAS,
    NOISE,
    SCALE,
    TIME,
    Made,
    Variant,
    adu,
    error_of,
    hdu,
    head,
    save,
    simple,
    spoiled,
    with_overscan,
)

_PLAIN = {"EXPTIME": EXPOSURE, "EGAIN": GAIN, "RDNOISE": NOISE, "PIXSCALE": SCALE}
_CALIBRATED = {"bias": 0.0, "pixels": lambda made: made.signal}
_ELECTRONS = {"EXPTIME": EXPOSURE, "RDNOISE": NOISE, "PIXSCALE": SCALE, "BUNIT": "electron"}
_SUM = {"pixels": lambda made: made.total, "bias": 4 * BIAS, "read_noise": 2 * NOISE, "flux": 4}
_MEAN = {"pixels": lambda made: made.total / 4, "gain": 4 * GAIN, "read_noise": 2 * NOISE, "per": 4}
_OF_ONE = {"bias": BIAS, "read_noise": NOISE, "gain": GAIN}


def plain(name: str, stored: str, pixels=adu, *, said=None, truth=None, file: str = LACKS_BIAS, **cards: Any):
    """Return a variant with the numbers of a plain frame and other cards; None leaves a number out."""
    kept = {key: value for key, value in (_PLAIN | cards).items() if value is not None}
    return Variant(name, stored, simple(pixels, **kept), file, truth or {}, said or {})


def electrons(name: str, stored: str, pixels, **cards: Any):
    kept = {key: value for key, value in (_ELECTRONS | cards).items() if value is not None}
    return Variant(name, stored, simple(pixels, **kept))


def packed(made_of, **options: Any):
    def write(path: Path, made: Made) -> None:
        fits.HDUList([fits.PrimaryHDU(), fits.CompImageHDU(made_of(made), head(_PLAIN), **options)]).writeto(
            path
        )

    return write


def scaled(path: Path, made: Made) -> None:
    """Store floats as 16 bits with BSCALE and BZERO."""
    image = fits.PrimaryHDU(made.electrons, head(_ELECTRONS))
    image.scale("int16", "minmax")
    image.writeto(path)


def ccd(
    kind: type | None, power: float = 1.0, unit: Any = units.electron, rate: float = 1.0, mask: bool = True
):
    """Return what writes a CCDData with an uncertainty of a kind."""

    def write(path: Path, made: Made) -> None:
        image, bad = spoiled(made.electrons / np.float32(rate))
        error = error_of(made.electrons, 1 / rate)
        one = CCDData(image, unit=unit, mask=bad if mask else None, header=dict(_ELECTRONS, BUNIT=""))
        one.header.pop("BUNIT")
        one.header["DATE-OBS"] = TIME
        one.uncertainty = None if kind is None else kind(error**power)
        one.write(path)

    return write


def framed(value: float, dtype: Any = np.float32):
    """Return a function of the frame with three outer rows and columns that hold a value."""

    def pixels(made: Made) -> np.ndarray:
        image = np.full(made.adu.shape, value, dtype)
        image[3:-3, 3:-3] = made.adu[3:-3, 3:-3]
        return image

    return pixels


def blank(path: Path, made: Made) -> None:
    image = framed(-32768, np.int16)(made)
    header = head({**_PLAIN, "BLANK": -32768})
    fits.PrimaryHDU(image, header).writeto(path)


def cube(name: str, stored: str, planes, frames: int, **cards: Any):
    return Variant(name, stored, simple(planes, **{**_PLAIN, **cards}), LACKS_BIAS, frames=frames)


def overscan(made: Made) -> np.ndarray:
    return with_overscan(made.adu)


def both(made: Made) -> np.ndarray:
    return np.stack(made.exposures[:2])


def with_error(made: Made) -> np.ndarray:
    return np.stack([made.adu.astype(np.float32), error_of(made.electrons, 1 / GAIN)])


def binned(made: Made) -> np.ndarray:
    return made.adu.reshape(24, 2, 24, 2).sum((1, 3)).astype(np.uint16)


_BINNED = {"pixels": binned, "bias": 4 * BIAS, "read_noise": 2 * NOISE, "plate_scale": 2 * SCALE}
_TOML = (
    f'exposure = {EXPOSURE}\ngain = {GAIN}\nread_noise = {NOISE}\nplate_scale = {SCALE}\ntime = "{TIME}"\n'
)


def tiff(pixels=adu, *, toml: str = _TOML, **options: Any):
    """Return what writes a TIFF, top row first, with a TOML beside it."""

    def write(path: Path, made: Made) -> None:
        tifffile.imwrite(path, pixels(made)[..., ::-1, :], **options)
        if toml:
            path.with_suffix(".toml").write_text(toml)

    return write


def tif(name: str, stored: str, write, file: str = LACKS_BIAS, **more: Any):
    return Variant(name, stored, write, file, suffix=".tif", **more)


_OME = {"axes": "YX", "Plane": {"ExposureTime": [EXPOSURE], "ExposureTimeUnit": ["s"]}}
_WITHOUT = _TOML.replace(f"exposure = {EXPOSURE}\n", "")

LAYOUTS = [
    Variant("numpy array", "float64 without a header", lambda p,
        m: fits.PrimaryHDU(m.adu * 1.0).writeto(p), ""),
    plain("plain header", "uint16 by BZERO"),
    plain("plain header", "float64", lambda m: m.adu * 1.0),
    plain("plain header", "int32", lambda m: m.adu.astype(np.int32)),
    Variant("gzip", "uint16", simple(adu, **_PLAIN), LACKS_BIAS, suffix=".fits.gz"),
    Variant("fpack", "RICE, uint16", packed(adu), LACKS_BIAS, suffix=".fits.fz"),
    Variant("fpack", "RICE, floats quantised", packed(lambda m: m.adu.astype(np.float32), quantize_level=4,
            quantize_method=1), LACKS_BIAS, suffix=".fits.fz"),
    Variant("fpack", "RICE, floats quantised coarsely", packed(lambda m: m.adu.astype(np.float32),
            quantize_level=-8, quantize_method=1), LACKS_BIAS, suffix=".fits.fz"),
    Variant("fpack", "GZIP_2, floats", packed(lambda m: m.adu.astype(np.float32), compression_type="GZIP_2",
            quantize_level=0), LACKS_BIAS, suffix=".fits.fz"),
    Variant("HCOMPRESS", "scale 8", packed(adu, compression_type="HCOMPRESS_1", hcomp_scale=8), LACKS_BIAS),
    Variant("BSCALE", "electrons in int16", scaled),
    plain("degenerate axes", "1 x 1 x 48 x 48", lambda m: m.adu[None, None]),
    electrons("electrons", "float32", lambda m: m.electrons),
    electrons("electrons", "BUNIT e-", lambda m: m.electrons, BUNIT="e-"),
    electrons("electrons per second", "float32", lambda m: m.electrons / 10, BUNIT="electron/s"),
    electrons("electrons per second", "BUNIT e-/sec, EXPTIME in ms", lambda m: m.electrons / 10,
              BUNIT="e-/sec", EXPTIME=(1e4, "[ms]")),
    electrons("electrons per hour", "BUNIT e-/h", lambda m: m.electrons * 360, BUNIT="e-/h"),
    electrons("thousands of electrons", "BUNIT ke-", lambda m: m.electrons / 1e3, BUNIT="ke-"),
    electrons("Jy per beam", "BUNIT Jy/beam", lambda m: m.electrons / 1e3, BUNIT="Jy/beam"),
    electrons("photons", "BUNIT photon", lambda m: m.electrons, BUNIT="photon"),
    plain("electrons, GAIN kept", "no BUNIT", lambda m: m.electrons, truth=_CALIBRATED),
    plain("electrons, GAIN kept", "no BUNIT, GAINCOR T", lambda m: m.electrons, truth=_CALIBRATED,
        GAINCOR=True),
    plain("counts per second", "BUNIT DN/s", lambda m: m.signal / 10, truth=_CALIBRATED, BUNIT="DN/s"),
    plain("counts per second", "BUNIT adu, comment", lambda m: m.signal / 10, truth=_CALIBRATED,
          BUNIT=("adu", "normalized to 1 s")),
    plain("counts per second", "no word", lambda m: m.signal / 10, truth=_CALIBRATED),
    plain("bias subtracted", "bias 0 in the instrument file", lambda m: m.signal, truth=_CALIBRATED),
    plain("bias subtracted", "BIASLVL subtracted", lambda m: m.signal, truth=_CALIBRATED, file=ALL,
          BIASLVL=(100.0, "subtracted")),
    plain("bias subtracted", "SUBBIAS, bias in the instrument file", lambda m: m.signal, truth=_CALIBRATED,
          said=_OF_ONE, SUBBIAS="ccd=<CCDData>, master=<CCDData>"),
    plain("bias subtracted", "no word, bias in the instrument file", lambda m: m.signal, truth=_CALIBRATED,
          said=_OF_ONE),
    plain("bias level", "BIASLVL", file=ALL, BIASLVL=BIAS),
    plain("pedestal", "PEDESTAL 100", file=ALL, PEDESTAL=100),
    plain("stretched", "square root, 8 bits", lambda m: np.clip(np.sqrt(m.signal.clip(0)) * 3, 0,
        255).astype(
          np.uint8), truth=_CALIBRATED),
    plain("12 bits", "multiples of 16", lambda m: (m.adu * 16.0).astype(np.uint16), truth={
          "pixels": lambda m: m.adu * 16.0, "gain": GAIN / 16, "bias": 16 * BIAS}, said=_OF_ONE),
    plain("NaN border", "float32", framed(np.nan)),
    plain("fill value border", "1e30", framed(1e30)),
    plain("zero border", "float32", framed(0.0)),
    plain("border of -999", "float32", framed(-999.0)),
    Variant("BLANK border", "int16", blank, LACKS_BIAS),
    plain("overscan left on", "BIASSEC, TRIMSEC", overscan, BIASSEC="[49:56,1:48]", TRIMSEC="[1:48,1:48]"),
    plain("overscan left on", "DATASEC", overscan, DATASEC="[1:48,1:48]"),
    plain("overscan left on", "no word", overscan),
    plain("overscan left on", "no word, sky of 60 e-",
        lambda m: with_overscan((m.adu + 35).astype(np.uint16))),
    plain("overscan cut off", "TRIM, BIASSEC kept", BIASSEC="[49:56,1:48]", TRIMSEC="[1:48,1:48]",
          TRIM="Nov 21 Trim data section is [1:48,1:48]"),
    plain("rows from the top", "TOP-DOWN", lambda m: m.adu[::-1], ROWORDER="TOP-DOWN"),
    plain("rows from the bottom", "BOTTOM-UP", ROWORDER="BOTTOM-UP"),
    plain("2x2 binned", "PIXSCALE of binned pixels", binned, truth=_BINNED, RDNOISE=2 * NOISE,
        PIXSCALE=2 * SCALE, XBINNING=2),
    plain("2x2 binned", "PIXSCALE of the detector's", binned, truth=_BINNED, RDNOISE=2 * NOISE, XBINNING=2),
    plain("2x2 binned", "PIXSCALE of the detector's, BINNING native", binned, truth=_BINNED,
        RDNOISE=2 * NOISE, BINNING="2x2",
          PIXSCALE=(SCALE, "native, 1x1")),
    plain("sum of four", "NCOMBINE", lambda m: m.total, truth=_SUM, said=_OF_ONE, NCOMBINE=4),
    plain("sum of four", "FRAMES", lambda m: m.total, truth=_SUM, said=_OF_ONE, FRAMES=4),
    plain("sum of four", "no word", lambda m: m.total, truth=_SUM, said=_OF_ONE),
    plain("mean of four", "NCOMBINE", lambda m: m.total / 4, truth=_MEAN, said=_OF_ONE, NCOMBINE=4),
    plain("mean of four", "IMCMB", lambda m: m.total / 4, truth=_MEAN, said=_OF_ONE, IMCMB001="a.fits",
        IMCMB002="b.fits"),
    plain("mean of four", "COMBINED", lambda m: m.total / 4, truth=_MEAN, said=_OF_ONE, COMBINED=True),
    plain("mean of four", "NEXP", lambda m: m.total / 4, truth=_MEAN, said=_OF_ONE, NEXP=4),
    plain("mean of four", "no word", lambda m: m.total / 4, truth=_MEAN, said=_OF_ONE),
    plain("read noise 0", "ADU of a CCD", truth={}, RDNOISE=0.0),
    plain("read noise in ADU", "comment", RDNOISE=(NOISE / GAIN, "[ADU]")),
    plain("gain in ADU/e-", "comment", EGAIN=None, GAIN=(1 / GAIN, "ADU/e-"),
        file="read_noise plate_scale exposure"),
    plain("gain in ADU/e-", "no word", EGAIN=None, GAIN=1 / GAIN),
    plain("gain", "GAIN without a word", EGAIN=None, GAIN=GAIN),
    plain("gain", "'1,7'", EGAIN="1,7"),
    plain("saturation in electrons", "SATURATE 5000 of 8 ke-", SATURATE=(30000, "[electron]")),
    plain("saturation below the star", "SATURATE 2500", SATURATE=2500),
    plain("exposure", "ms", EXPTIME=(1e4, "ms")),
    plain("exposure", "'00:00:10'", EXPTIME="00:00:10", file="gain read_noise plate_scale"),
    plain("exposure", "'10,0'", EXPTIME="10,0"),
    plain("exposure", "ms without a word", EXPTIME=1e4),
    plain("plate scale", "arcmin", PIXSCALE=(SCALE / 60, "[arcmin/pix]")),
    plain("plate scale", "degrees without a word", PIXSCALE=SCALE / 3600),
    plain("plate scale", "CDELT in degrees", PIXSCALE=None, CTYPE1="RA---TAN", CTYPE2="DEC--TAN",
        CRVAL1=219.9,
          CRVAL2=-60.8, CRPIX1=24.0, CRPIX2=24.0, CDELT1=-SCALE / 3600, CDELT2=SCALE / 3600),
    cube("cube", "two exposures", both, 2),
    cube("cube with errors", "planes labelled", with_error, 1, PLANE1="IMAGE", PLANE2="ERROR"),
    cube("cube with errors", "no label", with_error, 1),
    cube("colours", "CTYPE3 RGB", lambda m: np.stack([m.adu] * 3), 0, CTYPE3="RGB"),
    Variant("mask", "1 is good, GOODPIX", lambda p, m: save(p, _PLAIN, hdu(spoiled(m.adu)[0], "SCI"), hdu(
            (~spoiled(m.adu)[1]).astype(np.uint8), "GOODPIX")), LACKS_BIAS),
    Variant("mask", "1 is bad, BPM", lambda p, m: save(p, _PLAIN, hdu(spoiled(m.adu)[0], "SCI"), hdu(
            spoiled(m.adu)[1].astype(np.uint8), "BPM")), LACKS_BIAS),
    Variant("variance", "IVAR of electrons", lambda p, m: save(p, _ELECTRONS, hdu(m.electrons, "SCI"), hdu(
            error_of(m.electrons) ** -2, "IVAR"))),
    Variant("CCDData", "StdDevUncertainty, mask", ccd(StdDevUncertainty)),
    Variant("CCDData", "VarianceUncertainty, mask", ccd(VarianceUncertainty, 2.0)),
    Variant("CCDData", "InverseVariance, mask", ccd(InverseVariance, -2.0)),
    Variant("CCDData", "electron / s", ccd(StdDevUncertainty, 1.0, units.electron / units.s, EXPOSURE)),
    Variant("CCDData", "photon", ccd(None, unit=units.photon, mask=False)),
    tif("TIFF", "uint16, TOML", tiff()),
    tif("TIFF", "big-endian", tiff(byteorder=">")),
    tif("TIFF", "no TOML", tiff(toml=""), ""),
    tif("TIFF", "white is zero", tiff(lambda m: 65535 - m.adu, photometric="miniswhite")),
    tif("TIFF", "white is zero, pixels as they are", tiff(photometric="miniswhite")),
    tif("TIFF", "two pages", tiff(both, photometric="minisblack"), frames=2),
    tif("TIFF", "floats from 0 to 1", tiff(lambda m: (m.adu / np.float32(65535)).astype(np.float32))),
    tif("ImageJ TIFF", "uint16", tiff(imagej=True)),
    tif("ImageJ TIFF", "calibrated, c1 = 1.7", tiff(imagej=True, metadata={
        "cf": 0, "c0": -BIAS * GAIN, "c1": GAIN, "vunit": "electron"}, toml=_TOML.replace("gain",
        "#gain") + 'unit = "electron"')),
    tif("OME-TIFF", "exposure in s", tiff(ome=True, metadata=_OME, toml=_WITHOUT)),
    tif("OME-TIFF", "exposure in ms", tiff(ome=True, metadata={**_OME, "Plane": {
        "ExposureTime": [1e3 * EXPOSURE], "ExposureTimeUnit": ["ms"]}}, toml=_WITHOUT)),
]  # fmt: skip
