"""Blur of a field of stars: one kernel for all of them, and whether it is tracking or optics.

Reach for :func:`estimate_field`; :func:`roundest` picks the frame of a set that may serve as its reference.
"""

from jitterkit.starfield.field import FieldEstimate, estimate_field, roundest
from jitterkit.starfield.field_pattern import FieldPattern, classify_field
from jitterkit.starfield.psf import Psf, field_psf
