"""Windowed moments: the variance of any path, whatever its shape."""

import numpy as np
import pytest
from refusals import refused

from jitterkit.errors import ErrorCode, UndeterminedError
from jitterkit.estimators.moments import estimate_moments
from jitterkit.forward import Parameters, expected_image
from jitterkit.likelihood import Data
from jitterkit.loci import Linear, Mvn, Shm, Stable
from jitterkit.scene import Binary


def scene(x=0.1, flux=3e6):
    return Binary(5.0, 40.0, x, 0.05, flux, 3.37)


@pytest.mark.parametrize("locus", [Linear.of(1.5, 20.0), Shm.of(1.5, 20.0), Mvn.of(0.5, 0.1, 20.0)])
def test_a_wide_blur_has_its_variance_whatever_its_shape(locus, otf):
    image = np.asarray(expected_image(Parameters(scene(), locus), otf))
    found = estimate_moments(Data(image), Parameters(scene(), Stable.of()), otf)
    # the window trades the bias of the shape against noise: about an error, and small in itself
    truth = np.asarray(locus.moments())
    np.testing.assert_allclose(found.moments, truth, atol=0.03 * truth.max())


def test_place_and_flux_need_not_be_known(otf):
    locus = Mvn.of(0.2, 0.1, 20.0)
    image = np.asarray(expected_image(Parameters(scene(), locus), otf))
    found = estimate_moments(Data(image), Parameters(scene(0.2, 2e6), Stable.of()), otf)
    # the equations are solved: a fiftieth of an error is left where they end
    np.testing.assert_array_less(np.abs(found.moments - np.asarray(locus.moments())), 0.02 * found.errors)


def test_an_empty_frame_is_refused(otf, rng):
    with refused(ErrorCode.MODEL_MISMATCH, error=UndeterminedError):
        estimate_moments(Data(rng.normal(0, 3, otf.grid.shape), 9.0), Parameters(scene(), Stable.of()), otf)
