"""One frame in the headers, units and layouts of observatories' pipelines and of amateurs' programs."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from astropy.io import fits
from frames_variants import (
    BIAS,
    CAMERA,
    EXPOSURE,
    FOCUS,
    GAIN,
    LACKS_BIAS,
    NOISE,
    SCALE,
    Made,
    Variant,
    adu,
    decam,
    error_of,
    hdu,
    head,
    hst,
    jwst,
    lsst,
    mosaic,
    save,
    simple,
    spoiled,
)


def asinh(made: Made) -> np.ndarray:
    """Pan-STARRS: v = BOFFSET + BSOFTEN (e^x - e^-x), x = stored ln(10)/2.5."""
    return (np.arcsinh(made.signal / 2 / 50) * 2.5 / np.log(10)).astype(np.float32)


_CAPTURE = {"EXPTIME": EXPOSURE, "EXPOSURE": EXPOSURE, "FOCALLEN": FOCUS, "XPIXSZ": 3.8, "YPIXSZ": 3.8,
            "XBINNING": 1, "YBINNING": 1}  # fmt: skip


def capture(program: str, key: str = "SWCREATE", pixels: Callable = adu, **cards: Any):
    return simple(pixels, **{**_CAPTURE, key: program, **cards})


def turned(made: Made) -> np.ndarray:
    return made.adu[::-1]


def small(made: Made) -> np.ndarray:
    return (made.adu / np.float32(65535)).astype(np.float32)


_CALIBRATED = {"bias": 0.0, "pixels": lambda made: made.signal}
_OF_ONE = {"bias": BIAS, "read_noise": NOISE, "gain": GAIN}
_HISTORY = "ImageIntegration.numberOfImages: 4"

DIALECTS = [
    Variant("HST WFC3 flc", "ELECTRONS, ERR, DQ", hst),
    Variant("HST WFC3 flt, two chips", "ELECTRONS, SCI/ERR/DQ twice", lambda p, m: hst(p, m, 2), frames=2),
    Variant("HST WFC3/IR flt", "ELECTRONS/S, ERR, DQ", lambda p, m: hst(p, m, rate=True, DETECTOR="IR")),
    Variant("HST drz", "ELECTRONS/S, WHT (time), CTX", lambda p, m: save(
        p, {"TELESCOP": "HST", "EXPTIME": EXPOSURE, "READNSEA": NOISE, "ATODGNA": GAIN},
        hdu(m.electrons / 10, "SCI", wcs=True, BUNIT="ELECTRONS/S"), hdu(0 * m.electrons + 10, "WHT"),
        hdu(np.ones((48, 48), np.int32), "CTX"))),
    Variant("HST raw", "COUNTS with bias", lambda p, m: save(
        p, {"TELESCOP": "HST", "EXPTIME": EXPOSURE, "READNSEA": NOISE, "ATODGNA": GAIN, "CCDAMP": "A"},
        hdu(m.adu, "SCI", wcs=True, BUNIT="COUNTS")), LACKS_BIAS),
    Variant("JWST rate", "DN/s, ERR, DQ, VAR_*", jwst, "read_noise bias plate_scale exposure"),
    Variant("JWST rate, no gain known", "DN/s, ERR, DQ, VAR_*", jwst),
    Variant("JWST rateints", "cube of DN/s", lambda p, m: jwst(p, m, planes=2),
            "read_noise bias plate_scale exposure", frames=2),
    Variant("JWST cal", "MJy/sr with PHOTMJSR", lambda p, m: jwst(p, m, "MJy/sr", factor=0.5, PHOTMJSR=0.5),
            "read_noise bias plate_scale exposure"),
    Variant("JWST i2d without PHOTMJSR", "MJy/sr", lambda p, m: jwst(p, m, "MJy/sr")),
    Variant("LSST calexp", "electron, mask, variance", lsst),
    Variant("LSST calexp in nJy", "nJy", lambda p, m: lsst(p, m, "nJy")),
    Variant("HSC calexp", "adu, mask, variance", lambda p, m: lsst(p, m, "adu")),
    Variant("Euclid VIS", "electron, RMS, FLG", lambda p, m: save(
        p, {"TELESCOP": "Euclid", "EXPTIME": EXPOSURE}, hdu(spoiled(m.electrons)[0], "1-1.SCI", wcs=True,
        BUNIT="electron", GAIN=GAIN, RDNOISE=NOISE), hdu(error_of(m.electrons), "1-1.RMS"),
        hdu(spoiled(m.adu)[1].astype(np.int32), "1-1.FLG"))),
    Variant("ESO FORS2", "HIERARCH CONAD, RON", simple(adu, True, EXPTIME=EXPOSURE, **{
        "ESO DET OUT1 CONAD": GAIN, "ESO DET OUT1 GAIN": 1 / GAIN, "ESO DET OUT1 RON": NOISE}), LACKS_BIAS),
    Variant("ESO HAWK-I", "mean of NDIT 4", lambda p, m: fits.PrimaryHDU(
        (m.total / 4).astype(np.float32), head({"EXPTIME": EXPOSURE, "ESO DET NDIT": 4,
        "ESO DET DIT": EXPOSURE,
        "ESO DET OUT1 CONAD": GAIN, "ESO DET OUT1 RON": NOISE}, wcs=True)).writeto(p), LACKS_BIAS,
        {"pixels": lambda m: m.total / 4, "gain": 4 * GAIN, "read_noise": 2 * NOISE, "per": 4}, _OF_ONE),
    Variant("DECam ooi, ood, oow", "electrons in three files", decam, suffix="_ooi_g_v1.fits"),
    Variant("DECam raw", "overscan, GAINA/B", lambda p, m: mosaic(
        p, m, ("N1",), {"INSTRUME": "DECam", "EXPTIME": EXPOSURE}, True, PIXSCAL1=SCALE, GAINA=GAIN,
        GAINB=GAIN,
        RDNOISEA=NOISE, RDNOISEB=NOISE), LACKS_BIAS),
    Variant("Keck NIRC2", "sum of COADDS, ITIME", simple(
        lambda m: m.total.astype(np.int32), ITIME=EXPOSURE, COADDS=4, TELESCOP="Keck II", INSTRUME="NIRC2"),
        "exposure", {"pixels": lambda m: m.total, "bias": 4 * BIAS, "read_noise": 2 * NOISE, "flux": 4},
        _OF_ONE),
    Variant("Keck LRIS", "amplifiers VidInp1, 2", lambda p, m: mosaic(
        p, m, ("VidInp1", "VidInp2"), {"INSTRUME": "LRIS", "EXPTIME": EXPOSURE}, True),
        "exposure", frames=2),
    Variant("Gemini GMOS raw", "amplifiers, overscan", lambda p, m: mosaic(
        p, m, ("", ""), {"INSTRUME": "GMOS-N", "OBSERVAT": "Gemini-North", "EXPTIME": EXPOSURE}, True,
        GAIN=GAIN, RDNOISE=NOISE, PIXSCALE=SCALE), LACKS_BIAS),
    Variant("Gemini DRAGONS", "electron, VAR, DQ", lambda p, m: save(
        p, {"OBSERVAT": "Gemini-South", "EXPTIME": EXPOSURE}, hdu(spoiled(m.electrons)[0], "SCI", wcs=True,
        BUNIT="electron", GAIN=1.0, RDNOISE=NOISE), hdu(error_of(m.electrons) ** 2, "VAR",
        BUNIT="electron**2"),
        hdu(spoiled(m.adu)[1].astype(np.uint16), "DQ"))),
    Variant("NOAO Mosaic", "im1, im2 with overscan", lambda p, m: mosaic(
        p, m, ("im1", "im2"), {"OBSERVAT": "KPNO", "EXPTIME": EXPOSURE, "PIXSCALE": SCALE}, True, GAIN=GAIN,
        RDNOISE=NOISE), LACKS_BIAS, frames=2),
    Variant("IRAF ccdproc", "overscan, zero, trimmed", simple(
        lambda m: m.signal, OBSERVAT="KPNO", EXPTIME=EXPOSURE, GAIN=GAIN, RDNOISE=NOISE, CCDSUM="1 1",
        PIXSCALE=SCALE, OVERSCAN="Nov 21 Overscan section is [49:56,1:48] with mean=100.",
        ZEROCOR="Nov 21 Zero level correction image is Zero"), file=LACKS_BIAS, truth=_CALIBRATED),
    Variant("IRAF ccdproc, bias in the instrument file", "the same", simple(
        lambda m: m.signal, OBSERVAT="KPNO", EXPTIME=EXPOSURE, GAIN=GAIN, RDNOISE=NOISE, PIXSCALE=SCALE,
        ZEROCOR="Nov 21 Zero level correction image is Zero"), LACKS_BIAS,
        _CALIBRATED, {"bias": BIAS}),
    Variant("SDSS fpC", "SOFTBIAS 1000 added", simple(
        lambda m: (m.adu + 900).astype(np.uint16), EXPTIME=EXPOSURE, SOFTBIAS=1000, ORIGIN="SDSS",
        GAIN=GAIN,
        READNOIS=NOISE, PIXSCALE=SCALE), truth={"pixels": lambda m: m.adu + 900.0, "bias": 1000.0}),
    Variant("SDSS frame", "nanomaggy", simple(lambda m: m.signal * 0.005, True, BUNIT="nanomaggy")),
    Variant("Pan-STARRS", "asinh by BSOFTEN, BOFFSET", simple(
        asinh, True, BSOFTEN=50.0, BOFFSET=0.0, EXPTIME=EXPOSURE, **{"HIERARCH CELL.GAIN": GAIN}),
        "exposure plate_scale",
        _CALIBRATED),
    Variant("Spitzer bcd", "MJy/sr with FLUXCONV", simple(
        lambda m: m.signal / 10 * 0.5, True, TELESCOP="Spitzer", EXPTIME=EXPOSURE, BUNIT="MJy/sr",
        FLUXCONV=0.5,
        GAIN=GAIN, RONOISE=NOISE), file=LACKS_BIAS, truth=_CALIBRATED),
    Variant("LCO BANZAI", "electron, BPM, ERR, fpacked", lambda p, m: save(
        p, {}, fits.CompImageHDU(spoiled(m.electrons)[0], head({"BUNIT": "electron", "GAIN": 1.0,
        "RDNOISE": NOISE,
        "EXPTIME": EXPOSURE, "SATURATE": 1e5, "ORIGIN": "LCOGT"}, wcs=True), name="SCI", quantize_level=16),
        fits.CompImageHDU(spoiled(m.adu)[1].astype(np.uint8), name="BPM"),
        fits.CompImageHDU(error_of(m.electrons), name="ERR", quantize_level=16)), suffix=".fits.fz"),
    Variant("ZTF sci", "ADU, PIXSCALE", simple(
        lambda m: m.signal, EXPTIME=EXPOSURE, GAIN=(GAIN, "Gain [electrons/ADU]"), READNOI=NOISE,
        SATURATE=6e4,
        PIXSCALE=(SCALE, "[arcsec/pixel]")), file=LACKS_BIAS, truth=_CALIBRATED),
    Variant("TESS FFI", "e/s, EXPOSURE in days", lambda p, m: save(
        p, {"TELESCOP": "TESS"}, hdu(m.electrons / 10, wcs=True, BUNIT="e/s", EXPOSURE=(
        EXPOSURE / 86400, "[d] time on source"), READNOIA=NOISE)), "gain bias plate_scale exposure"),
    Variant("UKIRT WFCAM", "EXP_TIME, NEXP 4 summed", lambda p, m: save(
        p, {"OBSERVAT": "UKIRT", "EXP_TIME": EXPOSURE, "NEXP": 4}, fits.CompImageHDU(m.total, head(
        {"GAIN": GAIN, "READNOIS": NOISE}, wcs=True))), LACKS_BIAS,
        {"pixels": lambda m: m.total, "bias": 4 * BIAS, "read_noise": 2 * NOISE, "flux": 4}, _OF_ONE),
    Variant("Swift UVOT", "COUNT, EXPOSURE", simple(
        lambda m: np.rint(m.electrons).astype(np.int32), True, TELESCOP="SWIFT", BUNIT="count",
        EXPOSURE=EXPOSURE),
        "plate_scale exposure", {"bias": 0.0, "gain": 1.0, "pixels": lambda m: np.rint(m.electrons)}),
    Variant("N.I.N.A.", "GAIN 100, EGAIN, TOP-DOWN", capture(
        "N.I.N.A. 3.1", pixels=turned, GAIN=100, OFFSET=10, EGAIN=GAIN, ROWORDER="TOP-DOWN"),
        f"gain {CAMERA}"),
    Variant("N.I.N.A. without EGAIN", "GAIN 100", capture("N.I.N.A. 3.1", GAIN=100, OFFSET=10), CAMERA),
    Variant("SharpCap", "14 bits scaled to 16", capture(
        "SharpCap", pixels=lambda m: (m.adu * 4).astype(np.uint16), GAIN=120, BLKLEVEL=25,
        ROWORDER="BOTTOM-UP",
        EGAIN=GAIN), f"gain {CAMERA}", {"pixels": lambda m: m.adu * 4.0, "gain": GAIN / 4,
        "bias": 4 * BIAS}, _OF_ONE),
    Variant("INDI, Ekos", "SCALE, PIXSIZE1", simple(
        turned, EXPTIME=EXPOSURE, SCALE=SCALE, PIXSIZE1=3.8, PIXSIZE2=3.8, XBINNING=1, YBINNING=1,
        FOCALLEN=FOCUS,
        APTDIA=125, GAIN=100.0, OFFSET=30.0, ROWORDER="TOP-DOWN", INSTRUME="ZWO CCD ASI183MM Pro"), CAMERA),
    Variant("ASIAIR", "GAIN setting", capture("ZWO ASIAIR Plus", "CREATOR", GAIN=120, OFFSET=8), CAMERA),
    Variant("ASTAP stack", "mean of 4, LIGH_CNT", capture(
        "ASTAP", pixels=lambda m: (m.total / 4 - BIAS).astype(np.float32), CALSTAT="BDFS", LIGH_CNT=4,
        EGAIN=GAIN),
        f"gain bias {CAMERA}", {"pixels": lambda m: m.total / 4 - BIAS, "bias": 0.0, "gain": 4 * GAIN,
        "read_noise": 2 * NOISE, "per": 4}, _OF_ONE),
    Variant("MaxIm DL", "EGAIN, CALSTAT empty", capture(
        "MaxIm DL Version 6.20", EGAIN=GAIN, CBLACK=90, CWHITE=900, PEDESTAL=0), f"gain {CAMERA}"),
    Variant("MaxIm DL calibrated", "PEDESTAL -100", capture(
        "MaxIm DL Version 6.20", EGAIN=GAIN, CALSTAT="BDF", PEDESTAL=-100), f"gain bias {CAMERA}"),
    Variant("SBIG CCDOps", "PEDESTAL -100", capture("SBIGFITS", EGAIN=GAIN, PEDESTAL=-100, CALSTAT="D"),
            f"gain bias {CAMERA}"),
    Variant("PixInsight", "float from 0 to 1", capture("PixInsight", "CREATOR", small, EGAIN=GAIN),
        f"gain {CAMERA}"),
    Variant("PixInsight stack", "float from 0 to 1, HISTORY", capture(
        "PixInsight", "CREATOR", lambda m: (m.total / np.float32(4 * 65535)).astype(np.float32),
        HISTORY=_HISTORY)),
    Variant("Siril 16 bits", "CVF", capture("Siril v1.2", "PROGRAM", turned, CVF=GAIN, ROWORDER="TOP-DOWN"),
            f"gain {CAMERA}"),
    Variant("Siril 32 bits", "float from 0 to 1", capture("Siril v1.2", "PROGRAM", small, CVF=GAIN)),
    Variant("Siril stack", "STACKCNT, LIVETIME", capture(
        "Siril v1.2", "PROGRAM", lambda m: (m.total / 4).astype(np.float32), CVF=GAIN, STACKCNT=4,
        LIVETIME=4 * EXPOSURE), f"gain {CAMERA}",
        {"pixels": lambda m: m.total / 4, "gain": 4 * GAIN, "read_noise": 2 * NOISE, "per": 4}, _OF_ONE),
    Variant("AstroImageJ", "decimal commas", simple(
        lambda m: m.signal, EXPTIME="10,0", GAIN=("1,7", "[e-/ADU]"), RDNOISE="4,0", PIXSCALE="0,4"),
        file=LACKS_BIAS, truth=_CALIBRATED),
    Variant("CCDciel", "GAIN setting, PIXSCALE", simple(
        adu, EXPTIME=EXPOSURE, SWCREATE="CCDciel 0.9", GAIN=100, PIXSCALE=SCALE, XPIXSZ=3.8,
        FOCALLEN=FOCUS), CAMERA),
    Variant("INDIGO", "GAIN setting", capture("INDIGO 2.0", GAIN=10.0, OFFSET=5.0), CAMERA),
    Variant("Seestar", "mosaic of colours", capture("Seestar S50", "CREATOR", BAYERPAT="GRBG", GAIN=80),
        CAMERA),
    Variant("Nebulosity", "EXPOSURE only", simple(
        adu, EXPOSURE=EXPOSURE, CREATOR="Nebulosity 4", XPIXSZ=3.8, FOCALLEN=FOCUS), CAMERA),
    Variant("TheSkyX", "EGAIN, 2x2 binned", capture(
        "TheSkyX", pixels=lambda m: m.adu.reshape(24, 2, 24, 2).sum((1, 3)).astype(np.uint16), EGAIN=GAIN,
        XPIXSZ=7.6,
        YPIXSZ=7.6, XBINNING=2, YBINNING=2), f"gain {CAMERA}", {"pixels": lambda m: m.adu.reshape(24, 2,
        24, 2).sum(
        (1, 3)), "bias": 4 * BIAS, "read_noise": 2 * NOISE, "plate_scale": 2 * SCALE}),
    Variant("QHY EZCAP", "EXPTIME in ms without a word", capture("EZCAP", EXPTIME=1e4, EXPOSURE=1e4),
        "plate_scale"),
]  # fmt: skip
