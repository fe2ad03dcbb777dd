"""Detectors: from ADU to electrons with a variance and a mask, and from electrons to ADU with noise.

:class:`Detector` does both; ``detector_preset("imx183")`` is one that comes with jitterkit.
"""

from jitterkit.detectors.detector import DETECTORS, Detector, detector_preset
from jitterkit.detectors.file_variance import NORMALISED
