"""Derivatives on a grid with less padding, against those on the whole grid in 64 bits."""

from dataclasses import replace

import numpy as np
import pytest

from jitterkit.forward import Parameters, expected_image, free_parameters
from jitterkit.likelihood import Data, normal_equations
from jitterkit.locate.padding import MAY_MOVE, grid_for_derivatives
from jitterkit.loci import Mvn
from jitterkit.optics import Anchor, AnchoredOptics, Grid, OpticalSystem, lines
from jitterkit.precision import single
from jitterkit.scene import Binary

SCALE, FRAME = 0.375, 64
STATE, CHANGE = np.zeros(7), np.array([1.0, -0.5, 0.3, 0.2, 0.7, 0.1, -1.0])


@pytest.fixture(scope="module")
def anchored(toliman):
    system = OpticalSystem(toliman, lines(585.0), Grid((FRAME, FRAME), SCALE))
    anchor = Anchor.at(system, STATE)
    return AnchoredOptics.about(system, anchor, 1e7)


def pair(off: float, flux: float) -> Parameters:
    """A pair off the middle by a share of the frame."""
    scene = Binary(6.0, 0.3, off * FRAME * SCALE, 0.0, flux, 0.3)
    return Parameters(scene, Mvn(np.array([0.04, 0.005, 0.02])), STATE, 2.0)


@pytest.mark.parametrize(("off", "flux"), [(0.0, 1e5), (0.0, 1e7), (0.2, 1e6), (0.4, 1e4)])
def test_errors_by_the_chosen_grid_are_those_of_the_whole_wherever_a_frame_may_have_its_stars(
    off, flux, anchored
):
    reference = pair(off, flux)
    grid = grid_for_derivatives(reference, anchored.nominal)
    assert grid is None or grid.fine_shape < anchored.nominal.grid.fine_shape
    assert (grid is None) is (off == 0.4)
    if grid is None:
        return
    optics = replace(anchored, coarse=single(anchored.anchor.within(grid)))
    for move in (-1, 1):
        where = reference.shifted(move * MAY_MOVE * SCALE, MAY_MOVE * SCALE)
        where = replace(where, aberrations=CHANGE)
        otf = optics.otf(CHANGE)
        image = np.asarray(expected_image(where, otf))
        data = Data(image, np.full(image.shape, 9.0), np.ones(image.shape, bool))
        _, free = free_parameters(where, otf)
        exact = normal_equations(where, replace(otf, coarse=None), data, free)
        here = normal_equations(where, otf, data, free, exact=False)
        root = np.linalg.cholesky(np.linalg.inv(exact.information))
        shares = np.linalg.eigvalsh(root.T @ here.information @ root)
        assert np.abs(shares - 1).max() < 2e-4
        assert np.abs(root.T @ here.score).max() < 1e-3  # sigmas; the image is exact
