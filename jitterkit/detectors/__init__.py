"""Detectors: from ADU to electrons with a variance and a mask, and from electrons to ADU with noise."""

from jitterkit.detectors.detector import Detector

__all__ = ["Detector"]
