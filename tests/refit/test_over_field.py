"""A field whose stars are blurred each in its own way; images are sums of images of single stars."""

import re

import numpy as np
import pytest

from jitterkit.forward import Parameters, expected_image
from jitterkit.likelihood import Data
from jitterkit.loci import Mvn
from jitterkit.refit import fit_frame
from jitterkit.refit.over_field import describe_field_variation
from jitterkit.scene import Stars

PLACES = np.array([[-6.0, -5.0], [5.5, -6.0], [6.0, 5.0], [-5.0, 6.0], [0.5, 0.3]])
FLUX = np.array([4e5, 2e5, 3e5, 1.5e5, 1e5])
ROUND = np.array([0.02, 0.0, 0.02])


def said_of(telescope, moments, rng):
    """What is said of a field whose stars have such moments (n, 3), fitted with one blur for all."""
    system, state = telescope.system(), np.zeros(len(telescope.aberrations))
    otf = system.otf(state)
    image = np.full(telescope.shape, 10.0)
    for (x, y), flux, own in zip(PLACES, FLUX, moments, strict=True):
        star = Stars.of([x], [y], [flux])
        image = image + np.asarray(expected_image(Parameters(star, Mvn.near(own), state), otf))
    data = Data(rng.poisson(image).astype(float))
    start = Parameters(Stars.of(*PLACES.T, FLUX), Mvn.near(ROUND), state, 10.0)
    fit = fit_frame(data, system, start, otf)
    return describe_field_variation(fit.parameters, system.otf(fit.parameters.aberrations), fit.image, data)


def test_one_blur_for_all_is_not_remarked(telescope, rng):
    assert [said_of(telescope, np.tile(ROUND, (5, 1)), rng) for _ in range(12)] == [""] * 12


@pytest.mark.parametrize("axis", [(0.0, 0.0), (4.0, -3.0)])
def test_a_roll_is_reported_with_its_size_wherever_its_axis_is(axis, telescope, rng):
    """A star moves by the roll times its distance from the axis, uniformly: a twelfth of the square."""
    roll = np.radians(4.0)
    x, y = (PLACES - axis).T
    turned = roll**2 / 12 * np.stack([y**2, -x * y, x**2], axis=1)
    said = said_of(telescope, ROUND + turned, rng)
    found = re.search(r"rolled by ([\d.]+) ± ([\d.]+) degrees", said)
    assert found, said
    assert abs(float(found[1]) - 4.0) < 4 * float(found[2]) + 0.1  # to the moments' first order
    assert float(found[2]) < 0.5


def test_a_blur_that_grows_to_one_side_is_reported(telescope, rng):
    wider = ROUND * (1 + 0.15 * PLACES[:, :1])
    assert "differs from star to star" in said_of(telescope, wider, rng)
