"""Instruments that come with jitterkit.

The detector of TOLIMAN is a Sony IMX183 (in a camera such as the FLIR BFS-U3-200S6M): 2.4 um pixels,
12 bits, a full well of about 15 ke- and about 3.7 e-/ADU.  Its read noise of 2.4 e- is an estimate; the
bias of 30 ADU is our choice, 46 sigma above zero and low enough for the well to fill (4084 ADU) before
the converter ends (4095 ADU).  ``toliman-camera`` has the numbers that are published, and what else a
camera does, from :mod:`jitterkit.detectors.detector`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

from jitterkit.detectors import Detector, detector_preset
from jitterkit.detectors.detector import sourced_detector
from jitterkit.errors import one_of
from jitterkit.instruments import pupils
from jitterkit.instruments.instrument import Instrument
from jitterkit.optics.colours import Colours, colours_of
from jitterkit.optics.spectrum import Spectrum, flat_band

if TYPE_CHECKING:
    from jitterkit.optics.pupil import Pupil


PHOTONS = 9.53e6
"""Photons of alpha Cen AB in 0.1 s through TOLIMAN's true collecting area, 114.67 cm²."""

PAPER_PHOTONS = 3.811e7
"""The paper's figure: its area of 458.7 cm² takes diameters for radii (preset ``toliman-paper``)."""

_NIRCAM = "JWST documentation, NIRCam Detector Performance: long waves"
_WFC3 = "WFC3 Instrument Handbook, table 5.1"

_NUMBERS = ("gain", "read_noise", "bias", "full_well", "bits")
_QUANTITIES = ("plate_scale", "exposure", "flux", "shape", "spectrum", "pupil")


ALPHA_CEN = (5790.0, 5260.0)
"""Effective temperatures of alpha Cen A and B, K (Porto de Mello et al., Astron. Astrophys. 488, 653, 2008:
5824 and 5223; Kervella et al., Astron. Astrophys. 597, A137, 2017: 5795 and 5231)."""


def toliman() -> Instrument:
    """TOLIMAN as it would be: 0.375 arcsec pixels, 128 x 128, 530-640 nm, an IMX183.

    The brightest pixel of a sharp frame holds 14.7 ke-: the well is just full.
    """
    band = flat_band(530.0, 640.0, 13)
    return Instrument(
        name="toliman",
        plate_scale=0.375,
        shape=(128, 128),
        detector=_imx183("toliman"),
        spectrum=band,
        colours=colours_of(ALPHA_CEN, band),
        pupil_from=pupils.toliman,
        exposure=0.1,
        flux=PHOTONS,
        sources=dict.fromkeys(_QUANTITIES, "preset toliman"),
    )


def toliman_paper() -> Instrument:
    """TOLIMAN as in the paper: four times the photons, one spectrum, Noll 4 to 10, an ideal detector."""
    words = "preset toliman-paper (an ideal detector)"
    ideal = Detector(gain=1.0, read_noise=0.0, bias=0.0, sources=dict.fromkeys(_NUMBERS, words))
    pupil = partial(pupils.toliman, highest=10)
    return _variant("toliman-paper", flux=PAPER_PHOTONS, detector=ideal, colours=None, pupil_from=pupil)


def smallsat() -> Instrument:
    """A plain telescope that needs no other package: 0.125 m, obscured by 0.04 m, three struts of 2 mm.

    Everything else is TOLIMAN's, but the light of a star falls on a few pixels, so the scene is
    fainter: the brightest pixel of a sharp frame holds two thirds of the well.
    """
    pupil, detector = partial(pupils.plain, 0.125, 0.04, struts=3, strut_width=0.002), _imx183("smallsat")
    return _variant("smallsat", pupil_from=pupil, colours=Colours(), flux=1.3e5, detector=detector)


def toliman_camera() -> Instrument:
    """TOLIMAN with the whole camera as far as it is known: rolling shutter, dark current, noise by EMVA 1288.

    See :mod:`jitterkit.detectors.detector`.  The brightest pixel of a sharp frame is just full.
    """
    return _variant("toliman-camera", detector=detector_preset("imx183"))


