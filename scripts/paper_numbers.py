"""What the paper published: values to compare with, each with the place where it stands.

No other file of the reproduction holds a published value that its own code could compute.
"""

from __future__ import annotations

from typing import NamedTuple


class Published(NamedTuple):
    """A value and where the paper has it."""

    value: float
    where: str


SIGMA = Published(241.0, "sec. 1, eq. 3; fig. 1")
"""µas: error of the separation of one frame without jitter."""

FRAMES = Published(60000.0, "eq. 3")
MINUTES = Published(97.0, "sec. 1")
EXPOSURE = Published(0.1, "sec. 1")
"""s."""

PHOTONS = Published(3.811e7, "sec. 2; app. A")
AREA = Published(458.7, "app. A")
"""cm²."""

RATE = Published(8.309e5, "app. A")
"""photons/s/cm²."""

DRIFT = Published(0.1, "sec. 1; fig. 3")
"""arcsec: in one exposure, at the pointing system's goal."""

DRAWS = Published(10000.0, "sec. 3.4; fig. 5")
MAGNITUDES = (0.2, 0.4, 0.6)
"""Pixels: sizes of the jitters that are fitted with each other (sec. 3.4)."""

SHEARS = (0.1, 0.7)
"""Of the normals that are fitted (sec. 3.4)."""

DIAMETER, OBSCURATION = 0.125, 0.032
"""m, of TOLIMAN: the figures behind the area."""

SEPARATION, CONTRAST = 10.0, 3.37
"""arcsec, and flux of A over that of B, of the paper's model."""
