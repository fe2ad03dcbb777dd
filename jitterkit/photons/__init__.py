"""Photons: how many of them a pair of stars gives to an exposure.

    stars = (blackbody(5790, 0.01), blackbody(5260, 1.33))
    budget = count_photons(stars, Throughput(flat_curve(530, 640)), area=114.67, exposure=0.1)

``budget.photons`` is the number of detected photons, ``budget.contrast`` the pair's in the band and
``budget.spectrum()`` their spectrum for the optics.  Spectra, filters and quantum efficiencies come from
CSV files by :func:`read_curve`.  Nothing is ever fetched: synphot (extra ``spectra``) is given every number.
"""

from jitterkit.photons.budget import Line, PhotonBudget, compare, count_photons
from jitterkit.photons.curve import (
    IMX183_QE,
    Curve,
    Throughput,
    annulus_area,
    band_of,
    collecting_area,
    flat_curve,
    read_curve,
)
from jitterkit.photons.stars import blackbody, tabulated
