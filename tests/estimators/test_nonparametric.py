"""Kernels without a model of the motion: their moments, and where they lie on the pixels."""

import equinox as eqx
import numpy as np
import pytest
from refusals import refused

from jitterkit.errors import ErrorCode, UndeterminedError
from jitterkit.estimators import ESTIMATORS
from jitterkit.forward import Parameters, expected_image
from jitterkit.kernel_estimate import significance
from jitterkit.likelihood import Data
from jitterkit.loci import Linear, Shm, Stable
from jitterkit.scene import Binary

FREE = ["nnls", "richardson-lucy"]
_image = eqx.filter_jit(expected_image)


def scene(x=0.1, y=0.05, flux=3e6):
    return Binary(5.0, 40.0, x, y, flux, 3.37)


def frame(locus, otf):
    return Data(np.asarray(_image(Parameters(scene(), locus), otf)))


@pytest.mark.parametrize("name", FREE)
@pytest.mark.parametrize("locus", [Linear.of(0.8, 20.0), Shm.of(0.8, 20.0)], ids=["drift", "vibration"])
def test_moments_are_those_of_any_path(name, locus, otf):
    found = ESTIMATORS[name](frame(locus, otf), Parameters(scene(), Stable.of()), otf)
    # nodes 0.075 arcsec apart lie up to half of that beside a line: h²/24 on average, 1 % of these moments
    np.testing.assert_allclose(found.moments, np.asarray(locus.moments()), atol=3 * 0.075**2 / 24)


@pytest.mark.parametrize("name", FREE)
def test_the_kernel_lies_on_the_frames_pixels_as_the_path_does(name, otf):
    found = ESTIMATORS[name](frame(Linear.of(2.0, 0.0), otf), Parameters(scene(), Stable.of()), otf)
    assert found.kernel is not None
    assert all(n % 2 == 1 for n in found.kernel.shape)
    assert found.kernel.sum() == pytest.approx(1.0)
    # a drift of 2 arcsec along x spends 0.375/2 of its time on each pixel of the middle row
    middle = found.kernel.shape[0] // 2
    assert found.kernel[middle].sum() > 0.8
    assert found.kernel[:, middle].sum() == pytest.approx(0.375 / 2, abs=0.1)


@pytest.mark.parametrize("name", FREE)
def test_a_misplaced_template_is_no_blur(name, otf):
    locus = Linear.of(0.4, 70.0)
    right, aside = (
        ESTIMATORS[name](frame(locus, otf), Parameters(scene(x, y), Stable.of()), otf)
        for x, y in ((0.1, 0.05), (0.325, 0.05))  # three nodes further along x
    )
    # the same nodes but for those at the border: what is left is the way of the updates
    np.testing.assert_array_less(np.abs(aside.moments - right.moments), 0.5 * right.errors)
    # the kernel moves against the template: from the middle pixel to the one on its left
    middle = right.kernel.shape[0] // 2
    assert right.kernel[:, middle].sum() > 0.9
    assert aside.kernel[:, middle - 1].sum() > 0.6


@pytest.mark.parametrize("name", FREE)
def test_flux_need_not_be_known(name, otf):
    data = frame(Linear.of(0.4, 70.0), otf)
    known, guessed = (
        ESTIMATORS[name](data, Parameters(scene(flux=flux), Stable.of()), otf) for flux in (3e6, 1e6)
    )
    np.testing.assert_allclose(guessed.moments, known.moments, atol=0.2 * known.errors.max())


@pytest.mark.parametrize("name", FREE)
def test_a_kernel_without_room_is_refused(name, otf):
    with refused(ErrorCode.MODEL_MISMATCH, "4 pixels", error=UndeterminedError):
        ESTIMATORS[name](frame(Linear.of(6.0, 0.0), otf), Parameters(scene(), Stable.of()), otf)


def test_a_covariance_that_knows_nothing_of_a_direction_has_no_significance():
    moments = np.array([1.0, 0.0, 1.0])
    assert significance(moments, np.diag([1.0, 4.0, 0.25])) == pytest.approx(1 + 4)  # 1²/1 + 1²/0.25
    for covariance in (np.zeros((3, 3)), np.ones((3, 3)), np.full((3, 3), np.nan)):
        assert np.isnan(significance(moments, covariance))
