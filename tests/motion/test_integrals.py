"""Integrals of a spectrum piece by piece."""

import numpy as np
import pytest

from jitterkit.motion import PowerSpectrum
from jitterkit.motion.spectrum import panel_integrals


def test_panels_end_within_the_rows_and_hold_all_of_the_power():
    rows = np.array([0.5, 2.0, 8.0])
    spectrum = PowerSpectrum(rows, np.tile([2.0, 0.0, 1.0], (3, 1)))
    ends, integrals = panel_integrals(spectrum, period=1.0, edges=[0.1, 1.3, 20.0])
    assert (ends[0], ends[-1]) == (0.5, 8.0)
    assert 1.3 in ends
    assert len(integrals) == len(ends) - 1
    assert integrals.sum(axis=(0, 1)) == pytest.approx([15.0, 0.0, 7.5])
