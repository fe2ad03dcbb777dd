"""Errors of a star that is narrower than any pointing makes it, against those of a still star."""

import numpy as np
import pytest
from own_images import drift, star_image

from jitterkit.forward import Parameters
from jitterkit.likelihood import Data
from jitterkit.loci import Mvn
from jitterkit.refit import fit_frame
from jitterkit.scene import Star

LIGHT = 3e4


def fitted(pixels, optics):
    start = Parameters(Star(0.6, -1.1, LIGHT), Mvn.near(np.full(3, 1e-3)), np.zeros(2))
    return fit_frame(Data(pixels + 2.0, 9.0), optics, start)


@pytest.mark.parametrize("angle", [0.0, 30.0])
def test_errors_of_a_star_that_is_too_narrow_are_those_of_a_still_one(angle, optics):
    """Else the error of its variance is a half, and in frames that undersample it a seventh."""
    still = star_image(0.6, -1.1, LIGHT, [(0.0, 0.0, 1.0)])
    narrow = fitted(2 * still - star_image(0.6, -1.1, LIGHT, drift(1.0, angle)), optics)
    usual = fitted(still, optics)
    moments, covariance = narrow.moments()
    assert np.linalg.eigvalsh(moments[[0, 1, 1, 2]].reshape(2, 2))[0] < -0.04
    errors, right = np.sqrt(np.diag(covariance)), np.sqrt(np.diag(usual.moments()[1]))
    np.testing.assert_allclose(errors, right, rtol=0.02)
    for name in ("x", "y", "flux"):
        assert narrow.error(name) == pytest.approx(usual.error(name), rel=0.02)
