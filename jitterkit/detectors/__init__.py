"""Detectors: from ADU to electrons with a variance and a mask, and from electrons to ADU with noise.

:class:`Detector` does both; ``detector_preset("imx183")`` is one that comes with jitterkit.
"""

from jitterkit.detectors.detector import Detector
from jitterkit.detectors.pixel_units import NORMALISED
from jitterkit.detectors.presets import DETECTORS, detector_preset

__all__ = ["DETECTORS", "NORMALISED", "Detector", "detector_preset"]
