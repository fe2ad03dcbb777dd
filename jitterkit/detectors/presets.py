"""Detectors that come with jitterkit, with the source of each number.

``detector_preset("imx183")`` is the camera FLIR BFS-U3-200S6M: a Sony IMX183, 5472 x 3648 pixels of 2.4 um,
12 bits, rolling shutter.  Sony publishes no noise figures and we have no report by EMVA 1288 of this camera;
Balluff's (Matrix Vision's) of the mvBlueFOX3-2205, which holds the same sensor, gives SNRmax = 41.6 dB,
DNR = 71.5 dB and 22 frames/s of 3692 rows.  By EMVA 1288 that is

* a full well of 10^(41.6/10) = 14.5 ke-;
* a smallest signal of 10^(41.6/10 - 71.5/20) = 3.85 e- = 1/2 + sqrt(sigma² + 1/4), so that sigma is 3.3 e-
  with the converter's rounding and 3.1 e- without;
* 12.3 us from row to row at that camera's full speed.

What is not published and not measured is either called a choice or left out: there is no flat, no
non-linearity (amateurs find a QHY183M, with the same sensor, straight to 3400 of 4095 ADU), no coupling
and no diffusion.  Measure your own camera's and name its maps in an instrument file.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from jitterkit.detectors.detector import Detector
from jitterkit.errors import ConfigurationError, ErrorCode, did_you_mean

_EMVA = "EMVA 1288 of Balluff's mvBlueFOX3-2205, same sensor"

_IMX183: Mapping[str, tuple[float, str]] = {
    "gain": (3.6, "an estimate: the well fills the converter's 4095 ADU"),
    "read_noise": (3.1, f"{_EMVA}: DNR 71.5 dB, less rounding"),
    "bias": (30.0, "a choice: 33 sigma above zero, and the well fills before the converter ends"),
    "full_well": (14500.0, f"{_EMVA}: SNRmax 41.6 dB"),
    "bits": (12, "Sony IMX183"),
    "dark_current": (1.0, "a choice: uncooled; 0.1 e- in 0.1 s"),
    "line_time": (15e-6, "an estimate: 18 frames/s of 3648 rows; the sensor's fastest is 12.3 us"),
}


def imx183() -> Detector:
    """The camera FLIR BFS-U3-200S6M; the module's introduction says what is known of it."""
    values = {name: value for name, (value, _) in _IMX183.items()}
    sources = {name: f"preset imx183 ({words})" for name, (_, words) in _IMX183.items()}
    return Detector(**values, sources=sources)  # type: ignore[arg-type]


DETECTORS: Mapping[str, Callable[[], Detector]] = {"imx183": imx183}
"""Every detector by name."""


def detector_preset(name: str) -> Detector:
    """Make the detector of a name.

    Raises
    ------
    ConfigurationError
        If there is none; the message lists those there are.
    """
    if name in DETECTORS:
        return DETECTORS[name]()
    hint = did_you_mean(name, DETECTORS)
    raise ConfigurationError(
        ErrorCode.UNKNOWN_NAME, f"There is no detector {name!r}; {hint}choose from {', '.join(DETECTORS)}."
    )