def jwst() -> Instrument:
    """Return a segmented telescope like JWST: NIRCam's long-wave channel, 0.063 arcsec pixels, at 4.8 um.

    A sharp star in the middle of a pixel fills two thirds of its well.
    """
    return _observatory(
        "jwst",
        {
            "plate_scale": (0.063, "JWST documentation, NIRCam Observing Modes"),
            "exposure": (10.73677, "JWST documentation, NIRCam Detector Readout: one frame"),
            "flux": (5.6e5, "a choice: two thirds of the well"),
        },
        {
            "gain": (1.82, _NIRCAM),
            "read_noise": (13.25, f"{_NIRCAM}: correlated double sampling"),
            "bias": (1000.0, "a choice: 137 sigma above zero"),
            "dark_current": (0.0342, _NIRCAM),
            "full_well": (83300.0, _NIRCAM),
            "bits": (16, "JWST documentation, NIRCam Detector Overview"),
        },
        Spectrum((4800.0,), (1.0,)),
        pupils.jwst,
    )


def hst() -> Instrument:
    """Return a two-mirror telescope like Hubble: WFC3/UVIS, 0.04 arcsec pixels, F814W.

    The detector undersamples the optics.  A sharp star in the middle of a pixel fills two thirds of its well.
    """
    return _observatory(
        "hst",
        {
            "plate_scale": (0.040, _WFC3),
            "exposure": (10.0, "a choice"),
            "flux": (2.1e5, "a choice: two thirds of the well"),
        },
        {
            "gain": (1.55, _WFC3),
            "read_noise": (3.1, _WFC3),
            "bias": (2500.0, "a choice"),
            "dark_current": (11 / 3600, _WFC3),
            "full_well": (63000.0, f"{_WFC3}: the least of the chips"),
            "bits": (16, _WFC3),
        },
        flat_band(802.4 - 153.6 / 2, 802.4 + 153.6 / 2, 9),
        pupils.hst,
    )


PRESETS: Mapping[str, Callable[[], Instrument]] = {
    "toliman": toliman,
    "toliman-paper": toliman_paper,
    "toliman-camera": toliman_camera,
    "smallsat": smallsat,
    "jwst": jwst,
    "hst": hst,
}
"""Every preset by name."""


def preset(name: str) -> Instrument:
    """Make the preset of a name.

    Raises
    ------
    ConfigurationError
        If there is none; the message lists those there are.
    """
    return PRESETS[one_of("instrument", name, PRESETS, "a TOML file")]()


def _observatory(
    name: str,
    numbers: Mapping[str, tuple[float, str]],
    detector: Mapping[str, tuple[float, str]],
    spectrum: Spectrum,
    pupil: Callable[[], Pupil],
) -> Instrument:
    """Return an instrument of 64 x 64 pixels whose numbers come each with its source."""
    sources = dict.fromkeys(_QUANTITIES, f"preset {name} (docs instruments)")
    sources |= {key: f"preset {name} ({words})" for key, (_, words) in numbers.items()}
    return Instrument(
        name=name,
        shape=(64, 64),
        detector=sourced_detector(name, detector),
        spectrum=spectrum,
        pupil_from=pupil,
        sources=sources,
        **{key: value for key, (value, _) in numbers.items()},  # type: ignore[arg-type]
    )


def _variant(name: str, **changes: Any) -> Instrument:
    """Return TOLIMAN with some numbers changed, all of them those of another preset."""
    return replace(toliman(), name=name, sources=dict.fromkeys(_QUANTITIES, f"preset {name}"), **changes)


def _imx183(name: str) -> Detector:
    sources = dict.fromkeys(_NUMBERS, f"preset {name} (IMX183, about)")
    sources |= {"read_noise": f"preset {name} (IMX183, an estimate)", "bias": f"preset {name} (a choice)"}
    return Detector(gain=3.7, read_noise=2.4, bias=30.0, full_well=15000.0, bits=12, sources=sources)
