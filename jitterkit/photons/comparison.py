"""A photon budget in lines, beside what the paper published.

Reach for :func:`compare`.  The paper (appendix A, and the notebook it points to) takes TOLIMAN's diameters
for radii, so that its area, and its photons per exposure, are four times too large.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from jitterkit.photons.area import annulus_area
from jitterkit.photons.budget import PhotonBudget

_DIAMETER, _OBSCURATION = 0.125, 0.032
"""m, of TOLIMAN: the figures that the paper takes for radii."""

_RATE, _RATES = 8.309e5, (6.342e5, 1.967e5)
"""Published: photons/s/cm² of both (paper), of A and of B (notebook), from Phoenix atmospheres."""

_AREA, _EXPOSURE, _PHOTONS = 458.7, 0.1, 3.811e7
"""Published by both: cm², s, photons per exposure."""

_CONTRAST = 3.37
"""Published: of the paper's model; 2.5 log10 of it is the difference in V, while the notebook's rates in the
band have 3.22."""


@dataclass(frozen=True)
class Line:
    """A quantity, what it is here, and what paper and notebook published (NaN where they are silent)."""

    quantity: str
    unit: str
    here: float
    paper: float = math.nan
    notebook: float = math.nan


def compare(budget: PhotonBudget, published: bool = True) -> list[Line]:
    """Say a budget in lines.

    Parameters
    ----------
    budget : PhotonBudget
        Its ``area`` is that of the pupil.
    published : bool
        Whether to set the published figures beside, and to say the photons by the paper's area too: for
        TOLIMAN.

    Returns
    -------
    lines : list of Line
    """
    rates, both, area = "photons/s/cm²", budget.rate, budget.area
    true, slip = annulus_area(_DIAMETER, _OBSCURATION), annulus_area(2 * _DIAMETER, 2 * _OBSCURATION)
    lines = [
        Line("rate of A", rates, budget.rates[0], notebook=_RATES[0]),
        Line("rate of B", rates, budget.rates[1], notebook=_RATES[1]),
        Line("rate of both", rates, both, _RATE, _RATE),
        Line("contrast in the band", "", budget.contrast, _CONTRAST, _RATES[0] / _RATES[1]),
        Line("mean wavelength", "nm", budget.mean_wavelength),
        Line("exposure", "s", budget.exposure, _EXPOSURE, _EXPOSURE),
        Line("area of the pupil", "cm²", area),
        Line("photons by it", "", budget.photons),
        Line("area without struts", "cm²", true),
        Line("photons by it", "", budget.photons_through(true)),
        Line("area, diameters for radii", "cm²", slip, _AREA, _AREA),
        Line("photons by it", "", budget.photons_through(slip), _PHOTONS, _PHOTONS),
    ]
    return lines if published else [Line(x.quantity, x.unit, x.here) for x in lines[:8]]
