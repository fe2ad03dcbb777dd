"""Pupils of space telescopes against the areas and symmetries of their geometry."""

import numpy as np
import pytest

from jitterkit.optics.observatories import hst_pupil, jwst_pupil


def test_the_segmented_pupil_has_eighteen_hexagons_behind_three_struts():
    pupil = jwst_pupil()
    light = np.asarray(pupil.transmission)
    hexagons = 18 * np.sqrt(3) / 2 * 1.309**2
    # a strut reaches from the inner hexagon's edge or corner to the outer ones'; the gaps are no shadow
    shadows = 0.12 * (3 * 1.309 / 2 * 2 + 1.309 / 2 + 2 * 3 * 1.309 / np.sqrt(3) / 2 * 2)
    area = light.sum() * pupil.pitch**2
    assert hexagons - 1.2 * shadows < area < hexagons - 0.6 * shadows
    assert light == pytest.approx(light[:, ::-1], abs=1e-12)  # its own mirror image in x
    assert np.abs(light - light[::-1]).max() == 1.0  # but not in y
    centre = light.shape[0] // 2
    assert light[centre - 15 : centre + 15, centre - 15 : centre + 15].max() == 0.0


def test_the_two_mirror_pupil_has_a_baffle_four_vanes_and_three_pads():
    pupil = hst_pupil()
    radius, vane = 1.2, 0.022 * 1.2
    ring = np.pi * radius**2 * (1 - 0.33**2)
    vanes = 4 * vane * radius * (1 - 0.33)
    pads = 3 * np.pi * (0.065 * radius) ** 2
    area = np.asarray(pupil.transmission).sum() * pupil.pitch**2
    both = vane * 2 * 0.065 * radius  # one pad lies on a vane
    # a vane is a whole number of points of 1.17 mm wide
    assert area == pytest.approx(ring - vanes - pads + both, abs=4 * 0.8 * 1.17e-3)


@pytest.mark.parametrize("make", [jwst_pupil, hst_pupil])
def test_their_aberrations_are_those_that_show_to_first_order(make):
    assert make().names == ("noll7", "noll8", "noll9", "noll10")
